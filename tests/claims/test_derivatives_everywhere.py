"""Derivatives and values are right for actuators drawn at random, of every structure.

Required at the default accuracy: values within 1e-4 um (1e-4 N) of the tightest; every column that the record
shows within 1e-3 of central differences, or a discontinuity that the differences show, too; forward and reverse mode
alike.  By default `integration/test_sensitivities.py` asks two rigs; `experiments.map_of_rightness` has many.
"""

from collections.abc import Iterable, Iterator

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.actuator_structure import Structure
from experiments.derivative_judge import REVERSE, VALUES, Judge, Verdict
from experiments.map_of_rightness import drawn, wrongs
from experiments.random_actuators import LAWS, PUBLISHED, STRUCTURES
from pdssjax import Accuracy
from pdssjax.drive.sawtooth import Sawtooth
from pdssjax.integration import TIGHT

MANY = 3
ONCE_WRONG = {
    "force, forward, 5 Hz": (131, 176),
    "reset-integrator": (137,),
    "composed:second-order+asymmetry-2+creep-1, loaded": (93, 145),
    "platform with feedback": (31, 54, 143),
    "maxwell-slip, loaded": (73,),
    "dahl": (174,),
    "anisotropic-lugre under a load and on a tilt": (19, 21, 111, 162),
    "lugre with little friction": (189,),
    "simplified-lugre with little friction": (102,),
    "dahl with little friction": (124,),
    "generalized-maxwell-slip on a static stack": (4,),
    "stribeck on a static stack, held voltage, amplifier that slews": (0, 1),
}
"""Settled too early or never, noise in what is left of a ringing, the error of its phase, deflections that are a
rounding of the motion (docs/numerics.md); a jump of the velocity past a law's own event."""


@pytest.fixture(autouse=True)
def a_structure_at_a_time() -> Iterator[None]:
    """What is compiled for 108 of them took 21 GB."""
    yield
    jax.clear_caches()


def verdicts(name: str, numbers: Iterable[int]) -> dict[int, Verdict]:
    judge = Judge(STRUCTURES[name])
    return {number: Verdict(**drawn(judge, number)) for number in numbers}


def check(name: str, found: dict[int, Verdict]) -> None:
    told = dict(zip(found, wrongs(name, list(found.values())), strict=True))
    assert not any(told.values()), told


@pytest.mark.slow
@pytest.mark.parametrize("name", STRUCTURES)
def test_actuators_of_every_structure(name):
    found = verdicts(name, dict.fromkeys((*range(MANY), *ONCE_WRONG.get(name, ()))))
    check(name, {number: found[number] for number in range(MANY)})
    assert all(found[number].is_right and found[number].reverse < 1e-10 for number in ONCE_WRONG.get(name, ())), found


def test_structures_that_were_once_wrong_are_still_asked():
    assert set(ONCE_WRONG) <= set(STRUCTURES)


@pytest.mark.slow
def test_a_ringing_that_is_rounding_has_no_reversals_to_derive():
    """A stack that never settles rings on; reversals of 1e-17 m took a column of sigma0 24 % off."""
    name = "maxwell-slip, loaded"
    check(name, verdicts(name, (5, 9)))


SLIDING = {
    "piezo.gain": 8.689e-8,
    "piezo.natural_frequency": 10642.0,
    "piezo.damping_ratio": 0.5712,
    "effector.mass": 0.1,
    "friction.f_c": 8.831e-3,
    "friction.f_s": 8.079e-2,
    "friction.sigma0": 2.387e6,
    "friction.sigma1": 283.9,
    "friction.sigma2": 408.3,
    "friction.v_s": 2.881e-5,
    "friction.elastic_part": 0.9807,
}
"""Where a fit of the measured record of Liu et al. (2015) went."""


@pytest.mark.slow
def test_a_narrow_transition_to_sliding_is_resolved_for_derivatives():
    """Values were right, the Jacobian off by 1e42: steps passed poles of what is left of the transition."""
    structure = Structure("elastoplastic", drive=Sawtooth(30.0, 5.0, 7.314e-5), given=SLIDING)
    verdict = Judge(structure).verdict(np.zeros(len(structure.nominal)))
    assert verdict.is_right and verdict.reverse < 1e-8, verdict


def test_every_unit_has_its_structure():
    assert {structure.unit for structure in STRUCTURES.values()} == set(VALUES)
    assert len(PUBLISHED) == 4


class Made:
    """A structure of two parameters whose record is given in closed form."""

    def __init__(self, wrong=0.0, jump=0.0, width=0.0):
        self.nominal, self.times = {"a.slow": 1.0, "b.jump": 1.0}, np.linspace(0.0, 1.0, 20)
        self.wrong, self.jump, self.width = wrong, jump, width

    def slopes(self, factors):
        """The derivative of `values`, the second column off by the part `wrong`."""
        return np.stack([np.cos(factors[0] + self.times), (1.0 + self.wrong) * np.ones(20)], axis=1)

    def values(self, factors):
        steps = self.width * np.floor(factors[1] / self.width + 0.3) if self.width else 0.0
        return np.sin(factors[0] + self.times) + factors[1] + self.jump * (factors[1] > 0.0) + steps


def made_judge(made, failed=False, back=1.0):
    """A judge to whom both accuracies show the same."""
    found = Judge(made)
    found.values = lambda factors, accuracy: made.values(factors)
    jacobian = lambda factors: made.slopes(factors) * (np.nan if failed else 1.0)
    found.slopes = lambda factors, accuracy: (jacobian(factors), back * (found.weights @ jacobian(factors)))
    return found


def test_a_wrong_column_a_discontinuity_a_failure_and_a_wrong_reverse_mode_are_told_apart():
    at = np.zeros(2)
    right = made_judge(Made()).verdict(at)
    assert right.is_right and right.error < 1e-8 and right.discontinuity is None and right.above == 0
    wrong = made_judge(Made(wrong=2e-3)).verdict(at)
    assert not wrong.is_right and not wrong.is_cliff and wrong.column == "b.jump" and wrong.above == 1
    assert wrong.error == pytest.approx(2e-3, rel=1e-3) and wrong.tight == pytest.approx(2e-3, rel=1e-3)
    jumping = made_judge(Made(jump=1e-6)).verdict(at)
    assert jumping.is_cliff and jumping.is_right and jumping.above == 0 and jumping.error > 1e-3
    assert made_judge(Made(), failed=True).verdict(at).failure == "usual"
    backward = made_judge(Made(), back=1.0 + 1e-6).verdict(at)
    assert not backward.is_right and backward.reverse > REVERSE


@pytest.mark.parametrize("width", [3e-6, 3e-8, 3e-10])
def test_a_derivative_between_many_discontinuities_is_seen_by_fine_differences(width):
    verdict = made_judge(Made(width=width)).verdict(np.zeros(2))
    assert verdict.is_right and not verdict.is_cliff and verdict.error < 1e-4 and verdict.discontinuity is not None
    assert not made_judge(Made(width=width, wrong=2e-3)).verdict(np.zeros(2)).error < 1e-3


def test_a_record_that_shows_nothing_has_right_derivatives():
    still = Made()
    still.slopes = lambda factors: np.zeros((20, 2))
    still.values = lambda factors: np.zeros(20)
    verdict = made_judge(still).verdict(np.zeros(2))
    assert verdict.is_right and verdict.reverse == 0.0 and verdict.error == 0.0


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
