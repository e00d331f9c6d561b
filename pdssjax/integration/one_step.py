"""One step of the forward pass: a smooth piece, the event or the corner that ends it, and what follows."""

from typing import NamedTuple, cast

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import Scalar, Truth
from .accuracy import Accuracy
from .event_location import first_crossing
from .loop_state import LoopState, kept
from .polynomials import horner
from .repeated_period import new_period
from .step_bound import longest_step
from .step_length import shortened
from .step_methods.base import AbstractStepMethod, Piece
from .step_table import BECAME_SETTLED, CORNER, EVENT, WHICH, written
from .system import SETTLED, AbstractHybridSystem, InputSegment, State, field_of, has_guards, unflattener
from .taylor_series import Series, polynomial


class Fineness(NamedTuple):
    """What a step needs to know of the accuracy."""

    method: AbstractStepMethod
    tolerance: Scalar
    settle_tolerance: Scalar
    patience: Scalar
    """So many rejections are too many."""


def fineness(accuracy: Accuracy) -> Fineness:
    array = lambda number: jnp.asarray(number, float)
    return Fineness(
        accuracy.method,
        array(accuracy.tolerance),
        array(accuracy.effective_settle_tolerance),
        array(2.0 * accuracy.max_steps),
    )


# Traced once for values and once for derivatives: search, fit and prediction differ in numbers only.
@eqx.filter_jit
def one_step(
    system: AbstractHybridSystem, horizon: Scalar, finely: Fineness, loop: LoopState, repeating: bool
) -> tuple[LoopState, Float[Array, " columns"], Truth]:
    """One attempt: the new carry, its row for the table, and whether it was accepted."""
    unflatten = unflattener(system)
    opaque_one = 1.0 + 0.0 * loop.count
    segment = system.segment(loop.index)
    last = loop.origin + segment.duration >= horizon
    finish = jnp.where(last, horizon - loop.origin, segment.duration)
    remaining = jnp.maximum(finish - loop.t_local, 0.0)
    piece = attempt(system, segment, loop, finely.method, finely.tolerance, remaining, opaque_one)
    duration, event, which, x = until_event(system, segment, loop, piece, opaque_one)
    t_local = loop.t_local + duration
    ended = ~event & (duration >= remaining)
    corner = ended & ~last
    x, mode, becomes_settled = _afterwards(
        system, segment, loop, t_local, x, event, which, ended, finely.settle_tolerance, opaque_one
    )
    x = kept(x, opaque_one)
    row = written(
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
    opens, repeats = new_period(cycle, system, finely.settle_tolerance, unflatten, loop, ahead, x, mode, corner)
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


def attempt(
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
    units = [scale / tolerance for scale in jax.tree.leaves(system.error_scale(unflatten(loop.x)))]
    field = field_of(system, segment, unflatten, loop.mode)
    closed = system.closed_components()
    allowed = longest_step(field, loop.t_local, loop.x, loop.mode, closed, method.span, remaining)
    piece = method.attempt(field, loop.t_local, list(loop.x), units, allowed, loop.proposed_step, opaque_one)
    motion = unflatten([polynomial(c) for c in piece.polynomials])
    extra = cast("tuple[Series, ...]", system.extra_error_terms(motion, loop.mode))
    return shortened(piece, extra, tolerance, opaque_one) if extra else piece


def until_event(
    system: AbstractHybridSystem, segment: InputSegment, loop: LoopState, piece: Piece, opaque_one: Scalar
) -> tuple[Scalar, Truth, Scalar, State]:
    """How long the piece is used [s], whether an event ends it, of which guard, and the state there."""
    unflatten = unflattener(system)
    clock = polynomial([loop.t_local, 1.0])
    motion = unflatten([polynomial(c) for c in piece.polynomials])
    size = len(piece.polynomials[0])
    guards, size = system.guards_along(segment, clock, motion, loop.mode, size, piece.step_radius)
    duration, event, which = first_crossing(guards, size, piece.step_radius)
    duration = duration / opaque_one
    x = [horner(c, duration) for c in piece.polynomials]
    x = system.exact(segment, loop.t_local, unflatten(loop.x), duration, unflatten(x))
    return duration, event, which, kept(x, opaque_one)


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
