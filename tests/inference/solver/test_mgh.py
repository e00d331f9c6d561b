"""Problems of J. J. Moré, B. S. Garbow and K. E. Hillstrom, with and without bounds, beside SciPy from the same starts.

ACM Trans. Math. Software 7, 17 (1981): those unlike the curves that NIST fits, with bent valleys, plateaus, columns of
all sizes and Jacobians that are singular at the minimum. Bounds are those of D. M. Gay, ibid. 10, 1984, in spirit: some
keep the unbounded answer out, some do not. Padded to the same shapes, so that one compiled function solves them all.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest
from beside_scipy import best_of_scipy, trf_within
from jax import lax

from pdssjax import BoundedLevenbergMarquardt
from pdssjax.inference import SUCCESSES, Ending

PARAMETERS, RESIDUALS = 8, 30


def _freudenstein_roth(x):
    return jnp.stack(
        [-13.0 + x[0] + ((5.0 - x[1]) * x[1] - 2.0) * x[1], -29.0 + x[0] + ((x[1] + 1.0) * x[1] - 14.0) * x[1]]
    )


def _powell_bad(x):
    return jnp.stack([1e4 * x[0] * x[1] - 1.0, jnp.exp(-x[0]) + jnp.exp(-x[1]) - 1.0001])


def _brown_bad(x):
    return jnp.stack([x[0] - 1e6, x[1] - 2e-6, x[0] * x[1] - 2.0])


def _jennrich_sampson(x):
    i = jnp.arange(1.0, 11.0)
    return 2.0 + 2.0 * i - (jnp.exp(i * x[0]) + jnp.exp(i * x[1]))


def _helical_valley(x):
    turn = jnp.arctan2(x[1], x[0]) / (2.0 * jnp.pi)
    return jnp.stack([10.0 * (x[2] - 10.0 * turn), 10.0 * (jnp.sqrt(x[0] ** 2 + x[1] ** 2) - 1.0), x[2]])


def _gulf(x):
    t = jnp.arange(1.0, 31.0) / 100.0
    y = 25.0 + (-50.0 * jnp.log(t)) ** (2.0 / 3.0)
    return jnp.exp(-(jnp.abs(y - x[1]) ** x[2]) / x[0]) - t


def _powell_singular(x):
    return jnp.stack(
        [
            x[0] + 10.0 * x[1],
            np.sqrt(5.0) * (x[2] - x[3]),
            (x[1] - 2.0 * x[2]) ** 2,
            np.sqrt(10.0) * (x[0] - x[3]) ** 2,
        ]
    )


def _wood(x):
    return jnp.stack(
        [
            10.0 * (x[1] - x[0] ** 2),
            1.0 - x[0],
            np.sqrt(90.0) * (x[3] - x[2] ** 2),
            1.0 - x[2],
            np.sqrt(10.0) * (x[1] + x[3] - 2.0),
            (x[1] - x[3]) / np.sqrt(10.0),
        ]
    )


def _linear_rank_one(x):
    return jnp.arange(1.0, 16.0) * jnp.sum(jnp.arange(1.0, 7.0) * x[:6]) - 1.0


def _chebyquad(x):
    x = 2.0 * x[:8] - 1.0
    before, now, rows = jnp.ones_like(x), x, []
    for order in range(1, 9):
        integral = 0.0 if order % 2 else -1.0 / (order**2 - 1.0)
        rows.append(jnp.mean(now) - integral)
        before, now = now, 2.0 * x * now - before
    return jnp.stack(rows)


class TestProblem(NamedTuple):
    """Residual function, start, local minima known, and bounds to try besides."""

    __test__ = False
    residual: object
    start: list[float]
    minima: list[float]
    low: list[float] | None = None
    high: list[float] | None = None


PROBLEMS = {
    "Freudenstein-Roth": TestProblem(_freudenstein_roth, [0.5, -2.0], [0.0, 48.98425], [0.0, -20.0], [20.0, -0.9]),
    "Powell badly scaled": TestProblem(_powell_bad, [0.0, 1.0], [0.0], [0.0, 1.0], [1.0, 9.0]),
    "Brown badly scaled": TestProblem(_brown_bad, [1.0, 1.0], [0.0], [0.0, 3e-5], [1e6, 100.0]),
    "Jennrich-Sampson": TestProblem(_jennrich_sampson, [0.3, 0.4], [124.3622], [0.26, 0.0], [5.0, 20.0]),
    "helical valley": TestProblem(_helical_valley, [-1.0, 0.1, 0.0], [0.0], [-100.0, -1.0, -1.0], [0.8, 1.0, 1.0]),
    "Gulf": TestProblem(_gulf, [5.0, 2.5, 0.15], [0.0, 0.038], [1.0, 1.0, 0.1], [40.0, 30.0, 10.0]),
    "Powell singular": TestProblem(
        _powell_singular, [3.0, -1.0, 0.0, 1.0], [0.0], [0.1, -20.0, -1.0, -1.0], [100.0, 20.0, 1.0, 50.0]
    ),
    "Wood": TestProblem(_wood, [-3.0, -1.0, -3.0, -1.0], [0.0], [-100.0] * 4, [0.0, 10.0, 100.0, 100.0]),
    "linear, rank one": TestProblem(_linear_rank_one, [1.0] * 6, [15.0 * 14.0 / (2.0 * 31.0)], [0.5] * 6, [9.0] * 6),
    "Chebyquad": TestProblem(_chebyquad, [i / 9.0 for i in range(1, 9)], [3.51687e-3], [0.0] * 8, [0.04] + [1.0] * 7),
}


def _padded(residual):
    return lambda x: jnp.pad(found := residual(x), (0, RESIDUALS - found.size))


def residual(x, which):
    """Of the problem number `which`, shape (30,)."""
    return lax.switch(which, [_padded(problem.residual) for problem in PROBLEMS.values()], x)


def posed(name: str, bounded: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Start, lower and upper bounds, padded with parameters that are held; the start put within the bounds."""
    problem = PROBLEMS[name]
    count = len(problem.start)
    start, low, high = np.zeros(PARAMETERS), np.zeros(PARAMETERS), np.zeros(PARAMETERS)
    low[:count], high[:count] = (problem.low, problem.high) if bounded else (-np.inf, np.inf)
    start[:count] = np.clip(problem.start, low[:count], high[:count])
    return start, low, high


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


SINGULAR = {"Freudenstein-Roth", "Jennrich-Sampson", "Chebyquad"}
"""The Jacobian is singular at the minimum, as it must be where as many residuals as parameters do not vanish."""


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
