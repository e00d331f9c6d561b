"""How a step of the table ends, as a function of its begin and of the system: to first order, and to second.

To first order (`end_to_first_order`) the step's end moves along the field by as much as its event or its corner does;
what the field does after the switch follows in the next step.  To second order (`end_to_second_order`) it moves along
the motion itself.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from ..core import Count, Scalar, Truth
from .step_table import Row, read
from .system import SETTLED, AbstractHybridSystem, InputSegment, State, has_guards, unflattener

_SMALL = 1e-11
"""Amplitude [m] of a motion from whose events derivatives are carried back to a fixed time."""


def exact_end(system: AbstractHybridSystem, row: Float[Array, " columns"], x: list[Scalar]) -> list[Scalar]:
    """Where the polynomials of a step lead, with what is known in closed form put right."""
    step, unflatten = read(row), unflattener(system)
    segment, begin = system.segment(step.index), unflatten(step.begin)
    return jax.tree.leaves(system.exact(segment, step.t_local, begin, step.duration, unflatten(x)))


class Shift(NamedTuple):
    """The shift of the end of a step with the parameters."""

    time: Scalar
    """Zero in value, the derivative of the event's or of the corner's time [s]."""
    is_carried_back: Truth
    """Whether it is an event at whose moving time derivatives are not left."""


def event_shift_of(system: AbstractHybridSystem, row: Float[Array, " columns"], x: list[Scalar]) -> Shift:
    """The shift of the end `x` of a step with the time of its event or corner."""
    step = read(row)
    at, mode, which = step.at, step.mode, step.which
    end, segment = unflattener(system)(x), system.segment(step.index)

    def margin(event_shift: Scalar) -> Scalar:
        rates = system.field(segment, at + event_shift, end, mode)
        moved = jax.tree.map(lambda a, b: a + event_shift * b, end, rates)
        return _ending_guard(system, segment, at + event_shift, moved, mode, which)

    shift_of_event, is_carried_back = 0.0, jnp.zeros((), bool)
    if has_guards(system, segment, at, end, mode):
        gap, slope = jax.jvp(margin, (jnp.zeros_like(at),), (jnp.ones_like(at),))
        # At the first instant of a segment an event has no time of its own: it is there whatever the parameters, and
        # gap and slope may both be rounding (a contact at rest under a drive that begins with slope zero).
        located = step.event & (at > 0.0) & (slope != 0)
        is_carried_back = step.event & system.is_carried_back(slope, mode, which, _SMALL)
        slope = lax.stop_gradient(jnp.where(located, slope, 1.0))
        shift_of_event = jnp.where(located, -_tangent_only(gap) / slope, 0.0)
    shift_of_corner = _tangent_only(jnp.where(step.corner, segment.duration, 0.0) - at)
    shift = jnp.where(step.event, shift_of_event, jnp.where(step.corner, shift_of_corner, 0.0))
    return Shift(shift, is_carried_back)


def _ending_guard(
    system: AbstractHybridSystem, segment: InputSegment, t_local: Scalar, x: State, mode: Scalar, which: Count
) -> Scalar:
    """The guard number `which`; of two, the one that is lower."""
    guards = [jnp.asarray(guard, float) for guard in system.guards(segment, t_local, x, mode)]
    return jnp.minimum(*guards) if len(guards) == 2 else jnp.stack(guards)[which]


def end_to_first_order(
    system: AbstractHybridSystem, row: Float[Array, " columns"], x: list[Scalar], shift: Shift
) -> Float[Array, " begin"]:
    """The end (origin, after, x) of a step of the table, given where it leads and how its end moves.

    The value is that of the forward pass to rounding; the derivatives are those of the true flow, with the end of
    the step moving as the event or the corner does.  From events of a small motion, and of a law's own, they are
    carried back to the time of the table: left at the moving time, what is continuous there moves by its rate times a
    shift that grows without bound as a ringing dies out, or as a guard comes slowly to zero, and rounding of that would
    drown the derivatives.  At other reversals they are left there: carried back, they would hold the phase of the
    ringing, with the error that steps make of it.
    """
    step, unflatten = read(row), unflattener(system)
    at, mode, end, segment = step.at, step.mode, unflatten(x), system.segment(step.index)
    before = rates_at_end(system, segment, step.t_local, unflatten(step.begin), step.duration, end, mode)
    moved = jax.tree.map(lambda a, b: a + shift.time * b, end, before)

    def carried_back(follows: State, following: Scalar) -> State:
        after = rates_at_end(system, segment, at, follows, jnp.zeros_like(at), follows, following)
        back = lambda x, f, m, y, g: x + shift.time * (f - g) + (y - m)
        return jax.tree.map(back, end, before, moved, follows, after)

    return _next_begin(system, step, segment, moved, shift, carried_back)


def _next_begin(
    system: AbstractHybridSystem,
    step: Row,
    segment: InputSegment,
    moved: State,
    shift: Shift,
    carried_back: Callable[[State, Scalar], State],
) -> Float[Array, " begin"]:
    """What follows on a step that ends in the state `moved`, after its event or corner: (origin, local time, state).

    **Arguments:** `carried_back` takes state and mode after an event back to the time of the table.
    """
    at, later = step.at, step.at + shift.time
    follows, following, events = moved, step.mode, has_guards(system, segment, at, moved, step.mode)
    if events:
        switched, following = system.after_event(segment, later, moved, step.mode, step.which)
        follows = _either(step.event, switched, moved)
        following = jnp.where(step.event, following, step.mode)
    follows = _either(step.becomes_settled, system.project_to_steady(segment, later, follows, following), follows)
    if events:
        following = jnp.where(step.becomes_settled, SETTLED, following)
        follows = _either(shift.is_carried_back, carried_back(follows, following), follows)
        later = jnp.where(shift.is_carried_back, at, later)
    if system.resets_at_corners:
        started, _ = system.on_segment_start(system.segment(step.index + 1.0), follows, step.mode)
        follows = _either(step.corner, started, follows)
    origin = step.origin + jnp.where(step.corner, segment.duration, 0.0)
    return jnp.stack([origin, jnp.where(step.corner, 0.0, later), *jax.tree.leaves(follows)])


def _either(condition: Truth, new: State, old: State) -> State:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), new, old)


def rates_at_end(
    system: AbstractHybridSystem,
    segment: InputSegment,
    t_local: Scalar,
    begin: State,
    duration: Scalar,
    end: State,
    mode: Scalar,
) -> State:
    """How the state changes with time at the end of a step, without derivatives of its own.

    What is known in closed form goes on moving where all else has settled (a platform that still rings under a
    stuck contact), and the field of that mode leaves it out.
    """
    rates = system.field(segment, t_local + duration, end, mode)

    def later(shift: Scalar) -> State:
        moved = jax.tree.map(lambda a, b: a + shift * b, end, rates)
        return system.exact(segment, t_local, begin, duration + shift, moved)

    exact = jax.jvp(later, (jnp.zeros_like(duration),), (jnp.ones_like(duration),))[1]
    # Elsewhere the field has them, too, and bit for bit the same before an event and after it.
    return lax.stop_gradient(jax.tree.map(lambda a, b: jnp.where(mode == SETTLED, a, b), exact, rates))


def _tangent_only(x: Scalar) -> Scalar:
    """Zero in value, `x` in derivative."""
    return x - lax.stop_gradient(x)


def end_to_second_order(
    system: AbstractHybridSystem, row: Float[Array, " columns"], polynomials: Float[Array, "components coefficients"]
) -> Float[Array, " begin"]:
    """The end of a step, right to the second derivative: it moves along the motion, not along its tangent.

    The shift of its time is zero in value, so that second order adds one term in its square: x''/2 to the motion, and
    -g''/(2 g') to the time of an event with the margin g.
    """
    step, unflatten = read(row), unflattener(system)
    segment, begin, mode, which = system.segment(step.index), unflatten(step.begin), step.mode, step.which
    value, rate, bend_of_motion = (_derivative_at(polynomials, step.duration, order) for order in range(3))

    def motion(shift: Scalar) -> State:
        x = value + shift * (rate + 0.5 * shift * bend_of_motion)
        end = unflatten([x[i] for i in range(len(x))])
        return system.exact(segment, step.t_local, begin, step.duration + shift, end)

    def margin(shift: Scalar) -> Scalar:
        return _ending_guard(system, segment, step.at + shift, motion(shift), mode, which)

    still, one = jnp.zeros_like(step.duration), jnp.ones_like(step.duration)
    moves = jnp.where(step.corner, segment.duration, 0.0) - step.t_local
    shift = jnp.where(step.corner, _tangent_only(moves), 0.0)
    events = has_guards(system, segment, step.at, motion(still), mode)
    is_carried_back = jnp.zeros((), bool)
    if events:
        with_slope = lambda shift: jax.jvp(margin, (shift,), (one,))
        (gap, slope), (_, bend) = jax.jvp(with_slope, (still,), (one,))
        located = step.event & (step.at > 0.0) & (slope != 0)
        is_carried_back = step.event & system.is_carried_back(lax.stop_gradient(slope), mode, which, _SMALL)
        tangent = -jnp.where(located, _tangent_only(gap), 0.0) / jnp.where(located, slope, 1.0)
        bent = lax.stop_gradient(jnp.where(located, 0.5 * bend / slope, 0.0))
        shift = jnp.where(located, tangent - bent * tangent**2, shift)
    carried_back = lambda follows, following: _carried_back(system, segment, step.at + shift, follows, shift, following)
    return _next_begin(system, step, segment, motion(shift), Shift(shift, is_carried_back), carried_back)


def _derivative_at(
    polynomials: Float[Array, "components coefficients"], time: Scalar, order: int
) -> Float[Array, " components"]:
    """Derivatives of some order of polynomials at a `time` that does not move."""
    count = polynomials.shape[1]
    factors = np.array([np.prod(np.arange(k - order + 1.0, k + 1.0)) for k in range(order, count)])
    powers = jnp.power(time, np.arange(count - order))
    return jnp.sum(polynomials[:, order:] * (factors * powers), axis=1)


def _carried_back(
    system: AbstractHybridSystem, segment: InputSegment, t_local: Scalar, x: State, shift: Scalar, mode: Scalar
) -> State:
    """The state `shift` [s] before the local time at which it is `x`, to second order: the midpoint rule."""
    rates = lambda t, x: system.field(segment, t, x, mode)
    halfway = jax.tree.map(lambda a, b: a - 0.5 * shift * b, x, rates(t_local, x))
    before = jax.tree.map(lambda a, b: a - shift * b, x, rates(t_local - 0.5 * shift, halfway))
    return system.exact(segment, t_local, x, -shift, before)
