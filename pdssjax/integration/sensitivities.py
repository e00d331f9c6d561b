"""The steps of the forward pass again, side by side, with their first and second derivatives.

Every step is differentiated about its own start, and a linear recurrence joins the steps.  Where an event ends a step
its end moves with the parameters; that shift is the saltation (docs/numerics.md), here without a matrix of its own.
To second order the time of the event, its slope and the jump are differentiated again.

Derivatives are whole arrays, by every parameter that moves: a linear map of them is all that JAX has to transpose or
to map over, whatever directions are asked for.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float

from ..core import Scalar, Truth
from .accuracy import Accuracy
from .polynomials import horner
from .step_methods.base import AbstractStepMethod, KnownStep
from .step_table import KNOWN_COLUMNS, read
from .system import (
    SETTLED,
    AbstractHybridSystem,
    InputSegment,
    State,
    field_of,
    has_guards,
    initial_state_and_mode,
    unflattener,
)
from .taylor_loop import computed_once
from .tiles import Tile

Keep: TypeAlias = tuple[int, ...]
"""Components of the state of which the polynomials are kept."""

Ends: TypeAlias = tuple[Float[Array, "begin *parameters"], ...]
"""Derivatives of a step's end by the parameters, of first order on."""

_SMALL = 1e-11
"""Amplitude [m] of a motion from whose events derivatives are carried back to a fixed time."""

_PAIRS = 64
"""Pairs of parameters by which second derivatives are taken side by side: bounds the memory."""


class StepDerivatives(NamedTuple):
    """What a tile finds of its steps; the axes of the parameters by which derivatives are taken come last."""

    begins: tuple[Float[Array, "rows begin *parameters"], ...]
    """Of origin, local time and state, derivatives of first order on."""
    polynomials: tuple[Float[Array, "rows kept coefficients *parameters"], ...]
    """Themselves, and their derivatives."""


def differentiated_steps(
    moving: AbstractHybridSystem,
    fixed: AbstractHybridSystem,
    accuracy: Accuracy,
    keep: Keep,
    size: int,
    order: int,
) -> tuple[Ends, Tile[Ends, StepDerivatives]]:
    """Derivatives of the first step's begin by the `moving` leaves of the system, and what takes them through a tile.

    **Arguments:** `size` is how many numbers begin a step; `order` is that of the highest derivatives, up to 2.
    """
    parameters, rebuilt = ravel_pytree(moving)
    method, tolerance = accuracy.method, jnp.asarray(accuracy.tolerance, float)

    def started(parameters: Float[Array, " parameters"]) -> Float[Array, " begin"]:
        leaves = jax.tree.leaves(initial_state_and_mode(eqx.combine(rebuilt(parameters), fixed))[0])
        return jnp.concatenate([jnp.zeros(size - len(leaves)), jnp.stack(leaves)])

    def join(
        before: Ends, step: tuple[Truth, Float[Array, "begin begin"], tuple[Float[Array, "begin *parameters"], ...]]
    ) -> tuple[Ends, Ends]:
        real, matrix, gained = step
        moved = [_contracted(matrix, derivative) + added for derivative, added in zip(before, gained, strict=True)]
        return tuple(jnp.where(real, new, old) for new, old in zip(moved, before, strict=True)), before

    def tile(
        ends: Ends, rows: Float[Array, "rows columns"], real: Bool[Array, " rows"]
    ) -> tuple[Ends, StepDerivatives]:
        if order == 0:
            return ends, StepDerivatives((), (_expanded(eqx.combine(moving, fixed), method, tolerance, keep, rows),))
        polynomials, (end, inner) = _linearised(moving, fixed, method, tolerance, keep, rows)
        of_begin = end[..., :size]
        first, (begins,) = lax.scan(join, ends[:1], (real, of_begin, (end[..., size:],)))
        unit = jnp.broadcast_to(jnp.eye(parameters.size), (len(rows), parameters.size, parameters.size))
        along = jnp.concatenate([begins, unit], axis=1)
        slopes = jax.vmap(_contracted)(inner, along)
        if order == 1:
            return first, StepDerivatives((begins,), (polynomials, slopes))
        end_bends, bends = _bent(moving, fixed, method, tolerance, keep, rows, along)
        second, (begin_bends,) = lax.scan(join, ends[1:], (real, of_begin, (end_bends,)))
        bends = bends + jax.vmap(_contracted)(inner[..., :size], begin_bends)
        return (*first, *second), StepDerivatives((begins, begin_bends), (polynomials, slopes, bends))

    derivatives: list[Callable[[Float[Array, " parameters"]], Array]] = [started]
    for _ in range(order):
        derivatives.append(jax.jacfwd(derivatives[-1]))
    return tuple(derivative(parameters) for derivative in derivatives[1:]), tile


