"""Where functions of time change sign, to rounding."""

from collections.abc import Callable

import numpy as np
from scipy.optimize import brentq

EXACT = dict(xtol=1e-18, rtol=8.9e-16)
"""As near as doubles come."""


def crossing(f: Callable[[float], float], a: float, b: float) -> float:
    """The root of f between a and b; the end that is nearer to it where rounding leaves none."""
    at_a, at_b = f(a), f(b)
    if at_a * at_b > 0 or at_a == 0 or at_b == 0:
        return a if abs(at_a) < abs(at_b) else b
    return brentq(f, a, b, **EXACT)


def first_fall(f: Callable[[float], float], begin: float, end: float) -> float | None:
    """The first time on (begin, end] at which f falls through zero, as a grid dense at the begin finds it."""
    length = end - begin
    near, even = np.geomspace(1e-10, length, 600), np.linspace(0, length, 1500)
    times = np.unique(np.concatenate([[0.0], near, even])) + begin
    times[-1] = end
    before, last = begin, None
    for t in times:
        now = f(t)
        if last is not None and last > 0 >= now:
            return brentq(f, before, t, **EXACT)
        if last is None or now > 0 or now != last:
            before, last = t, now
    return None
