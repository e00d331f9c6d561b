"""The forward pass: every step of a run, found without derivatives.

A bare `while_loop` on a handful of scalars.  It writes one row a step to a table; `sensitivities`
expands the rows again, in value and in derivative.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias, TypeVar, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from ..core import Count, Scalar, Truth
from .accuracy import Accuracy
from .event_location import first_crossing
from .step_methods.base import AbstractStepMethod, Piece, horner, shortened
from .system import (
    SETTLED,
    AbstractHybridSystem,
    InputSegment,
    State,
    Unflatten,
    field_of,
    has_guards,
    initial_state_and_mode,
    unflattener,
)
from .taylor_series import Field, Series, constant, polynomial

_BLOCK = 5
"""Steps written to memory at a time: XLA runs a loop on small buffers two to three times faster."""

_FORCED = 1.5
"""So many times longer a step may be for what is known in closed form, and only enters the rest as a forcing."""

CORNER, BECAME_SETTLED, EVENT, WHICH = 1, 2, 4, 8
"""Bits of the code of a step, how it ended; the number of the guard that ended it follows from `WHICH` on."""

KNOWN_COLUMNS = 5
"""Columns of the table behind the time and the state: index, mode, reach, length, code."""


Table: TypeAlias = Float[Array, "room columns"]
"""A row a step: time and state at its begin, then the `KNOWN_COLUMNS`; room to spare."""


class LoopState(NamedTuple):
    """The carry of the loop, scalars only, so that the loop is fast; at the end its result."""

    index: Scalar  # pyright: ignore[reportIncompatibleMethodOverride]
    origin: Scalar
    t_local: Scalar
    x: tuple[Scalar, ...]
    mode: Scalar
    proposed_step: Scalar
    count: Scalar  # pyright: ignore[reportIncompatibleMethodOverride]
    rejected: Scalar
    events: Scalar
    failure: Scalar
    done: Scalar
    period_start: tuple[Scalar, ...]
    """State at the start of the drive's last period."""
    period_start_settled: Scalar
    """That state was settled."""
    period: Scalar
    repeats: Scalar


class Reached(NamedTuple):
    """What is left of an integration that kept no steps."""

    x: State
    """At the times asked for; every leaf of shape (m,)."""
    steps: Count
    """Accepted."""
    rejected: Count
    failure: Count
    """Index into `solution.FAILURES`; 0 where the integration finished."""


Scalars = TypeVar("Scalars")
"""A pytree of scalars."""

Filling: TypeAlias = tuple[Float[Array, " scalars"], Count, Float[Array, "block columns"]]
"""Carry, rows of the block that are filled, the block."""

Filled: TypeAlias = tuple[Float[Array, " scalars"], Table, Count]
"""Carry, table, blocks of the table that are filled."""


