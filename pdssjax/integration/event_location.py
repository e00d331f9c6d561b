"""Where in a step a guard first falls through zero.

The guard is a polynomial in theta = elapsed/step_radius, one kernel of plain arithmetic: no loop,
no branch.
"""

from typing import TypeAlias

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..core import Scalar, ScalarLike
from .polynomials import horner
from .taylor_series import Series
from .traced_arithmetic import choose, times

Guards: TypeAlias = Float[Array, " guards"]
"""One number a guard: the guards are looked at side by side."""

Place: TypeAlias = tuple[ScalarLike | Guards, Guards]
"""A theta and the value, or the slope, that each guard has there."""

LOOK_AHEAD = 1e-9
"""Time [s] by which a tie is broken: far below every time constant.  What a guard does within it is rounding."""

_SAMPLES = 6
"""Points of a step at which the sign of the guard is looked at."""

_ITERATIONS = 14
"""Iterations that locate an event within its bracket, to rounding."""

_REFINEMENTS = 4
"""Iterations that locate the bottom of a dip: an error e there hides a dip no deeper than e^2 times the bend."""


def first_crossing(guards: tuple[Series, ...], size: int, step_radius: Scalar) -> tuple[Scalar, Scalar]:
    """The first theta in (0, 1] at which one of the guards has fallen through zero, else 1; and which.

    Right after an event a guard starts from zero; one power of theta is then divided out,
    which takes the root at the start away.  Where what is left falls short of zero by rounding,
    and is above it within `LOOK_AHEAD`, one more is.  An end point of exactly 1 is no crossing.
    """
    if not guards:
        return jnp.ones(()), jnp.zeros(())
    # Side by side: one kernel for all guards, and half the code to compile.
    sides = [jnp.stack([jnp.asarray(guard[k], float) for guard in guards]) for k in range(size)]
    crossings = _crossing(sides, LOOK_AHEAD / choose(step_radius > 0, step_radius, 1.0))
    first = crossings.min()
    return choose(first > 1.0, 1.0, jnp.minimum(first, 1.0 - 1e-15)), jnp.argmin(crossings) * 1.0


def _crossing(coefficients: list[Guards], ahead: Scalar) -> Guards:
    """The first root in (0, 1], or 2: bracketed by samples, then Newton's method, kept within the bracket.

    A guard may also dip below zero between two samples and come back.  It then has a minimum there,
    and the root lies before it, about where the parabola through the minimum crosses zero.
    """
    starts_at_zero = coefficients[0] <= 0.0
    once = [*coefficients[1:], 0.0 * coefficients[0]]
    twice = [*once[1:], once[-1]]
    slack = starts_at_zero & (once[0] <= 0.0) & (-once[0] <= 2.0 * ahead * once[1])
    g = [
        choose(slack & (once[1] > 0.0), c, choose(starts_at_zero, b, a))
        for a, b, c in zip(coefficients, once, twice, strict=True)
    ]
    slope = _slope(g)
    found, (low, g_low), (high, g_high), dips, dip = _bracket(g, slope)
    # A root may also lie on a sample exactly; then it is found there.
    at_once = (g[0] <= 0.0) & (horner(g, 1 / _SAMPLES) < 0.0)
    bottom = _minimum(slope, *dip)
    g_bottom = horner(g, bottom)
    falls = dips & (g_bottom < 0.0)
    secant = low + g_low * (high - low) / choose(g_low > g_high, g_low - g_high, 1.0)
    low, high = choose(falls, dip[0][0], low), choose(falls, bottom, high)
    bend = horner(_slope(slope), bottom)
    parabola = bottom - jnp.sqrt(2.0 * jnp.maximum(-g_bottom, 0.0) / choose(bend > 0.0, bend, jnp.inf))
    root = choose(falls, jnp.clip(parabola, low, high), secant)
    for _ in range(_ITERATIONS):
        value = horner(g, root)
        low, high = choose(value > 0.0, root, low), choose(value > 0.0, high, root)
        rate = horner(slope, root)
        newton = root - value / choose(rate < 0.0, rate, -1.0)
        root = choose((rate < 0.0) & (newton >= low) & (newton <= high), newton, 0.5 * (low + high))
    return choose(found | falls, choose(at_once, 0.0, root), 2.0)


def _bracket(
    g: list[Guards], slope: list[Guards]
) -> tuple[Bool[Array, " guards"], Place, Place, Bool[Array, " guards"], tuple[Place, Place]]:
    """The first of the samples at which `g` is negative, and the one before, each with its value.

    And the first interval before it at whose ends `g` is positive but which may hide a dip below zero:
    falling at its begin, rising at its end, and the two tangents meet below zero; each end with its slope.
    """
    before, g_before, s_before = 0.0, g[0], slope[0]
    found = dips = jnp.zeros_like(g[0], bool)
    low = high = dip_low = dip_high = (before, g_before)
    for i in range(1, _SAMPLES + 1):
        at = i / _SAMPLES
        value, rate = horner(g, at), horner(slope, at)
        meet_below = g_before * rate - value * s_before + s_before * rate * (at - before) < 0.0
        dip = ~found & ~dips & (value >= 0.0) & (s_before < 0.0) & (rate > 0.0) & meet_below
        dip_low = _either(dip, (before, s_before), dip_low)
        dip_high = _either(dip, (at, rate), dip_high)
        hit = ~found & (value < 0.0)
        low, high = _either(hit, (before, g_before), low), _either(hit, (at, value), high)
        found, dips, before, g_before, s_before = found | hit, dips | dip, at, value, rate
    return found, low, high, dips, (dip_low, dip_high)


def _minimum(slope: list[Guards], low: Place, high: Place) -> Guards:
    """Where the slope rises through zero between the ends (theta, slope)."""
    bend = _slope(slope)
    (begin, s_begin), (end, s_end) = low, high
    inverse = (end - begin) / choose(s_end > s_begin, s_end - s_begin, 1.0)
    bottom = begin - s_begin * inverse
    for _ in range(_REFINEMENTS):
        inverse = inverse * (2.0 - horner(bend, bottom) * inverse)
        bottom = jnp.clip(bottom - horner(slope, bottom) * inverse, begin, end)
    return bottom


def _slope(coefficients: list[Guards]) -> list[Guards]:
    return [times(float(k), c) for k, c in enumerate(coefficients)][1:]


def _either(condition: Bool[Array, " guards"], new: Place, old: Place) -> Place:
    return choose(condition, new[0], old[0]), choose(condition, new[1], old[1])
