"""The end of a step of the table as a function of its start and of the system: right to first order, and to second.

To first order (`end_to_first_order`) the end moves along the field by as much as the time of its event or corner
shifts; the field after the switch enters in the next step.  To second order (`end_to_second_order`) it moves along
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
from .tracing import choose_each

_SMALL = 1e-11
"""Amplitude [m] of a motion below which derivatives are carried back from its events to a fixed time."""


def exact_end(system: AbstractHybridSystem, row: Float[Array, " columns"], x: list[Scalar]) -> list[Scalar]:
    """The end `x` of the polynomials of a step, with the components that are known in closed form replaced."""
    step, unflatten = read(row), unflattener(system)
    segment, begin = system.segment(step.index), unflatten(step.x)
    return jax.tree.leaves(system.exact(segment, step.t_local, begin, step.duration, unflatten(x)))


class Shift(NamedTuple):
    """How the parameters shift the end of a step."""

    time: Scalar
    """Zero in value; its derivative is that of the time of the event or corner [s]."""
    is_carried_back: Truth
    """Whether derivatives are carried back from the event, whose time shifts, to the fixed time of the table."""


def event_shift_of(system: AbstractHybridSystem, row: Float[Array, " columns"], x: list[Scalar]) -> Shift:
    """The shift of the end `x` of a step with the time of its event or corner."""
    step = read(row)
    at, mode, which = step.end, step.mode, step.which
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
    """Guard number `which`, or the lower one where there are two."""
    guards = [jnp.asarray(guard, float) for guard in system.guards(segment, t_local, x, mode)]
    return jnp.minimum(*guards) if len(guards) == 2 else jnp.stack(guards)[which]


def end_to_first_order(
    system: AbstractHybridSystem, row: Float[Array, " columns"], x: list[Scalar], shift: Shift
) -> Float[Array, " start"]:
    """The start of the next step (origin, local time, state), from the end `x` of a step and the `shift` of its time.

    The value is that of the forward pass to rounding; the derivatives are those of the true flow, whose event or
    corner shifts.  From events where `is_carried_back` holds, those of a small motion or of the law itself, derivatives
    are carried back to the time of the table: at the shifted time a state that is continuous there varies by its rate
    times the shift, which grows without bound as a ringing dies out, or as a guard comes slowly to zero, and its
    rounding would drown the derivatives.  From other reversals they are not: carried back, they would contain the phase
    of the ringing, with the error of the steps.
    """
    step, unflatten = read(row), unflattener(system)
    at, mode, end, segment = step.end, step.mode, unflatten(x), system.segment(step.index)
    before = rates_at_end(system, segment, step.t_local, unflatten(step.x), step.duration, end, mode)
    shifted = jax.tree.map(lambda a, b: a + shift.time * b, end, before)

    def carried_back(following: State, next_mode: Scalar) -> State:
        after = rates_at_end(system, segment, at, following, jnp.zeros_like(at), following, next_mode)
        back = lambda x, f, m, y, g: x + shift.time * (f - g) + (y - m)
        return jax.tree.map(back, end, before, shifted, following, after)

    return _next_start(system, step, segment, shifted, shift, carried_back)


def _next_start(
    system: AbstractHybridSystem,
    step: Row,
    segment: InputSegment,
    shifted: State,
    shift: Shift,
    carried_back: Callable[[State, Scalar], State],
) -> Float[Array, " start"]:
    """The start of the next step (origin, local time, state), after the event or corner of one that ends in `shifted`.

    **Arguments:** `carried_back` takes state and mode after an event back to the time of the table.
    """
    at, later = step.end, step.end + shift.time
    following, next_mode, events = shifted, step.mode, has_guards(system, segment, at, shifted, step.mode)
    if events:
        switched, next_mode = system.after_event(segment, later, shifted, step.mode, step.which)
        following = choose_each(step.event, switched, shifted)
        next_mode = jnp.where(step.event, next_mode, step.mode)
    projected = system.project_to_steady(segment, later, following, next_mode)
    following = choose_each(step.becomes_settled, projected, following)
    if events:
        next_mode = jnp.where(step.becomes_settled, SETTLED, next_mode)
        following = choose_each(shift.is_carried_back, carried_back(following, next_mode), following)
        later = jnp.where(shift.is_carried_back, at, later)
    if system.resets_at_corners:
        started, _ = system.on_segment_start(system.segment(step.index + 1.0), following, step.mode)
        following = choose_each(step.corner, started, following)
    origin = step.origin + jnp.where(step.corner, segment.duration, 0.0)
    return jnp.stack([origin, jnp.where(step.corner, 0.0, later), *jax.tree.leaves(following)])


def rates_at_end(
    system: AbstractHybridSystem,
    segment: InputSegment,
    t_local: Scalar,
    begin: State,
    duration: Scalar,
    end: State,
    mode: Scalar,
) -> State:
    """The rate of the state at the end of a step, without derivatives of its own.

    A component known in closed form goes on moving where all else has settled (a platform that still rings under a
    stuck contact), although the field of that mode leaves it out.
    """
    rates = system.field(segment, t_local + duration, end, mode)

    def later(shift: Scalar) -> State:
        moved = jax.tree.map(lambda a, b: a + shift * b, end, rates)
        return system.exact(segment, t_local, begin, duration + shift, moved)

    exact = jax.jvp(later, (jnp.zeros_like(duration),), (jnp.ones_like(duration),))[1]
    # In other modes the field has them, too, and bit for bit the same before an event and after it.
    return lax.stop_gradient(choose_each(mode == SETTLED, exact, rates))


def _tangent_only(x: Scalar) -> Scalar:
    """Zero in value, `x` in derivative."""
    return x - lax.stop_gradient(x)


def end_to_second_order(
    system: AbstractHybridSystem, row: Float[Array, " columns"], polynomials: Float[Array, "components coefficients"]
) -> Float[Array, " start"]:
    """The start of the next step, right to the second derivative: it moves along the motion, not along its tangent.

    The shift of its time is zero in value, so that second order adds one term in its square: x''/2 to the motion, and
    -g''/(2 g') to the time of an event with the margin g.
    """
    step, unflatten = read(row), unflattener(system)
    segment, begin, mode, which = system.segment(step.index), unflatten(step.x), step.mode, step.which
    value, rate, bend_of_motion = (_derivative_at(polynomials, step.duration, order) for order in range(3))

    def motion(shift: Scalar) -> State:
        x = value + shift * (rate + 0.5 * shift * bend_of_motion)
        end = unflatten([x[i] for i in range(len(x))])
        return system.exact(segment, step.t_local, begin, step.duration + shift, end)

    def margin(shift: Scalar) -> Scalar:
        return _ending_guard(system, segment, step.end + shift, motion(shift), mode, which)

    none, one = jnp.zeros_like(step.duration), jnp.ones_like(step.duration)
    to_corner = jnp.where(step.corner, segment.duration, 0.0) - step.t_local
    shift = jnp.where(step.corner, _tangent_only(to_corner), 0.0)
    is_carried_back = jnp.zeros((), bool)
    if has_guards(system, segment, step.end, motion(none), mode):
        with_slope = lambda shift: jax.jvp(margin, (shift,), (one,))
        (gap, slope), (_, bend) = jax.jvp(with_slope, (none,), (one,))
        located = step.event & (step.end > 0.0) & (slope != 0)
        is_carried_back = step.event & system.is_carried_back(lax.stop_gradient(slope), mode, which, _SMALL)
        tangent = -jnp.where(located, _tangent_only(gap), 0.0) / jnp.where(located, slope, 1.0)
        bent = lax.stop_gradient(jnp.where(located, 0.5 * bend / slope, 0.0))
        shift = jnp.where(located, tangent - bent * tangent**2, shift)
    carried_back = lambda x, mode: _carried_back(system, segment, step.end + shift, x, shift, mode)
    return _next_start(system, step, segment, motion(shift), Shift(shift, is_carried_back), carried_back)


def _derivative_at(
    polynomials: Float[Array, "components coefficients"], time: Scalar, order: int
) -> Float[Array, " components"]:
    """Derivatives of some order of polynomials at a fixed `time`."""
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
