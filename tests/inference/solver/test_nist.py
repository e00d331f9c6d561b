"""All 27 nonlinear regression problems of NIST, from both starts: certified values, and bounds beside SciPy."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest
from beside_scipy import trf_within
from nist_strd import DATA, MODELS, regression, residual, starts

from pdssjax import BoundedLevenbergMarquardt
from pdssjax.inference import SUCCESSES, Ending, least_squares_covariance

SEVEN_DIGITS = ("Misra1a", "Thurber", "MGH09")
"""Of the easy, the middling and the hard problems, the ones of which more is asked."""

_RESIDUAL = jax.jit(residual)
_JACOBIAN = jax.jit(jax.jacfwd(residual))


@eqx.filter_jit
def _solved(y, problem, options):
    solver = BoundedLevenbergMarquardt(rtol=1e-15)
    fn = lambda y, problem: (residual(y, problem), None)
    return optx.least_squares(fn, solver, y, problem, has_aux=True, options=options, max_steps=3000, throw=False)


def solve(name, start):
    """From a padded `start`; what is padded is held."""
    return _solved(jnp.asarray(start), regression(name), unbounded(name, start))


def unbounded(name, start):
    """Bounds that hold what is padded at `start`."""
    free = np.arange(start.size) < len(DATA[name]["certified"])
    return {"lower": np.where(free, -np.inf, start), "upper": np.where(free, np.inf, start)}


@pytest.mark.parametrize("which", [0, 1], ids=["far", "near"])
@pytest.mark.parametrize("name", MODELS)
def test_certified_values_are_found(name, which):
    solution = solve(name, starts(name)[which])
    state, certified = solution.stats["state"], DATA[name]["certified"]
    assert Ending(int(state.ending)) in SUCCESSES, Ending(int(state.ending)).name
    strict = 0.1 if name in SEVEN_DIGITS else 1.0
    np.testing.assert_allclose(solution.value[: len(certified)], certified, rtol=1e-6 * strict)
    squares = DATA[name]["squares"]
    # Lanczos1 was made up without noise: its residuals are what the rounding of 14 digits left.
    rounding = 4.0 * np.finfo(float).eps * np.linalg.norm(DATA[name]["y"]) * np.sqrt(squares)
    np.testing.assert_allclose(np.sum(state.residual**2), squares, rtol=1e-8 * strict, atol=rounding)
    deviations = DATA[name]["deviations"]
    found = least_squares_covariance(np.asarray(state.jacobian)[:, : len(certified)], np.zeros(len(certified), bool))
    noise = squares / (len(DATA[name]["y"]) - len(certified))
    np.testing.assert_allclose(np.sqrt(np.diag(found.matrix) * noise), deviations, rtol=1e-4 if strict == 1.0 else 1e-6)


@pytest.mark.parametrize("name", MODELS)
def test_a_bound_that_keeps_the_answer_out_leads_where_trf_does(name):
    """Halfway between the near start and the certified value, in the first parameter."""
    problem, start = regression(name), starts(name)[1]
    options, certified = unbounded(name, start), DATA[name]["certified"][0]
    end = "upper" if certified > start[0] else "lower"
    options[end][0] = 0.5 * (start[0] + certified)
    solution = _solved(jnp.asarray(start), problem, options)
    state, y = solution.stats["state"], np.asarray(solution.value)
    assert (y >= options["lower"]).all() and (y <= options["upper"]).all()
    bounds = options["lower"], options["upper"]
    beside = trf_within(lambda b: _RESIDUAL(b, problem), lambda b: _JACOBIAN(b, problem), start, *bounds)
    squares = float(np.sum(state.residual**2))
    assert squares <= 2.0 * beside.cost * (1.0 + 1e-8), Ending(int(state.ending)).name
