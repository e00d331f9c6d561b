"""Where in a step a guard first falls through zero.

The guard is a polynomial in theta = elapsed/step_radius, one kernel of plain arithmetic: no loop,
no branch.
"""

from typing import TypeAlias

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..core import Scalar, Truth
from .polynomials import horner
from .taylor_series import Series
from .traced_arithmetic import choose, times

Guards: TypeAlias = Float[Array, " guards"]
"""One number a guard: the guards are looked at side by side."""

Place: TypeAlias = tuple[Guards, Guards, Guards]
"""A theta, and the value and the slope that each guard has there."""

LOOK_AHEAD = 1e-9
"""Time [s] by which a tie is broken: far below every time constant.  What a guard does within it is rounding."""

_SAMPLES = 6
"""Points of a step at which the sign of the guard is looked at."""

_ITERATIONS = 3
"""Iterations that locate an event within its bracket, to rounding, but where a guard is nearly flat."""

_LOCATED = 1e-8
"""A theta whose last iteration moved it by no more is located to rounding."""

_ADVANCE = 1e-5
"""A step that ends before an event which is not located is at least so long."""

_CUBIC = 5
"""Iterations of their first guess, by values and slopes at the ends of the bracket alone."""

_REFINEMENTS = 1
"""Iterations that locate the bottom of a dip: an error e there hides a dip no deeper than e^2 times the bend."""


def first_crossing(guards: tuple[Series, ...], size: int, step_radius: Scalar) -> tuple[Scalar, Truth, Scalar]:
    """Where the step ends: the first theta in (0, 1] at which a guard has fallen through zero, else 1.

    **Returns:** theta; whether a guard falls there; and which.  Where a guard is so flat that its root is not
    located yet, theta is a little before it and none falls: the next step begins there.

    Right after an event a guard starts from zero; one power of theta is then divided out,
    which takes the root at the start away.  Where what is left falls short of zero by rounding,
    and is above it within `LOOK_AHEAD`, one or two more are.  An end point of exactly 1 is no crossing.
    """
    if not guards:
        return jnp.ones(()), jnp.zeros((), bool), jnp.zeros(())
    # Side by side: one kernel for all guards, and half the code to compile.
    sides = [jnp.stack([jnp.asarray(guard[k], float) for guard in guards]) for k in range(size)]
    crossings = _crossing(sides, LOOK_AHEAD / choose(step_radius > 0, step_radius, 1.0))
    distances = jnp.abs(crossings)
    first = distances.min()
    end = choose(first > 1.0, 1.0, jnp.minimum(first, 1.0 - 1e-15))
    return end, (end < 1.0) & ~((crossings == -first) & (crossings < 0.0)).any(), jnp.argmin(distances) * 1.0


def _crossing(coefficients: list[Guards], ahead: Scalar) -> Guards:
    """The first root in [0, 1], or 2; where it is not located, a theta before it, with the sign reversed.

    It is bracketed by samples; then Newton's method, kept within the bracket.
    A guard may also dip below zero between two samples and come back.  It then has a minimum there,
    and the root lies before it, about where the parabola through the minimum crosses zero.
    """
    starts_at_zero = coefficients[0] <= 0.0
    once = [*coefficients[1:], 0.0 * coefficients[0]]
    twice = [*once[1:], 0.0 * once[0]]
    thrice = [*twice[1:], 0.0 * once[0]]
    short = starts_at_zero & (once[0] <= 0.0)
    rises = short & (twice[0] > 0.0) & (-once[0] <= 2.0 * ahead * twice[0])
    bends = short & ~rises & (thrice[0] > 0.0) & (once[0] + 2.0 * ahead * (twice[0] + 2.0 * ahead * thrice[0]) > 0.0)
    g = [
        choose(bends, d, choose(rises, c, choose(starts_at_zero, b, a)))
        for a, b, c, d in zip(coefficients, once, twice, thrice, strict=True)
    ]
    slope = _slope(g)
    found, ends, dips, dip = _bracket(g, slope)
    # A root may also lie on a sample exactly; then it is found there.
    at_once = (g[0] <= 0.0) & (horner(g, 1 / _SAMPLES) < 0.0)
    bottom = _minimum(slope, *dip)
    g_bottom = horner(g, bottom)
    falls = dips & (g_bottom < 0.0)
    bend = horner(_slope(slope), bottom)
    parabola = bottom - jnp.sqrt(2.0 * jnp.maximum(-g_bottom, 0.0) / choose(bend > 0.0, bend, jnp.inf))
    (low, _, _), (high, _, _) = ends
    low, high = choose(falls, dip[0][0], low), choose(falls, bottom, high)
    root = choose(falls, jnp.clip(parabola, low, high), _cubic_root(*ends))
    # One that begins near zero without a slope, or rising, falls at once, as a parabola that samples are too far for.
    soon = _parabola_root(*g[:3])
    early = (soon > 0.0) & (2.0 * soon < 1 / _SAMPLES) & (horner(g, 2.0 * soon) < 0.0)
    found |= early
    nearer = (root > 2.0 * soon) | (jnp.abs(horner(g, soon)) < jnp.abs(horner(g, root)))
    low, high, root = choose(early, 0.0, low), choose(early, 2.0 * soon, high), choose(early & nearer, soon, root)
    begin = low
    root, moved = _newton(g, slope, root, low, high, _ITERATIONS)
    # Halfway, where the guard is far from what the next step would take for zero.
    halfway = 0.5 * (begin + root)
    root = choose((moved > _LOCATED) & (halfway > _ADVANCE), -halfway, root)
    return choose(found | falls, choose(at_once, 0.0, root), 2.0)


