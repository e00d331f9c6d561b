"""The steps of the forward pass again, side by side, with their derivatives.

Every step is linearised about its own start, and a linear recurrence joins them.  Where an event ends a step its
end moves with the parameters; that shift is the saltation (docs/numerics.md), here without a matrix of its own.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float

from ..core import Scalar, Truth
from .accuracy import Accuracy
from .forward_pass import find_steps
from .loop_state import LoopState
from .polynomials import horner
from .step_methods.base import AbstractStepMethod, KnownStep
from .step_table import KNOWN_COLUMNS, Table, read
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
from .tiles import Tile, tiled

Keep: TypeAlias = tuple[int, ...]
"""Components of the state of which the polynomials are kept."""

Known: TypeAlias = tuple[dict[str, Float[Array, " room"]], LoopState]
"""Of every step what cannot be differentiated by, and the last carry."""

StepArrays: TypeAlias = tuple[
    Float[Array, "room begin"], Float[Array, " begin"], Float[Array, "room kept coefficients"], Known
]
"""(begins, end, polynomials, known): a begin or end is origin, local time and state of a step."""


_SMALL = 1e-11
"""Amplitude [m] of a motion from whose events derivatives are carried back to a fixed time."""


@eqx.filter_custom_jvp
def differentiable_steps(
    system: AbstractHybridSystem, *, horizon: Scalar, accuracy: Accuracy, keep: Keep
) -> StepArrays:
    table, loop = find_steps(system, horizon, accuracy)
    # The loop itself keeps no polynomials: a carry that large would slow it down.
    return _step_arrays(table, loop, tiled(values(system, accuracy, keep), None, table, loop.count)[1])


@differentiable_steps.def_jvp
def _differentiable_steps_jvp(
    primals: tuple[AbstractHybridSystem], tangents: tuple[Any], *, horizon: Scalar, accuracy: Accuracy, keep: Keep
) -> tuple[StepArrays, tuple[Any, ...]]:
    table, loop = find_steps(primals[0], horizon, accuracy)
    first_dot, tile = tangents_of(primals[0], tangents[0], accuracy, keep, table.shape[1] - KNOWN_COLUMNS)
    end_dot, (begins_dot, polynomials, polynomials_dot) = tiled(tile, first_dot, table, loop.count)
    out = _step_arrays(table, loop, polynomials)
    nothing = jax.tree.map(lambda _: None, out[3])
    return out, (begins_dot, end_dot, polynomials_dot, nothing)


def _step_arrays(table: Table, loop: LoopState, polynomials: Float[Array, "room kept coefficients"]) -> StepArrays:
    size = table.shape[1] - KNOWN_COLUMNS
    index, mode, step_radius, duration, _ = table[:, size:].T
    known = dict(index=index, mode=mode, step_radius=step_radius, duration=duration)
    return table[:, :size], end_of(loop), polynomials, (known, loop)


def end_of(loop: LoopState) -> Float[Array, " begin"]:
    """Where a run ended, as a step's begin: origin, local time and state."""
    return jnp.stack([loop.origin, loop.t_local, *loop.x])


def values(
    system: AbstractHybridSystem, accuracy: Accuracy, keep: Keep
) -> Tile[None, Float[Array, "rows kept coefficients"]]:
    """Expands a tile's steps again: their polynomials, shape (rows, components kept, degree + 1)."""

    def tile(carry: None, rows: Float[Array, "rows columns"], real: Bool[Array, " rows"]) -> tuple[None, Array]:
        return carry, _expanded(system, accuracy.method, jnp.asarray(accuracy.tolerance, float), keep, rows)

    return tile


class Tangents(NamedTuple):
    """Of the steps of a tile or a table."""

    begins: Float[Array, "rows begin"]
    polynomials: Float[Array, "rows kept coefficients"]
    """Themselves."""
    moved: Float[Array, "rows kept coefficients"]
    """The tangents of the polynomials."""


