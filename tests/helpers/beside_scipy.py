"""How low SciPy's least squares gets from where a fit of ours ended: a fit that converged must not be beaten."""

from collections.abc import Callable

import numpy as np
from scipy.optimize import least_squares

METHODS = "trf", "dogbox", "lm"


def best_of_scipy(
    residual: Callable, jacobian: Callable, start: np.ndarray, low: np.ndarray, high: np.ndarray, evaluations: int = 200
) -> float:
    """The least sum of squares within the bounds that any of SciPy's methods reaches from `start`.

    "lm" knows no bounds: where there are some, it counts if it ends within them.
    """
    start = np.asarray(start)
    found = [float(np.sum(np.asarray(residual(start)) ** 2))]
    free = np.flatnonzero(low < high)
    whole = lambda x: _filled(start, free, x)
    fun = lambda x: np.nan_to_num(np.asarray(residual(whole(x))), nan=1e8, posinf=1e8, neginf=-1e8)
    jac = lambda x: np.nan_to_num(np.asarray(jacobian(whole(x)))[:, free])
    for method in METHODS:
        if method == "lm" and fun(start[free]).size < free.size:
            continue
        bounds = {} if method == "lm" else {"bounds": (low[free], high[free])}
        at = start[free]
        if method == "trf":  # it wants a start strictly inside
            room = np.minimum(1e-10 * np.maximum(1.0, np.abs(at)), 0.25 * (high[free] - low[free]))
            at = np.clip(at, low[free] + room, high[free] - room)
        with np.errstate(all="ignore"):
            solved = least_squares(
                fun,
                at,
                jac,
                method=method,
                x_scale="jac",
                ftol=1e-13,
                xtol=1e-13,
                gtol=1e-13,
                max_nfev=evaluations,
                **bounds,
            )
        if (solved.x >= low[free]).all() and (solved.x <= high[free]).all():
            found.append(2.0 * float(solved.cost))
    return min(found)


def trf_within(residual: Callable, jacobian: Callable, start: np.ndarray, low: np.ndarray, high: np.ndarray):
    """SciPy's result by "trf" from `start`, within bounds between which it lies; what has equal bounds is held."""
    start = np.asarray(start)
    free = np.flatnonzero(low < high)
    whole = lambda x: _filled(start, free, x)
    fun, jac = lambda x: np.asarray(residual(whole(x))), lambda x: np.asarray(jacobian(whole(x)))[:, free]
    bounds = low[free], high[free]
    return least_squares(
        fun, start[free], jac, bounds, "trf", ftol=1e-15, xtol=1e-15, gtol=1e-15, x_scale="jac", max_nfev=2000
    )


def _filled(start, free, x):
    whole = np.array(start)
    whole[free] = x
    return whole
