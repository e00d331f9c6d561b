"""Where in a step a guard first falls through zero.

The guard is a polynomial in theta = lapse/reach, one kernel of plain arithmetic: no loop,
no branch.
"""

from typing import Any

import jax.numpy as jnp

from .expansion import horner
from .series import Series

LOOK_AHEAD = 1e-9
"""Time [s] by which a tie is broken: far below every time constant.  What a guard does within it is rounding."""
_SAMPLES = 6
"""Points of a step at which the sign of the guard is looked at."""
_ITERATIONS = 8
"""Iterations that locate an event within its bracket, to rounding."""


def first_crossing(guards: tuple[Series, ...], size: int, reach: Any) -> tuple[Any, Any]:
    """The first theta in (0, 1] at which one of the guards has fallen through zero, else 1; and which.

    Right after an event a guard starts from zero; one power of theta is then divided out,
    which takes the root at the start away.  Where what is left falls short of zero by rounding,
    and is above it within `LOOK_AHEAD`, one more is.  An end point of exactly 1 is no crossing.
    """
    # Side by side: one kernel for all guards, and half the code to compile.
    sides = [jnp.stack([jnp.asarray(guard[k], float) for guard in guards]) for k in range(size)]
    ahead = LOOK_AHEAD / jnp.where(reach > 0, reach, 1.0)
    crossings = _crossing(sides, ahead)
    first = crossings.min()
    if len(guards) > 2:
        # The guard of a law may dip below zero for a moment just before the motion ends: look closer.
        until = jnp.where(first > 0.0, jnp.minimum(first, 1.0), 1.0)
        closer = _crossing([side * until**k for k, side in enumerate(sides)], ahead / until)
        crossings = jnp.where(closer < 1.0, closer * until, crossings)
        first = crossings.min()
    return jnp.where(first > 1.0, 1.0, jnp.minimum(first, 1.0 - 1e-15)), jnp.argmin(crossings) * 1.0


def _crossing(coefficients: list, ahead: Any) -> Any:
    """The first root in (0, 1], or 2: bracketed by samples, then Newton's method.

    The slope is inverted by Newton's method as well (r <- r (2 - g' r)): without a
    division the compiler makes one kernel of it all.
    """
    fresh = coefficients[0] <= 0.0
    once = [*coefficients[1:], 0.0 * coefficients[0]]
    twice = [*once[1:], once[-1]]
    slack = fresh & (once[0] <= 0.0) & (-once[0] <= 2.0 * ahead * once[1])
    g = [
        jnp.where(slack & (once[1] > 0.0), c, jnp.where(fresh, b, a))
        for a, b, c in zip(coefficients, once, twice, strict=True)
    ]
    slope = [k * c for k, c in enumerate(g)][1:]
    low, g_low, high, g_high = 0.0, g[0], 1.0, g[0]
    found, before, g_before = jnp.zeros_like(fresh), low, g_low
    for i in range(1, _SAMPLES + 1):
        value = horner(g, i / _SAMPLES)
        hit = ~found & (value < 0.0)
        low, g_low = jnp.where(hit, before, low), jnp.where(hit, g_before, g_low)
        high, g_high = jnp.where(hit, i / _SAMPLES, high), jnp.where(hit, value, g_high)
        found, before, g_before = found | hit, i / _SAMPLES, value
    # A root may also lie on a sample exactly; then it is found there.
    at_once = (g[0] <= 0.0) & (horner(g, 1 / _SAMPLES) < 0.0)
    gap = jnp.where(g_low > g_high, g_low - g_high, 1.0)
    inverse = (low - high) / gap
    root = low - g_low * inverse
    for _ in range(_ITERATIONS):
        value = horner(g, root)
        low, high = jnp.where(value > 0.0, root, low), jnp.where(value > 0.0, high, root)
        inverse = inverse * (2.0 - horner(slope, root) * inverse)
        newton = root - value * inverse
        root = jnp.where((newton >= low) & (newton <= high), newton, 0.5 * (low + high))
    return jnp.where(found, jnp.where(at_once, 0.0, root), 2.0)
