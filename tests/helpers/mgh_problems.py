"""Test problems of J. J. Moré, B. S. Garbow and K. E. Hillstrom, ACM Trans. Math. Software 7, 17 (1981).

Of the 35, those that are sums of squares at fixed sizes, as one function of a number, padded to the same
shapes, so that one compiled function solves them all.  Bounds are those of D. M. Gay, ibid. 10, 1984, in
spirit: some keep the unbounded answer out, some do not.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import lax

PARAMETERS, RESIDUALS = 12, 40
_BARD = np.array([0.14, 0.18, 0.22, 0.25, 0.29, 0.32, 0.35, 0.39, 0.37, 0.58, 0.73, 0.96, 1.34, 2.10, 4.39])
_KOWALIK = (
    np.array([0.1957, 0.1947, 0.1735, 0.1600, 0.0844, 0.0627, 0.0456, 0.0342, 0.0323, 0.0235, 0.0246]),
    np.array([4.0, 2.0, 1.0, 0.5, 0.25, 0.167, 0.125, 0.1, 0.0833, 0.0714, 0.0625]),
)
_MEYER = np.array(
    [34780, 28610, 23650, 19630, 16370, 13720, 11540, 9744, 8261, 7030, 6005, 5147, 4427, 3820, 3307, 2872], float
)
_OSBORNE = np.array(
    "0.844 0.908 0.932 0.936 0.925 0.908 0.881 0.850 0.818 0.784 0.751 0.718 0.685 0.658 0.628 0.603 0.580 0.558 "
    "0.538 0.522 0.506 0.490 0.478 0.467 0.457 0.448 0.438 0.431 0.424 0.420 0.414 0.411 0.406".split(),
    float,
)


def _rosenbrock(x):
    return jnp.stack([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0]])


def _freudenstein_roth(x):
    return jnp.stack(
        [-13.0 + x[0] + ((5.0 - x[1]) * x[1] - 2.0) * x[1], -29.0 + x[0] + ((x[1] + 1.0) * x[1] - 14.0) * x[1]]
    )


def _powell_bad(x):
    return jnp.stack([1e4 * x[0] * x[1] - 1.0, jnp.exp(-x[0]) + jnp.exp(-x[1]) - 1.0001])


def _brown_bad(x):
    return jnp.stack([x[0] - 1e6, x[1] - 2e-6, x[0] * x[1] - 2.0])


def _beale(x):
    return jnp.stack([y - x[0] * (1.0 - x[1] ** i) for i, y in ((1, 1.5), (2, 2.25), (3, 2.625))])


def _jennrich_sampson(x):
    i = jnp.arange(1.0, 11.0)
    return 2.0 + 2.0 * i - (jnp.exp(i * x[0]) + jnp.exp(i * x[1]))


def _helical_valley(x):
    turn = jnp.arctan2(x[1], x[0]) / (2.0 * jnp.pi)
    return jnp.stack([10.0 * (x[2] - 10.0 * turn), 10.0 * (jnp.sqrt(x[0] ** 2 + x[1] ** 2) - 1.0), x[2]])


def _bard(x):
    u = jnp.arange(1.0, 16.0)
    v = 16.0 - u
    return _BARD - (x[0] + u / (v * x[1] + jnp.minimum(u, v) * x[2]))


def _gaussian(x):
    i = jnp.arange(1.0, 16.0)
    half = [0.0009, 0.0044, 0.0175, 0.0540, 0.1295, 0.2420, 0.3521]
    return x[0] * jnp.exp(-x[1] * ((8.0 - i) / 2.0 - x[2]) ** 2 / 2.0) - np.array([*half, 0.3989, *half[::-1]])


def _meyer(x):
    return x[0] * jnp.exp(x[1] / (45.0 + 5.0 * jnp.arange(1.0, 17.0) + x[2])) - _MEYER


def _gulf(x):
    t = jnp.arange(1.0, 31.0) / 100.0
    y = 25.0 + (-50.0 * jnp.log(t)) ** (2.0 / 3.0)
    return jnp.exp(-(jnp.abs(y - x[1]) ** x[2]) / x[0]) - t


def _box_three(x):
    t = jnp.arange(1.0, 11.0) / 10.0
    return jnp.exp(-t * x[0]) - jnp.exp(-t * x[1]) - x[2] * (jnp.exp(-t) - jnp.exp(-10.0 * t))


def _powell_singular(x):
    return jnp.stack(
        [x[0] + 10.0 * x[1], np.sqrt(5.0) * (x[2] - x[3]), (x[1] - 2.0 * x[2]) ** 2, np.sqrt(10.0) * (x[0] - x[3]) ** 2]
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


def _kowalik_osborne(x):
    y, u = _KOWALIK
    return y - x[0] * (u**2 + u * x[1]) / (u**2 + u * x[2] + x[3])


def _brown_dennis(x):
    t = jnp.arange(1.0, 21.0) / 5.0
    return (x[0] + t * x[1] - jnp.exp(t)) ** 2 + (x[2] + x[3] * jnp.sin(t) - jnp.cos(t)) ** 2


def _osborne_one(x):
    t = 10.0 * jnp.arange(33.0)
    return _OSBORNE - (x[0] + x[1] * jnp.exp(-t * x[3]) + x[2] * jnp.exp(-t * x[4]))


def _biggs(x):
    t = jnp.arange(1.0, 14.0) / 10.0
    y = jnp.exp(-t) - 5.0 * jnp.exp(-10.0 * t) + 3.0 * jnp.exp(-4.0 * t)
    return x[2] * jnp.exp(-t * x[0]) - x[3] * jnp.exp(-t * x[1]) + x[5] * jnp.exp(-t * x[4]) - y


def _watson(x):
    t, n = jnp.arange(1.0, 30.0) / 29.0, 6
    slope = sum((j - 1.0) * x[j - 1] * t ** (j - 2) for j in range(2, n + 1))
    value = sum(x[j - 1] * t ** (j - 1) for j in range(1, n + 1))
    return jnp.concatenate([slope - value**2 - 1.0, jnp.stack([x[0], x[1] - x[0] ** 2 - 1.0])])


def _penalty_one(x):
    x = x[:4]
    return jnp.concatenate([np.sqrt(1e-5) * (x - 1.0), jnp.sum(x**2)[None] - 0.25])


def _variably_dimensioned(x):
    x = x[:8]
    weighted = jnp.sum(jnp.arange(1.0, 9.0) * (x - 1.0))
    return jnp.concatenate([x - 1.0, jnp.stack([weighted, weighted**2])])


def _trigonometric(x):
    x, i = x[:8], jnp.arange(1.0, 9.0)
    return 8.0 - jnp.sum(jnp.cos(x)) + i * (1.0 - jnp.cos(x)) - jnp.sin(x)


def _brown_almost_linear(x):
    x = x[:8]
    return jnp.concatenate([x[:7] + jnp.sum(x) - 9.0, jnp.prod(x)[None] - 1.0])


def _boundary_value(x):
    x, h = x[:8], 1.0 / 9.0
    t = h * jnp.arange(1.0, 9.0)
    padded = jnp.pad(x, 1)
    return 2.0 * x - padded[:-2] - padded[2:] + h**2 * (x + t + 1.0) ** 3 / 2.0


def _broyden_tridiagonal(x):
    x = x[:8]
    padded = jnp.pad(x, 1)
    return (3.0 - 2.0 * x) * x - padded[:-2] - 2.0 * padded[2:] + 1.0


def _linear_full(x):
    x = x[:6]
    spread = 2.0 * jnp.sum(x) / 15.0
    return jnp.concatenate([x, jnp.zeros(9)]) - spread - 1.0


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
    """Residual function, start, local minima known, and bounds to try besides.

    The paper's are given, but for the trigonometric function with n = 8: there it is what SciPy finds too.
    """

    __test__ = False
    residual: object
    start: list[float]
    minima: list[float]
    low: list[float] | None = None
    high: list[float] | None = None


PROBLEMS = {
    "Rosenbrock": TestProblem(_rosenbrock, [-1.2, 1.0], [0.0], [-50.0, 0.0], [0.5, 100.0]),
    "Freudenstein-Roth": TestProblem(_freudenstein_roth, [0.5, -2.0], [0.0, 48.98425], [0.0, -20.0], [20.0, -0.9]),
    "Powell badly scaled": TestProblem(_powell_bad, [0.0, 1.0], [0.0], [0.0, 1.0], [1.0, 9.0]),
    "Brown badly scaled": TestProblem(_brown_bad, [1.0, 1.0], [0.0], [0.0, 3e-5], [1e6, 100.0]),
    "Beale": TestProblem(_beale, [1.0, 1.0], [0.0], [0.6, 0.5], [10.0, 100.0]),
    "Jennrich-Sampson": TestProblem(_jennrich_sampson, [0.3, 0.4], [124.3622], [0.26, 0.0], [5.0, 20.0]),
    "helical valley": TestProblem(_helical_valley, [-1.0, 0.1, 0.0], [0.0], [-100.0, -1.0, -1.0], [0.8, 1.0, 1.0]),
    "Bard": TestProblem(_bard, [1.0, 1.0, 1.0], [8.21487e-3, 17.4286], [0.1, 0.0, 0.0], [50.0, 1.0, 50.0]),
    "Gaussian": TestProblem(_gaussian, [0.4, 1.0, 0.0], [1.12793e-8], [0.398, 1.0, -0.5], [4.2, 2.0, 0.1]),
    "Meyer": TestProblem(_meyer, [0.02, 4000.0, 250.0], [87.9458], [0.006, 0.0, 0.0], [2.0, 3e5, 3e4]),
    "Gulf": TestProblem(_gulf, [5.0, 2.5, 0.15], [0.0, 0.038], [1.0, 1.0, 0.1], [40.0, 30.0, 10.0]),
    "box three-dimensional": TestProblem(_box_three, [0.0, 10.0, 20.0], [0.0], [0.0, 5.0, 0.0], [2.0, 9.5, 20.0]),
    "Powell singular": TestProblem(
        _powell_singular, [3.0, -1.0, 0.0, 1.0], [0.0], [0.1, -20.0, -1.0, -1.0], [100.0, 20.0, 1.0, 50.0]
    ),
    "Wood": TestProblem(_wood, [-3.0, -1.0, -3.0, -1.0], [0.0], [-100.0] * 4, [0.0, 10.0, 100.0, 100.0]),
    "Kowalik-Osborne": TestProblem(
        _kowalik_osborne, [0.25, 0.39, 0.415, 0.39], [3.07505e-4], [0.0, -1.0, 0.13, 0.12], [10.0, 12.0, 13.0, 12.0]
    ),
    "Brown-Dennis": TestProblem(
        _brown_dennis, [25.0, 5.0, -5.0, -1.0], [85822.2], [-10.0, 0.0, -100.0, -20.0], [100.0, 15.0, 0.0, 0.2]
    ),
    "Osborne 1": TestProblem(
        _osborne_one,
        [0.5, 1.5, -1.0, 0.01, 0.02],
        [5.46489e-5],
        [0.0, 0.0, -50.0, 0.0, 0.0],
        [0.38, 100.0, 0.0, 1.0, 10.0],
    ),
    "Biggs": TestProblem(
        _biggs, [1.0, 2.0, 1.0, 1.0, 1.0, 1.0], [0.0, 5.65565e-3, 0.30637], [0.0] * 6, [2.0, 8.0, 1.0, 7.0, 5.0, 5.0]
    ),
    "Watson": TestProblem(
        _watson, [0.0] * 6, [2.28767e-3], [-0.015, 0.0, -3.0, 0.0, -3.0, 0.0], [10.0, 100.0, 0.2, 100.0, 100.0, 0.99]
    ),
    "penalty": TestProblem(_penalty_one, [1.0, 2.0, 3.0, 4.0], [2.24997e-5], [0.0, 1.0, 0.0, 0.0], [100.0] * 4),
    "variably dimensioned": TestProblem(
        _variably_dimensioned, [1.0 - i / 8.0 for i in range(1, 9)], [0.0], [0.0] * 8, [0.9] * 4 + [2.0] * 4
    ),
    "trigonometric": TestProblem(_trigonometric, [1.0 / 8.0] * 8, [0.0, 1.10610e-5], [0.0] * 8, [1.0] * 8),
    "Brown almost linear": TestProblem(_brown_almost_linear, [0.5] * 8, [0.0, 1.0], [0.0] * 8, [2.0] * 7 + [0.8]),
    "boundary value": TestProblem(
        _boundary_value, [i / 9.0 * (i / 9.0 - 1.0) for i in range(1, 9)], [0.0], [-0.11] * 8, [1.0] * 8
    ),
    "Broyden tridiagonal": TestProblem(_broyden_tridiagonal, [-1.0] * 8, [0.0], [-1.0] * 8, [-0.6] * 7 + [1.0]),
    "linear, full rank": TestProblem(_linear_full, [1.0] * 6, [9.0], [-0.5] * 6, [2.0] * 6),
    "linear, rank one": TestProblem(_linear_rank_one, [1.0] * 6, [15.0 * 14.0 / (2.0 * 31.0)], [0.5] * 6, [9.0] * 6),
    "Chebyquad": TestProblem(_chebyquad, [i / 9.0 for i in range(1, 9)], [3.51687e-3], [0.0] * 8, [0.04] + [1.0] * 7),
}


def _padded(residual):
    return lambda x: jnp.pad(found := residual(x), (0, RESIDUALS - found.size))


def residual(x, which):
    """Of the problem number `which`, shape (40,)."""
    return lax.switch(which, [_padded(problem.residual) for problem in PROBLEMS.values()], x)


def posed(name: str, bounded: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Start, lower and upper bounds, padded with parameters that are held; the start put within the bounds."""
    problem = PROBLEMS[name]
    count = len(problem.start)
    start, low, high = np.zeros(PARAMETERS), np.zeros(PARAMETERS), np.zeros(PARAMETERS)
    low[:count], high[:count] = (problem.low, problem.high) if bounded else (-np.inf, np.inf)
    start[:count] = np.clip(problem.start, low[:count], high[:count])
    return start, low, high