def find_steps(system: AbstractHybridSystem, horizon: Scalar, accuracy: Accuracy) -> tuple[Table, LoopState]:
    """Every step from t = 0 to the horizon: the table of steps, and the last carry."""
    finely = _fineness(accuracy)
    loop = _initial_carry(system)
    start, unpack = _packed(loop)
    width = 2 + len(loop.x) + KNOWN_COLUMNS
    blocks = -(-accuracy.max_steps // _BLOCK)
    done = lambda packed: unpack(packed).done > 0

    def step(carry: Filling) -> Filling:
        packed, filled, block = carry
        moved, row, accepted = _one_step(system, horizon, finely, unpack(packed), True)
        block = lax.dynamic_update_index_in_dim(block, row, filled, 0)
        return _packed(moved)[0], filled + accepted, block

    def steps(carry: Filled) -> Filled:
        packed, table, used = carry
        empty = (packed, jnp.zeros((), int), jnp.zeros((_BLOCK, width)))
        packed, _, block = lax.while_loop(lambda c: (c[1] < _BLOCK) & ~done(c[0]), step, empty)
        return packed, lax.dynamic_update_slice_in_dim(table, block, used * _BLOCK, 0), used + 1

    packed, table, _ = lax.while_loop(
        lambda c: (c[2] < blocks) & ~done(c[0]), steps, (start, jnp.zeros((blocks * _BLOCK, width)), jnp.zeros((), int))
    )
    loop = unpack(packed)
    counts = ("count", "rejected", "events", "period", "failure")
    whole = {name: getattr(loop, name).astype(int) for name in counts}
    whole["failure"] = jnp.where(loop.done > 0, whole["failure"], 1)
    return table, loop._replace(**whole, repeats=loop.repeats > 0)


def integrate_to_times(system: AbstractHybridSystem, times: Float[Array, " m"], accuracy: Accuracy) -> Reached:
    """The state at each of the ascending `times` [s], shape (m,), without keeping the steps between.

    For sweeps: little memory, no derivatives, no repetition of periods.
    """
    finely = _fineness(accuracy)
    start, unpack = _packed(_initial_carry(system))

    def go(
        packed: Float[Array, " scalars"], time: Scalar
    ) -> tuple[Float[Array, " scalars"], Float[Array, " components"]]:
        loop = unpack(packed)
        packed = _packed(loop._replace(done=jnp.where(loop.failure > 0, 1.0, 0.0)))[0]
        running = lambda packed: (unpack(packed).done == 0) & (unpack(packed).count < accuracy.max_steps)
        step = lambda packed: _packed(_one_step(system, time, finely, unpack(packed), False)[0])[0]
        packed = lax.while_loop(running, step, packed)
        return packed, jnp.stack(unpack(packed).x)

    packed, states = lax.scan(go, start, times)
    loop = unpack(packed)
    failure = jnp.where((loop.done == 0) & (loop.failure == 0), 1.0, loop.failure).astype(int)
    return Reached(unflattener(system)(states.T), loop.count.astype(int), loop.rejected.astype(int), failure)


def _initial_carry(system: AbstractHybridSystem) -> LoopState:
    """The carry before the first step."""
    zero = jnp.zeros(())
    first, mode = initial_state_and_mode(system)
    leaves = tuple(jax.tree.leaves(first))
    nothing: Any = zero
    blank = LoopState(*[nothing] * len(LoopState._fields))
    return blank._replace(x=leaves, period_start=leaves, mode=mode, proposed_step=zero + 1e-6)


class Fineness(NamedTuple):
    """What a step needs to know of the accuracy."""

    method: AbstractStepMethod
    tolerance: Scalar
    settle_tolerance: Scalar
    patience: Scalar
    """So many rejections are too many."""


def _fineness(accuracy: Accuracy) -> Fineness:
    array = lambda number: jnp.asarray(number, float)
    return Fineness(
        accuracy.method,
        array(accuracy.tolerance),
        array(accuracy.effective_settle_tolerance),
        array(2.0 * accuracy.max_steps),
    )


# Traced once for values and once for derivatives: search, fit and prediction differ in numbers only.
@eqx.filter_jit
def _one_step(
    system: AbstractHybridSystem, horizon: Scalar, finely: Fineness, loop: LoopState, repeating: bool
) -> tuple[LoopState, Float[Array, " columns"], Truth]:
    """One attempt: the new carry, its row for the table, and whether it was accepted."""
    unflatten = unflattener(system)
    opaque_one = 1.0 + 0.0 * loop.count
    segment = system.segment(loop.index)
    last = loop.origin + segment.duration >= horizon
    finish = jnp.where(last, horizon - loop.origin, segment.duration)
    remaining = jnp.maximum(finish - loop.t_local, 0.0)
    piece = _attempt(system, segment, loop, finely.method, finely.tolerance, remaining, opaque_one)
    duration, event, which, x = _until_event(system, segment, loop, piece, opaque_one)
    t_local = loop.t_local + duration
    ended = ~event & (piece.step_radius >= remaining)
    corner = ended & ~last
    x, mode, becomes_settled = _afterwards(
        system, segment, loop, t_local, x, event, which, ended, finely.settle_tolerance, opaque_one
    )
    x = _kept(x, opaque_one)
    row = _row(
        loop,
        piece.step_radius,
        duration,
        corner * CORNER + becomes_settled * BECAME_SETTLED + event * (EVENT + WHICH * which),
    )
    ahead = loop.index + 1.0
    started, opening = system.on_segment_start(system.segment(ahead), x, mode)
    if system.resets_at_corners:
        x = jax.tree.map(lambda a, b: jnp.where(corner, a, b), started, x)
    opening = opening / opaque_one
    cycle = system.period() if repeating else None
    opens, repeats = _new_period(cycle, system, finely.settle_tolerance, unflatten, loop, ahead, x, mode, corner)
    finite = jnp.isfinite(sum(jax.tree.leaves(x))) & (duration >= 0)
    hopeless = ~piece.accepted & (loop.rejected > finely.patience)
    failure = jnp.where((piece.accepted & ~finite) | hopeless, 2.0, 0.0)
    moved = LoopState(
        index=loop.index + corner,
        origin=jnp.where(corner, loop.origin + segment.duration, loop.origin),
        t_local=jnp.where(corner, 0.0, t_local),
        x=tuple(jax.tree.leaves(x)),
        mode=jnp.where(corner, opening, mode),
        proposed_step=piece.next_proposed_step,
        count=loop.count + 1,
        rejected=loop.rejected,
        events=loop.events + event,
        failure=failure,
        done=((ended & last) | repeats | (failure > 0)) * 1.0,
        period_start=tuple(jnp.where(opens, a, b) for a, b in zip(jax.tree.leaves(x), loop.period_start, strict=True)),
        period_start_settled=jnp.where(opens, (mode == SETTLED) * 1.0, loop.period_start_settled),
        period=jnp.where(opens & ~repeats, loop.count + 1, loop.period),
        repeats=repeats * 1.0,
    )
    again = loop._replace(
        proposed_step=piece.next_proposed_step,
        rejected=loop.rejected + 1,
        failure=failure,
        done=jnp.where(failure > 0, 1.0, 0.0),
    )
    loop = jax.tree.map(lambda a, b: jnp.where(piece.accepted, a, b), moved, again)
    return loop, row, piece.accepted


def _attempt(
    system: AbstractHybridSystem,
    segment: InputSegment,
    loop: LoopState,
    method: AbstractStepMethod,
    tolerance: Scalar,
    remaining: Scalar,
    opaque_one: Scalar,
) -> Piece:
    """A smooth piece that resolves the state and what only the guards feel, and over which no derivative grows."""
    unflatten = unflattener(system)
    units = [scale / tolerance for scale in jax.tree.leaves(system.state_scale())]
    field = field_of(system, segment, unflatten, loop.mode)
    rate = _quickest_rate(field, loop.t_local, loop.x, system.closed_components())
    too_far = (loop.mode != SETTLED) & (remaining * rate > method.span)
    allowed = jnp.where(too_far, method.span / rate, remaining)
    piece = method.attempt(field, loop.t_local, list(loop.x), units, allowed, loop.proposed_step, opaque_one)
    motion = unflatten([polynomial(c) for c in piece.polynomials])
    extra = cast("tuple[Series, ...]", system.extra_error_terms(motion, loop.mode))
    return shortened(piece, extra, tolerance, opaque_one) if extra else piece


def _until_event(
    system: AbstractHybridSystem, segment: InputSegment, loop: LoopState, piece: Piece, opaque_one: Scalar
) -> tuple[Scalar, Truth, Scalar, State]:
    """How long the piece is used [s], whether an event ends it, of which guard, and the state there."""
    unflatten = unflattener(system)
    clock = polynomial([loop.t_local, piece.step_radius])
    motion = unflatten([polynomial(c) for c in piece.polynomials])
    guards = cast("tuple[Series, ...]", system.guards(segment, clock, motion, loop.mode))  # of series, series
    crossing, which = first_crossing(guards, len(piece.polynomials[0]), piece.step_radius)
    crossing = crossing / opaque_one
    duration = piece.step_radius * crossing
    x = [horner(c, crossing) for c in piece.polynomials]
    x = system.exact(segment, loop.t_local, unflatten(loop.x), duration, unflatten(x))
    return duration, crossing < 1.0, which, _kept(x, opaque_one)


def _afterwards(
    system: AbstractHybridSystem,
    segment: InputSegment,
    loop: LoopState,
    t_local: Scalar,
    x: State,
    event: Truth,
    which: Scalar,
    ended: Truth,
    settle_tolerance: Scalar,
    opaque_one: Scalar,
) -> tuple[State, Scalar, Scalar]:
    """State and mode after the event, if there was one, and 1 where what is left has settled."""
    mode = loop.mode
    if has_guards(system, segment, t_local, x, mode):
        switched, following = system.after_event(segment, t_local, x, mode, which)
        x = jax.tree.map(lambda a, b: jnp.where(event, a, b), switched, x)
        mode = jnp.where(event, following, mode) / opaque_one
    becomes_settled = ~ended & system.is_settled(segment, t_local, x, mode, settle_tolerance)
    becomes_settled = jnp.where(becomes_settled, 1.0, 0.0) / opaque_one
    projected = system.project_to_steady(segment, t_local, x, mode)
    x = jax.tree.map(lambda a, b: jnp.where(becomes_settled > 0, a, b), projected, x)
    return x, jnp.where(becomes_settled > 0, SETTLED, mode), becomes_settled


def _quickest_rate(field: Field, t_local: Scalar, x: Sequence[Scalar], closed: Sequence[int]) -> Scalar:
    """About the largest modulus [1/s] of the eigenvalues of the field's Jacobian at `x`; see `span` of the methods.

    A transient that has decayed has coefficients that vanish and allow any step.  What the same step
    does to derivatives is not seen there: beyond the method's region of stability they grow, and with them
    what is left of rounding, from step to step.  Two components a, b that feel each other turn or decay at
    the rate sqrt|J_ab J_ba|, whatever their units; what only one of them feels changes no eigenvalue.
    """

    def flow(x: Float[Array, " components"]) -> Float[Array, " components"]:
        return jnp.stack([jnp.asarray(constant(rate), float) for rate in field(t_local, list(x))])

    jacobian = jax.jacfwd(flow)(jnp.stack(x))
    known = np.isin(np.arange(len(x)), closed)
    weight = np.where(known, 1.0 / _FORCED**2, 1.0)
    mutual = jnp.abs(jacobian * jacobian.T) * weight
    return jnp.sqrt(jnp.max(jnp.sum(jnp.where(jnp.isfinite(mutual), mutual, 0.0), axis=1)))


def _kept(tree: Scalars, opaque_one: Scalar) -> Scalars:
    """`tree` as computed once: XLA repeats cheap scalars in every consumer, but no division.

    `opaque_one` is 1 in a way that the compiler cannot know.
    """
    packed, unpack = _packed(tree)
    return unpack(packed / opaque_one)


def _packed(tree: Scalars) -> tuple[Float[Array, " scalars"], Callable[[Float[Array, " scalars"]], Scalars]]:
    """The scalars of `tree` as one vector, and the way back."""
    leaves, structure = jax.tree.flatten(tree)
    return jnp.stack(leaves), lambda packed: jax.tree.unflatten(structure, [packed[i] for i in range(len(leaves))])


def _row(loop: LoopState, step_radius: Scalar, duration: Scalar, code: Scalar) -> Float[Array, " columns"]:
    return jnp.stack([loop.origin, loop.t_local, *loop.x, loop.index, loop.mode, step_radius, duration, code])


def _new_period(
    cycle: tuple[int, int] | None,
    system: AbstractHybridSystem,
    settle_tolerance: Scalar,
    unflatten: Unflatten,
    loop: LoopState,
    ahead: Scalar,
    x: State,
    mode: Scalar,
    corner: Truth,
) -> tuple[Truth | bool, Truth]:
    """Whether a period of the drive opens here, and whether it repeats the last one.

    It does where both began at rest and in the same state but for a shift: a contact may
    also rest while it sticks, each time with another force, or while the platform rings.
    """
    if cycle is None:
        return False, jnp.zeros((), bool)
    first, every = cycle
    opens = corner & (ahead >= first) & ((ahead - first) % every == 0)
    # Each is within `rest` of the steady solution; the factor keeps that from looking like a difference.
    same = system.same_state(x, unflatten(loop.period_start), 4.0 * settle_tolerance)
    return opens, opens & (loop.period_start_settled > 0) & (mode == SETTLED) & same
