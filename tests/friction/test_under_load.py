"""A contact loaded slowly from nothing: the state it comes to is that of the path there, and has its derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree
from scipy.optimize import brentq

from pdssjax.core import member, members

ELASTIC = [name for name in members("friction") if member("friction", name).at_rest == "elastic"]


def loaded(name: str, force: float):
    law = member("friction", name)()
    state = jax.jit(under_load)(law, force)
    return law, [float(component) for component in state]


@pytest.mark.parametrize("name", ELASTIC)
@pytest.mark.parametrize("force", [0.2, -0.2])
def test_it_carries_the_force(name, force):
    law, state = loaded(name, force)
    assert float(law.force(tuple(state), 0.0, np.sign(force))) == pytest.approx(force, rel=1e-12)


def path_to(force, target: float, low: float, high: float) -> float:
    return brentq(lambda path: force(path) - target, low, high, xtol=1e-22)


@pytest.mark.parametrize("share", [0.2, 0.8, -0.97])
def test_springs_of_generalized_maxwell_slip_stretch_until_their_blocks_slip(share):
    law = member("friction", "generalized-maxwell-slip")()
    stiffness, strength = np.array(law._stiffnesses()), np.array(law._strengths())
    target = abs(share) * strength.sum()
    path = path_to(lambda x: np.minimum(stiffness * x, strength).sum(), target, 0.0, 1e-4)
    _, state = loaded("generalized-maxwell-slip", share * strength.sum())
    assert (path > strength / stiffness).any() == (abs(share) > 0.5)
    np.testing.assert_allclose(state[:4], np.sign(share) * np.minimum(path, strength / stiffness), rtol=1e-12)


@pytest.mark.parametrize("share", [0.3, 0.999, -0.8])
def test_elements_of_bliman_and_sorine_s_law_stretch_along_one_path(share):
    law = member("friction", "bliman-sorine")()
    lengths, f_1 = np.array([law.eta, 1.0]) * law.epsilon, law.f_c + law.f_2
    stretches = lambda path: lengths * (1.0 - np.exp(-path / lengths))
    force = lambda path: stretches(path) @ [f_1 / lengths[0], -law.f_2 / lengths[1]]
    peak = law.eta * law.epsilon / (1.0 - law.eta) * np.log(f_1 / (law.eta * law.f_2))
    path = path_to(force, abs(share) * force(peak), 0.0, peak)
    _, state = loaded("bliman-sorine", share * force(peak))
    np.testing.assert_allclose(state, np.sign(share) * stretches(path), rtol=1e-9)


@pytest.mark.parametrize("share", [0.5, 0.8, -0.95])
def test_bonds_of_the_bristle_law_snap_in_turn(share):
    law = member("friction", "bristle")()
    longest, count, snapped = 1.5 * law.f_c / law.sigma0, law.bristles, 0
    stretches = longest * ((np.arange(count) + 0.5) / count - 0.5) * np.sign(share)
    step = 1e-5 * longest
    # Small steps in one direction; the mirror case has its bonds the other way round.
    while stretches.mean() * law.sigma0 < abs(share) * law.f_c:
        stretches += step
        for broken in np.flatnonzero(stretches >= longest):
            snapped += 1
            stretches[broken] = longest * (snapped * 0.5 * (5.0**0.5 - 1.0) % 1.0)
    _, state = loaded("bristle", share * law.f_c)
    assert (state[-1], snapped > 0) == (snapped, abs(share) > 0.75)
    np.testing.assert_allclose(np.sign(share) * np.array(state[:-1]), stretches, atol=2.0 * step)


@pytest.mark.parametrize("name", ELASTIC)
def test_a_force_beyond_what_it_holds_gives_numbers(name):
    _, state = loaded(name, 30.0)
    assert np.isfinite(state).all()


@pytest.mark.parametrize("name", ELASTIC)
def test_derivatives_are_those_of_differences(name):
    numbers, rebuilt = ravel_pytree((member("friction", name)(), 0.45))
    state = jax.jit(lambda numbers: jnp.stack(under_load(*rebuilt(numbers))))
    columns = np.asarray(jax.jacfwd(state)(numbers)) * np.asarray(numbers)
    for i, number in enumerate(numbers):
        change = np.zeros(numbers.size)
        change[i] = 1e-6 * float(number)
        differences = (state(numbers + change) - state(numbers - change)) / 2e-6
        np.testing.assert_allclose(columns[:, i], differences, rtol=1e-5, atol=1e-8 * np.abs(columns).max())
    assert np.abs(columns[:, -1]).max() > 0.0


def under_load(law, force):
    return law.under_load(force)
