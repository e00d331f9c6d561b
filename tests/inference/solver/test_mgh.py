"""Moré, Garbow and Hillstrom's problems, with and without bounds, beside SciPy from the same starts."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest
from beside_scipy import best_of_scipy, trf_within
from mgh_problems import PROBLEMS, posed, residual

from pdssjax import BoundedLevenbergMarquardt
from pdssjax.inference import SUCCESSES, Ending

_RESIDUAL = jax.jit(residual)
_JACOBIAN = jax.jit(jax.jacfwd(residual))
NUMBERS = {name: np.asarray(i) for i, name in enumerate(PROBLEMS)}


@eqx.filter_jit
def _solved(y, which, options):
    solver = BoundedLevenbergMarquardt(rtol=1e-12, atol=jnp.asarray(1e-20))
    fn = lambda y, which: (residual(y, which), None)
    return optx.least_squares(fn, solver, y, which, has_aux=True, options=options, max_steps=3000, throw=False)


def solve(name, bounded):
    """Where ours ended: the point, the sum of squares, the ending, and SciPy's best from there."""
    start, low, high = posed(name, bounded)
    solution = _solved(jnp.asarray(start), NUMBERS[name], {"lower": low, "upper": high})
    y, state = np.asarray(solution.value), solution.stats["state"]
    assert (y >= low).all()
    assert (y <= high).all()
    residual, jacobian = (lambda x, of=of: of(x, NUMBERS[name]) for of in (_RESIDUAL, _JACOBIAN))
    best = best_of_scipy(residual, jacobian, y, low, high)
    return y, float(np.sum(np.asarray(state.residual) ** 2)), Ending(int(state.ending)), best


def beside_trf(name):
    """The sum of squares that SciPy's "trf" reaches within the bounds from the same start."""
    start, low, high = posed(name, True)
    inside = np.clip(start, low + 1e-10 * (high - low), high - 1e-10 * (high - low))
    residual, jacobian = (lambda x, of=of: of(x, NUMBERS[name]) for of in (_RESIDUAL, _JACOBIAN))
    return 2.0 * trf_within(residual, jacobian, inside, low, high).cost


SINGULAR = {"Freudenstein-Roth", "Jennrich-Sampson", "trigonometric", "Chebyquad", "penalty"}
"""The Jacobian is singular at the minimum, as it must be where as many residuals as parameters do not vanish,
or all but singular beside the curvature that the linear model leaves out (penalty, by 1e5)."""


def may_end(name):
    """How a run may end; where the Jacobian is singular, the linear model predicts what no step gives."""
    return (*SUCCESSES, Ending.STALLED, Ending.REJECTED) if name in SINGULAR else SUCCESSES


@pytest.mark.parametrize("name", PROBLEMS)
def test_a_known_minimum_is_found(name):
    _, squares, ending, best = solve(name, bounded=False)
    assert ending in may_end(name), ending.name
    assert squares <= 1.005 * best + 1e-12
    assert any(squares == pytest.approx(least, rel=1e-3, abs=1e-9) for least in PROBLEMS[name].minima), squares


@pytest.mark.parametrize("name", [name for name, problem in PROBLEMS.items() if problem.low])
def test_within_bounds_nobody_goes_further_down(name):
    _, squares, ending, best = solve(name, bounded=True)
    assert ending in may_end(name), ending.name
    assert squares <= 1.005 * min(best, beside_trf(name)) + 1e-12
