"""Second derivatives are right for actuators drawn at random, of every law: beside differences of the gradients."""

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.random_actuators import LAWS, PUBLISHED
from pdssjax import Accuracy
from pdssjax.integration import TIGHT

COUNT = 10
STEPS = (1e-5, 1e-6, 1e-4)
FINE_STEPS = (1e-8, 1e-9, 1e-10)
"""For the bristle law: of hundreds of bonds that snap each depends on those before, and gradients bend within 1e-6."""
ASKED = 1e-4
"""Of the norm of the matrix."""


@pytest.fixture(autouse=True)
def a_law_at_a_time() -> Iterator[None]:
    yield
    jax.clear_caches()


@pytest.mark.slow
@pytest.mark.parametrize("name", [*PUBLISHED, *LAWS])
def test_second_derivatives_of_random_actuators_beside_differences_of_gradients(name):
    apart = errors(name, range(COUNT))
    assert max(apart.values()) < ASKED, apart


@pytest.mark.slow
def test_second_derivatives_that_do_not_exist_are_nan_and_first_ones_are_not():
    # Stiffnesses of 158 kN/m one way and 5.8 MN/m the other: as the contact comes to rest, every stop and slip shrinks
    # its motion by a third to a fifth and multiplies its relative sensitivity by four.
    structure = PUBLISHED["deflection, backward, 5 Hz"]
    factors = structure.draw(np.random.default_rng([12, 44]))
    last = lambda factors: structure.shown(factors, Accuracy())[-1]
    assert np.isfinite(jax.jit(jax.grad(last))(factors)).all()
    assert np.isnan(jax.jit(jax.hessian(last))(factors)).all()


def errors(name: str, numbers: range) -> dict[int, float]:
    """Of each actuator how far its second derivatives are from differences of gradients; checks that they commute."""
    structure = (PUBLISHED | LAWS)[name]
    weights = np.cos(np.arange(structure.times.size))

    def score(factors, tolerance, rest):
        accuracy = Accuracy(tolerance, rest, max_steps=60_000)
        return jnp.sum(weights * structure.shown(factors, accuracy)) * 1e6

    hessian, gradient = jax.jit(jax.hessian(score)), jax.jit(jax.grad(score))
    found, steps = {}, FINE_STEPS if name == "bristle" else STEPS
    for number in numbers:
        factors = structure.draw(np.random.default_rng([12, number]))
        bends = np.asarray(hessian(factors, Accuracy().tolerance, Accuracy().settle_tolerance))
        assert np.abs(bends - bends.T).max() <= 1e-8 * np.abs(bends).max()
        slope = lambda at: np.asarray(gradient(at, TIGHT.tolerance, TIGHT.settle_tolerance))
        unit = np.eye(len(factors))
        differences = [
            np.stack([slope(factors + h * e) - slope(factors - h * e) for e in unit]) / (2.0 * h) for h in steps
        ]
        found[number] = min(np.linalg.norm(bends - each) for each in differences) / np.linalg.norm(bends)
    return found
