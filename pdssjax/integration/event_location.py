"""Where in a step a guard first falls through zero.

The guard is a polynomial in the time elapsed since the step's begin, one kernel of plain arithmetic: no loop,
no branch.
"""

from collections.abc import Callable, Sequence
from typing import TypeAlias

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..core import Scalar, Truth
from .taylor_series import Series
from .tracing import choose, plus, times

Guards: TypeAlias = Float[Array, " guards"]
"""One number for each guard: all of them are examined at once, as one vector."""

Place: TypeAlias = tuple[Guards, Guards, Guards]
"""A time [s], and the value and the slope [1/s] that each guard has there."""

LOOK_AHEAD = 1e-9
"""Time [s] by which a tie is broken, far below every time constant: the changes of a guard within it are rounding."""

_SAMPLES = 6
"""Intervals of a step at whose ends the sign of the guard is examined."""

_ITERATIONS = 3
"""Iterations that locate an event within its bracket, to rounding, but where a guard is nearly flat."""

_ROUNDING = 1e-12
"""A guard falls at once if its first value is no more than this part of its depth at the first sample, and it hardly
rises before its root: the time of such an event would be decided by rounding."""

_RISES = 1e3
"""Multiple of that rounding above which the guard halfway to the root counts as having risen."""

_LOCATED = 1e-8
"""A root counts as located to rounding if its last iteration moved it by no more than this part of the step."""

_ADVANCE = 1e-5
"""Least part of a step that is kept where its event could not be located."""

_CUBIC = 5
"""Iterations for the first guess, the root of the cubic through values and slopes at the ends of the bracket."""


def first_crossing(guards: tuple[Series, ...], size: int, step_size: Scalar) -> tuple[Scalar, Truth, Scalar]:
    """When the step ends: the first time [s] at which a guard has fallen through zero, or else `step_size` [s].

    **Arguments:** the guards as series in the time since the step's begin, of which `size` coefficients count.

    **Returns:** that time; whether a guard falls there; and which.  Where a guard is so flat that its root is not
    located yet, the time is a little before it and none falls: the next step begins there.

    Right after an event a guard starts from zero: one power of the time is then divided out, and with it the root at
    the start.  Where the quotient starts below zero by rounding only, and is above it within `LOOK_AHEAD`, one or two
    more powers are.  The end of the step itself is no crossing.
    """
    if not guards:
        return step_size, jnp.zeros((), bool), jnp.zeros(())
    # As one vector: one kernel for all guards, and half the code to compile.
    coefficients = [jnp.stack([jnp.asarray(guard[k], float) for guard in guards]) for k in range(size)]
    crossings = _crossing(_Deflated(coefficients), step_size)
    distances = jnp.abs(crossings)
    first = distances.min()
    falls = first <= step_size
    end = choose(falls, jnp.minimum(first, (1.0 - 1e-15) * step_size), step_size)
    return end, falls & ~((crossings == -first) & (crossings < 0.0)).any(), jnp.argmin(distances) * 1.0


class _Deflated:
    """Guards with their roots at the start of the step divided out, a power of the time for each.

    Horner's scheme gives them without a division: its second rung is the polynomial without its lowest coefficient,
    divided by the time.
    """

    def __init__(self, coefficients: Sequence[Guards]):
        missing = [0.0 * coefficients[0]] * max(0, 6 - len(coefficients))
        self._coefficients = [*coefficients, *missing]
        none, once, twice, thrice = self._coefficients[:4]
        self.begins_at_zero = none <= 0.0
        short, soon = self.begins_at_zero & (once <= 0.0), 2.0 * LOOK_AHEAD
        self._rises = short & (twice > 0.0) & (-once <= soon * twice)
        self._bends = short & ~self._rises & (thrice > 0.0) & (once + soon * (twice + soon * thrice) > 0.0)

    def _of(self, rungs: Sequence[Guards]) -> Guards:
        """The rung for the order of each guard's root at 0, which is 0 to 3."""
        none, once, twice, thrice = rungs[:4]
        return choose(self._bends, thrice, choose(self._rises, twice, choose(self.begins_at_zero, once, none)))

    def coefficient(self, k: int) -> Guards:
        """Coefficient k, up to 2."""
        return self._of(self._coefficients[k:])

    def value(self, time: Guards) -> Guards:
        """Values at a `time`."""
        return self.expansion(time, 1)[0]

    def value_and_slope(self, time: Guards) -> tuple[Guards, Guards]:
        """Values and slopes at a `time`."""
        value, slope = self.expansion(time, 2)
        return value, slope

    def expansion(self, time: Guards, count: int) -> list[Guards]:
        """Value, slope and half the second derivative at a `time`: the first `count` of them."""
        rungs, found = self._coefficients, []
        for _ in range(count):
            rungs = _ladder(rungs, time)
            found.append(self._of(rungs))
            rungs = rungs[1:]
        return found


def _ladder(coefficients: Sequence[Guards], time: Guards) -> list[Guards]:
    """Horner's scheme, lowest rung first."""
    rungs = [coefficients[-1]]
    for coefficient in coefficients[-2::-1]:
        rungs.append(plus(times(rungs[-1], time), coefficient))
    return rungs[::-1]