def tangents_of(
    system: AbstractHybridSystem, system_dot: AbstractHybridSystem, accuracy: Accuracy, keep: Keep, size: int
) -> tuple[Float[Array, " begin"], Tile[Float[Array, " begin"], Tangents]]:
    """The first begin's tangent along `system_dot`, whose leaves are None where nothing moves, and what takes it on."""
    moving, fixed = eqx.partition(
        system, jax.tree.map(lambda t: t is not None, system_dot, is_leaf=lambda t: t is None)
    )
    parameters, rebuilt = ravel_pytree(moving)
    parameters_dot, _ = ravel_pytree(system_dot)

    def join(
        tangent: Float[Array, " begin"], step: tuple[Truth, Float[Array, "begin begin"], Float[Array, " begin"]]
    ) -> tuple[Float[Array, " begin"], Float[Array, " begin"]]:
        real, matrix, vector = step
        moved = jnp.sum(matrix * tangent, axis=-1) + vector
        return jnp.where(real, moved, tangent), tangent

    def tile(
        tangent: Float[Array, " begin"], rows: Float[Array, "rows columns"], real: Bool[Array, " rows"]
    ) -> tuple[Float[Array, " begin"], Tangents]:
        polynomials, (ends, inner) = _linearised(
            moving, fixed, accuracy.method, jnp.asarray(accuracy.tolerance, float), keep, rows
        )
        driven = jnp.sum(ends[..., size:] * parameters_dot, axis=-1)
        end, begins = lax.scan(join, tangent, (real, ends[..., :size], driven))
        moved = jnp.sum(inner[..., :size] * begins[:, None, None, :], axis=-1)
        return end, Tangents(begins, polynomials, moved + jnp.sum(inner[..., size:] * parameters_dot, axis=-1))

    started = lambda parameters: jnp.stack(
        jax.tree.leaves(initial_state_and_mode(eqx.combine(rebuilt(parameters), fixed))[0])
    )
    first_dot = jnp.zeros(size).at[2:].set(jax.jvp(started, (parameters,), (parameters_dot,))[1])
    return first_dot, tile


# These two are compiled functions of their own so that they are traced once, however often loops and
# transformations look at them.
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

    With respect to the begin and every `moving` parameter of the system, whatever the tangents
    asked for: directions asked for together share it.
    """
    size = rows.shape[1] - KNOWN_COLUMNS
    parameters, rebuilt = ravel_pytree(moving)

    def again(
        inputs: Float[Array, " inputs"], known: Float[Array, " known"]
    ) -> tuple[AbstractHybridSystem, Float[Array, " columns"]]:
        system = eqx.combine(rebuilt(inputs[size:]), fixed)
        return system, jnp.concatenate([inputs[:size], known])

    def step(inputs: Float[Array, " inputs"], known: Float[Array, " known"]) -> KnownStep:
        system, row = again(inputs, known)
        return _known_step(system, tolerance, row)

    def flow(inputs: Float[Array, "rows inputs"]) -> tuple[Any, Any]:
        known = rows[:, size:]
        polynomials = method.expand(step, inputs, known)
        shown = _kept(polynomials, keep)
        step_radius, duration = known[:, 2], known[:, 3]
        # Always true, also where a number is not finite.
        true = ~(step_radius[0] < 0.0)
        side_by_side = lambda f: (
            lambda *args: jax.vmap(lambda i, k, *found: f(*again(i, k), *found))(inputs, known, *args)
        )
        x = computed_once(true, lambda polynomials: [horner(list(c), duration) for c in polynomials], polynomials)
        x = computed_once(true, side_by_side(_exact_end), x)
        shift = computed_once(true, side_by_side(_event_shift), x)
        return (side_by_side(_end)(x, shift), shown), shown

    # The rows do not know of each other: one direction serves them all.
    inputs = jnp.concatenate([rows[:, :size], jnp.broadcast_to(parameters, (len(rows), parameters.size))], axis=1)
    along = lambda direction: jax.jvp(flow, (inputs,), (jnp.broadcast_to(direction, inputs.shape),), has_aux=True)
    _, slopes, polynomials = jax.vmap(along, out_axes=(None, -1, None))(jnp.eye(inputs.shape[1]))
    return polynomials, slopes


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