def _contracted(a: Float[Array, "*left inner"], b: Float[Array, "inner *right"]) -> Float[Array, "..."]:
    """The sum over the last axis of `a` and the first of `b`; not a dot product, which XLA would not fuse."""
    left, right = a.ndim - 1, b.ndim - 1
    return jnp.sum(a.reshape(*a.shape, *(1,) * right) * b.reshape(*(1,) * left, *b.shape), axis=left)


# These are compiled functions of their own so that they are traced once, however often loops and transformations
# look at them.
@eqx.filter_jit
def _expanded(
    system: AbstractHybridSystem,
    method: AbstractStepMethod,
    tolerance: Scalar,
    keep: Keep,
    rows: Float[Array, "rows columns"],
) -> Float[Array, "rows kept coefficients"]:
    """The polynomials of the steps `rows`, shape (rows, components kept, degree + 1)."""
    polynomials = method.expand(lambda row: _known_step(system, tolerance, row), rows)
    return _kept(polynomials, keep)


class _Again(NamedTuple):
    """The steps of a tile as functions of their inputs: the numbers that begin each, then the parameters."""

    inputs: Float[Array, "rows inputs"]
    known: Float[Array, "rows known"]
    restored: Callable[[Array, Array], tuple[AbstractHybridSystem, Float[Array, " columns"]]]
    """System and row of one step, from its inputs and what is known of it."""
    step: Callable[[Array, Array], KnownStep]

    def side_by_side(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """`function(system, row, *found)` of every row, as a function of all inputs and of what was found of each."""
        of_row = lambda inputs, known, *found: function(*self.restored(inputs, known), *found)
        return lambda inputs, *found: jax.vmap(of_row)(inputs, self.known, *found)


def _again(
    moving: AbstractHybridSystem,
    fixed: AbstractHybridSystem,
    tolerance: Scalar,
    rows: Float[Array, "rows columns"],
) -> _Again:
    size = rows.shape[1] - KNOWN_COLUMNS
    parameters, rebuilt = ravel_pytree(moving)

    def restored(
        inputs: Float[Array, " inputs"], known: Float[Array, " known"]
    ) -> tuple[AbstractHybridSystem, Float[Array, " columns"]]:
        system = eqx.combine(rebuilt(inputs[size:]), fixed)
        return system, jnp.concatenate([inputs[:size], known])

    def step(inputs: Float[Array, " inputs"], known: Float[Array, " known"]) -> KnownStep:
        system, row = restored(inputs, known)
        return _known_step(system, tolerance, row)

    inputs = jnp.concatenate([rows[:, :size], jnp.broadcast_to(parameters, (len(rows), parameters.size))], axis=1)
    return _Again(inputs, rows[:, size:], restored, step)


@eqx.filter_jit
def _linearised(
    moving: AbstractHybridSystem,
    fixed: AbstractHybridSystem,
    method: AbstractStepMethod,
    tolerance: Scalar,
    keep: Keep,
    rows: Float[Array, "rows columns"],
) -> tuple[Float[Array, "rows kept coefficients"], Any]:
    """The polynomials of the steps `rows`, and the Jacobians of their ends and polynomials.

    With respect to the begin and every `moving` parameter of the system.
    """
    again = _again(moving, fixed, tolerance, rows)
    step_radius, duration = again.known[:, 2], again.known[:, 3]

    def flow(inputs: Float[Array, "rows inputs"]) -> tuple[Any, Any]:
        polynomials = method.expand(again.step, inputs, again.known)
        shown = _kept(polynomials, keep)
        # Always true, also where a number is not finite.
        true = ~(step_radius[0] < 0.0)
        x = computed_once(true, lambda p: horner(list(jnp.stack(p, axis=2)), duration[:, None]), polynomials)
        x = computed_once(true, again.side_by_side(_exact_end), inputs, list(x.T))
        shift = computed_once(true, again.side_by_side(_event_shift), inputs, x)
        return (again.side_by_side(_end)(inputs, x, shift), shown), shown

    # The rows do not know of each other: one direction serves them all.
    inputs = again.inputs
    along = lambda direction: jax.jvp(flow, (inputs,), (jnp.broadcast_to(direction, inputs.shape),), has_aux=True)
    _, slopes, polynomials = jax.vmap(along, out_axes=(None, -1, None))(jnp.eye(inputs.shape[1]))
    return polynomials, slopes


@eqx.filter_jit
def _bent(
    moving: AbstractHybridSystem,
    fixed: AbstractHybridSystem,
    method: AbstractStepMethod,
    tolerance: Scalar,
    keep: Keep,
    rows: Float[Array, "rows columns"],
    along: Float[Array, "rows inputs parameters"],
) -> tuple[
    Float[Array, "rows begin parameters parameters"], Float[Array, "rows kept coefficients parameters parameters"]
]:
    """Second derivatives of the ends and polynomials of the steps `rows`, along pairs of directions of their inputs."""
    again = _again(moving, fixed, tolerance, rows)

    def flow(inputs: Float[Array, "rows inputs"]) -> tuple[Array, Array]:
        polynomials = method.expand(again.step, inputs, again.known)
        each = jnp.stack([coefficients.T for coefficients in polynomials], axis=1)
        return again.side_by_side(_moving_end)(inputs, each), _kept(polynomials, keep)

    def bend(pair: tuple[Array, Array]) -> tuple[Array, Array]:
        slope = lambda inputs: jax.jvp(flow, (inputs,), (along[..., pair[0]],))[1]
        return jax.jvp(slope, (again.inputs,), (along[..., pair[1]],))[1]

    count = along.shape[-1]
    first, second = np.triu_indices(count)
    bends = lax.map(bend, (jnp.asarray(first), jnp.asarray(second)), batch_size=min(_PAIRS, max(len(first), 1)))
    place = np.zeros((count, count), int)
    place[first, second] = place[second, first] = np.arange(len(first))
    whole = lambda upper: jnp.moveaxis(upper[place], (0, 1), (-2, -1))
    return whole(bends[0]), whole(bends[1])


def _kept(
    polynomials: Sequence[Float[Array, "coefficients rows"]], keep: Keep
) -> Float[Array, "rows kept coefficients"]:
    """The components `keep` of the polynomials of many rows, shape (rows, components kept, degree + 1)."""
    return jnp.stack([polynomials[i].T for i in keep], axis=1)


def _known_step(system: AbstractHybridSystem, tolerance: Scalar, row: Float[Array, " columns"]) -> KnownStep:
    """A step of the table, as methods want it."""
    step = read(row)
    field = field_of(system, system.segment(step.index), unflattener(system), step.mode)
    units = [scale / tolerance for scale in jax.tree.leaves(lax.stop_gradient(system.state_scale()))]
    return KnownStep(field, step.t_local, list(step.begin), units, step.step_radius)


def _exact_end(system: AbstractHybridSystem, row: Float[Array, " columns"], x: list[Scalar]) -> list[Scalar]:
    """Where the polynomials of a step lead, with what is known in closed form put right."""
    step, unflatten = read(row), unflattener(system)
    segment, begin = system.segment(step.index), unflatten(step.begin)
    return jax.tree.leaves(system.exact(segment, step.t_local, begin, step.duration, unflatten(x)))


class _Shift(NamedTuple):
    """By how much the end of a step moves."""

    time: Scalar
    """Zero in value, the derivative of the event's or of the corner's time [s]."""
    is_carried_back: Truth
    """Whether it is an event at whose moving time derivatives are not left."""


def _event_shift(system: AbstractHybridSystem, row: Float[Array, " columns"], x: list[Scalar]) -> _Shift:
    step = read(row)
    at, mode, which = step.at, step.mode, step.which
    end, segment = unflattener(system)(x), system.segment(step.index)

    def margin(event_shift: Scalar) -> Scalar:
        rates = system.field(segment, at + event_shift, end, mode)
        moved = jax.tree.map(lambda a, b: a + event_shift * b, end, rates)
        guards = [jnp.asarray(guard, float) for guard in system.guards(segment, at + event_shift, moved, mode)]
        return jnp.minimum(*guards) if len(guards) == 2 else jnp.stack(guards)[which]

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
    return _Shift(shift, is_carried_back)


def _end(
    system: AbstractHybridSystem, row: Float[Array, " columns"], x: list[Scalar], shift: _Shift
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
    at, mode, later = step.at, step.mode, step.at + shift.time
    end, segment = unflatten(x), system.segment(step.index)
    before = _rates(system, segment, step.t_local, unflatten(step.begin), step.duration, end, mode)
    moved = jax.tree.map(lambda a, b: a + shift.time * b, end, before)
    follows, following, events = moved, mode, has_guards(system, segment, at, end, mode)
    if events:
        switched, following = system.after_event(segment, later, moved, mode, step.which)
        follows = jax.tree.map(lambda a, b: jnp.where(step.event, a, b), switched, moved)
        following = jnp.where(step.event, following, mode)
    projected = system.project_to_steady(segment, later, follows, following)
    follows = jax.tree.map(lambda a, b: jnp.where(step.becomes_settled, a, b), projected, follows)
    if events:
        following = jnp.where(step.becomes_settled, SETTLED, following)
        after = _rates(system, segment, at, follows, jnp.zeros_like(at), follows, following)
        carried_back = lambda x, f, m, y, g: jnp.where(shift.is_carried_back, x + shift.time * (f - g) + (y - m), y)
        follows = jax.tree.map(carried_back, end, before, moved, follows, after)
        later = jnp.where(shift.is_carried_back, at, later)
    if system.resets_at_corners:
        started, _ = system.on_segment_start(system.segment(step.index + 1.0), follows, mode)
        follows = jax.tree.map(lambda a, b: jnp.where(step.corner, a, b), started, follows)
    origin = step.origin + jnp.where(step.corner, segment.duration, 0.0)
    return jnp.stack([origin, jnp.where(step.corner, 0.0, later), *jax.tree.leaves(follows)])


def _rates(
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


def _moving_end(
    system: AbstractHybridSystem, row: Float[Array, " columns"], polynomials: Float[Array, "components coefficients"]
) -> Float[Array, " begin"]:
    """The end of a step as `_end` has it, right to the second derivative: along the motion, not along its tangent.

    The shift of its time is zero in value, so that its square is all that the motion, and half the bend of its margin
    over the slope all that the time of an event, needs besides the tangent.
    """
    step, unflatten = read(row), unflattener(system)
    segment, begin, mode, which = system.segment(step.index), unflatten(step.begin), step.mode, step.which
    value, rate, bend_of_motion = (_derivative_at(polynomials, step.duration, order) for order in range(3))

    def motion(shift: Scalar) -> State:
        x = value + shift * (rate + 0.5 * shift * bend_of_motion)
        end = unflatten([x[i] for i in range(len(x))])
        return system.exact(segment, step.t_local, begin, step.duration + shift, end)

    def margin(shift: Scalar) -> Scalar:
        guards = system.guards(segment, step.at + shift, motion(shift), mode)
        guards = [jnp.asarray(guard, float) for guard in guards]
        return jnp.minimum(*guards) if len(guards) == 2 else jnp.stack(guards)[which]

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
    moved, later = motion(shift), step.at + shift
    follows, following = moved, mode
    if events:
        switched, following = system.after_event(segment, later, moved, mode, which)
        follows = jax.tree.map(lambda a, b: jnp.where(step.event, a, b), switched, moved)
        following = jnp.where(step.event, following, mode)
    projected = system.project_to_steady(segment, later, follows, following)
    follows = jax.tree.map(lambda a, b: jnp.where(step.becomes_settled, a, b), projected, follows)
    if events:
        following = jnp.where(step.becomes_settled, SETTLED, following)
        back = _carried_back(system, segment, later, follows, shift, following)
        follows = jax.tree.map(lambda a, b: jnp.where(is_carried_back, a, b), back, follows)
        later = jnp.where(is_carried_back, step.at, later)
    if system.resets_at_corners:
        started, _ = system.on_segment_start(system.segment(step.index + 1.0), follows, mode)
        follows = jax.tree.map(lambda a, b: jnp.where(step.corner, a, b), started, follows)
    origin = step.origin + jnp.where(step.corner, segment.duration, 0.0)
    return jnp.stack([origin, jnp.where(step.corner, 0.0, later), *jax.tree.leaves(follows)])


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