def _crossing(g: _Deflated, step_size: Scalar) -> Guards:
    """The first root [s] within the step, or infinity; where it is not located, minus a time before it.

    Samples bracket the root, and Newton's method, kept within the bracket, finds it.
    A guard may also dip below zero between two samples and come back.  It then has a minimum there,
    and the root lies before it, about where the parabola through the minimum crosses zero.
    """
    value, rate, bend = (g.coefficient(k) for k in range(3))
    samples = [jnp.full_like(value, i / _SAMPLES) * step_size for i in range(_SAMPLES + 1)]
    places = [(samples[0], value, rate), *((time, *g.value_and_slope(time)) for time in samples[1:])]
    found, ends, dips, dip = _bracket(places)
    # A root may also lie on a sample; then it is found there.
    bottom, half_bend = _minimum(g, *dip)
    g_bottom = g.value(bottom)
    falls = dips & (g_bottom < 0.0)
    parabola = bottom - jnp.sqrt(jnp.maximum(-g_bottom, 0.0) / choose(half_bend > 0.0, half_bend, jnp.inf))
    (low, _, _), (high, _, _) = ends
    low, high = choose(falls, dip[0][0], low), choose(falls, bottom, high)
    root = choose(falls, jnp.clip(parabola, low, high), _cubic_root(*ends))
    # A guard that begins near zero, without a slope or rising, falls soon: samples are too coarse for its parabola.
    soon = _parabola_root(value, rate, bend)
    early = (soon > 0.0) & (2.0 * soon < samples[1]) & (g.value(2.0 * soon) < 0.0)
    found |= early
    nearer = (root > 2.0 * soon) | (jnp.abs(g.value(soon)) < jnp.abs(g.value(root)))
    low, high, root = choose(early, 0.0, low), choose(early, 2.0 * soon, high), choose(early & nearer, soon, root)
    begin = low
    root, moved = _newton(g.value_and_slope, root, low, high, _ITERATIONS)
    rounding = -_ROUNDING * places[1][1]
    rises = (value >= 0.0) & (g.value(0.5 * root) > _RISES * rounding)
    at_once = (rounding > 0.0) & (value <= rounding) & ~rises
    # The step ends halfway to the root, where the guard is so large that the next step cannot take it for zero.
    halfway = 0.5 * (begin + root)
    located = (moved <= _LOCATED * step_size) | (halfway <= _ADVANCE * step_size)
    return choose(found | falls, choose(at_once, 0.0, choose(located, root, -halfway)), jnp.inf)


def _bracket(
    places: Sequence[Place],
) -> tuple[Bool[Array, " guards"], tuple[Place, Place], Bool[Array, " guards"], tuple[Place, Place]]:
    """Whether a guard is negative at a sample, and the first interval that ends with such a sample.

    Then the same for an earlier interval that may hide a dip below zero: at its ends the guard is positive, it falls at
    the first and rises at the second, and the two tangents meet below zero.
    """
    before = low = high = dip_low = dip_high = places[0]
    found = dips = jnp.zeros_like(before[0], bool)
    for now in places[1:]:
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
    square, cube = 3.0 * fall - 2.0 * a - b, a + b - 2.0 * fall

    def cubic(u: Guards) -> tuple[Guards, Guards]:
        return value + u * (a + u * (square + u * cube)), a + u * (2.0 * square + u * (3.0 * cube))

    u = value / choose(fall < 0.0, -fall, 1.0)
    u, _ = _newton(cubic, u, jnp.zeros_like(value), jnp.ones_like(value), _CUBIC)
    return begin + u * length


def _parabola_root(value: Guards, rate: Guards, bend: Guards) -> Guards:
    """Where value + rate t + bend t^2 falls through zero; 0 where it does not."""
    root = jnp.sqrt(jnp.maximum(rate * rate - 4.0 * bend * value, 0.0))
    steep = 2.0 * value / choose(root > rate, root - rate, jnp.inf)
    return choose(rate < 0.0, steep, (rate + root) / choose(bend < 0.0, -2.0 * bend, jnp.inf))


def _newton(
    at: Callable[[Guards], tuple[Guards, Guards]], root: Guards, low: Guards, high: Guards, iterations: int
) -> tuple[Guards, Guards]:
    """The root between `low` and `high` of a function that falls there, and how far the last iteration moved it.

    **Arguments:** `at` gives value and slope at a time; `root` is the first guess.
    """
    # A value that a kernel computes twice may differ by rounding, so that a converged step may leave the bracket.
    moved, slack = root, _ROUNDING * (high - low)
    for _ in range(iterations):
        value, rate = at(root)
        low, high = choose(value > 0.0, root, low), choose(value > 0.0, high, root)
        newton = root - value / choose(rate < 0.0, rate, -1.0)
        inside = (newton >= low - slack) & (newton <= high + slack)
        closer = choose((rate < 0.0) & inside, newton, 0.5 * (low + high))
        moved, root = jnp.abs(closer - root), closer
    return root, moved


def _minimum(g: _Deflated, low: Place, high: Place) -> tuple[Guards, Guards]:
    """Where the slope rises through zero between the ends, and about half the second derivative there.

    The first guess takes the slope for the parabola with the slopes of the two ends and the guard's fall as integral.
    """
    (begin, value, rate), (end, value_end, rate_end) = low, high
    length = end - begin
    a, b, fall = rate * length, rate_end * length, value_end - value
    # a + 2 (3 fall - 2 a - b) u + 3 (a + b - 2 fall) u^2, between a < 0 and b > 0.
    half, square = 3.0 * fall - 2.0 * a - b, 3.0 * (a + b - 2.0 * fall)
    denominator = half + jnp.sqrt(jnp.maximum(half * half - a * square, 0.0))
    u = -a / choose(denominator > 0.0, denominator, 1.0)
    near = begin + jnp.clip(u, 0.0, 1.0) * length
    _, slope, half_bend = g.expansion(near, 3)
    # Once is enough: an error e hides a dip no deeper than e^2 times the bend.
    return jnp.clip(near - slope / choose(half_bend > 0.0, 2.0 * half_bend, jnp.inf), begin, end), half_bend


def _either(condition: Bool[Array, " guards"], new: Place, old: Place) -> Place:
    first, second, third = (choose(condition, a, b) for a, b in zip(new, old, strict=True))
    return first, second, third