def _bracket(
    g: list[Guards], slope: list[Guards]
) -> tuple[Bool[Array, " guards"], tuple[Place, Place], Bool[Array, " guards"], tuple[Place, Place]]:
    """The sample before the first at which `g` is negative, and that one.

    And the first interval before it at whose ends `g` is positive but which may hide a dip below zero:
    falling at its begin, rising at its end, and the two tangents meet below zero.
    """
    before: Place = (jnp.zeros_like(g[0]), g[0], slope[0])
    found = dips = jnp.zeros_like(g[0], bool)
    low = high = dip_low = dip_high = before
    for i in range(1, _SAMPLES + 1):
        at = jnp.full_like(g[0], i / _SAMPLES)
        now = at, horner(g, at), horner(slope, at)
        (start, value, rate), (end, value_then, rate_then) = before, now
        meet_below = value * rate_then - value_then * rate + rate * rate_then * (end - start) < 0.0
        dip = ~found & ~dips & (value_then >= 0.0) & (rate < 0.0) & (rate_then > 0.0) & meet_below
        dip_low, dip_high = _either(dip, before, dip_low), _either(dip, now, dip_high)
        hit = ~found & (value_then < 0.0)
        low, high = _either(hit, before, low), _either(hit, now, high)
        found, dips, before = found | hit, dips | dip, now
    return found, (low, high), dips, (dip_low, dip_high)


def _cubic_root(low: Place, high: Place) -> Guards:
    """Where the cubic with the values and slopes of the two ends falls through zero."""
    (begin, value, rate), (end, value_end, rate_end) = low, high
    length = end - begin
    a, b, fall = rate * length, rate_end * length, value_end - value
    cubic = [value, a, 3.0 * fall - 2.0 * a - b, a + b - 2.0 * fall]
    slope = _slope(cubic)
    u = value / choose(fall < 0.0, -fall, 1.0)
    u, _ = _newton(cubic, slope, u, jnp.zeros_like(value), jnp.ones_like(value), _CUBIC)
    return begin + u * length


def _parabola_root(value: Guards, rate: Guards, bend: Guards) -> Guards:
    """Where value + rate theta + bend theta^2 falls through zero; 0 where it does not."""
    root = jnp.sqrt(jnp.maximum(rate * rate - 4.0 * bend * value, 0.0))
    steep = 2.0 * value / choose(root > rate, root - rate, jnp.inf)
    return choose(rate < 0.0, steep, (rate + root) / choose(bend < 0.0, -2.0 * bend, jnp.inf))


def _newton(
    g: list[Guards], slope: list[Guards], root: Guards, low: Guards, high: Guards, iterations: int
) -> tuple[Guards, Guards]:
    """Where `g` falls through zero between `low` and `high`, and by how much the last of the iterations moved it."""
    moved = root
    for _ in range(iterations):
        value, rate = horner(g, root), horner(slope, root)
        low, high = choose(value > 0.0, root, low), choose(value > 0.0, high, root)
        newton = root - value / choose(rate < 0.0, rate, -1.0)
        closer = choose((rate < 0.0) & (newton >= low) & (newton <= high), newton, 0.5 * (low + high))
        moved, root = jnp.abs(closer - root), closer
    return root, moved


def _minimum(slope: list[Guards], low: Place, high: Place) -> Guards:
    """Where the slope rises through zero between the ends.

    From the parabola that has its two ends' slopes, and under it what the guard falls.
    """
    bend = _slope(slope)
    (begin, value, rate), (end, value_end, rate_end) = low, high
    length = end - begin
    a, b, fall = rate * length, rate_end * length, value_end - value
    # a + 2 (3 fall - 2 a - b) u + 3 (a + b - 2 fall) u^2, between a < 0 and b > 0.
    half, square = 3.0 * fall - 2.0 * a - b, 3.0 * (a + b - 2.0 * fall)
    denominator = half + jnp.sqrt(jnp.maximum(half * half - a * square, 0.0))
    u = -a / choose(denominator > 0.0, denominator, 1.0)
    bottom = begin + jnp.clip(u, 0.0, 1.0) * length
    for _ in range(_REFINEMENTS):
        curve = horner(bend, bottom)
        bottom = jnp.clip(bottom - horner(slope, bottom) / choose(curve > 0.0, curve, jnp.inf), begin, end)
    return bottom


def _slope(coefficients: list[Guards]) -> list[Guards]:
    return [times(float(k), c) for k, c in enumerate(coefficients)][1:]


def _either(condition: Bool[Array, " guards"], new: Place, old: Place) -> Place:
    first, second, third = (choose(condition, a, b) for a, b in zip(new, old, strict=True))
    return first, second, third
