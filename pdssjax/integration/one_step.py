"""One step of the forward pass: a smooth piece, the event or the corner that ends it, and what follows.

A step spans a limited number of time constants of the quickest transient, so that derivatives do not grow over it
(docs/numerics.md, "Steps that derivatives can bear").
"""

from collections.abc import Sequence
from typing import NamedTuple, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import Scalar, Truth
from .accuracy import Accuracy
from .event_location import first_crossing
from .polynomials import horner
from .step_methods.base import AbstractStepMethod, Piece
from .step_methods.taylor import shortened
from .step_table import BECAME_SETTLED, CORNER, EVENT, WHICH, LoopState, barrier, table_row
from .system import SETTLED, AbstractHybridSystem, InputSegment, State, field_of, has_guards, unflattener
from .taylor_series import Field, Series, constant, polynomial
from .tracing import choose_each

_FORCED = 1.5
"""Factor by which a step may be longer for components known in closed form, which act on the others as a forcing."""


def longest_step(
    field: Field,
    t_local: Scalar,
    x: Sequence[Scalar],
    mode: Scalar,
    closed: Sequence[int],
    span: float,
    remaining: Scalar,
) -> Scalar:
    """How long a step [s] from `x` at `t_local` [s] may be: the `remaining` time [s], or less where derivatives grow.

    A settled state does not move, and has no bound.

    **Arguments:** `closed` are the numbers of the components that are known in closed form; `span` is that of the
    method, in time constants.
    """
    rate = _quickest_rate(field, t_local, x, closed)
    too_far = (mode != SETTLED) & (remaining * rate > span)
    return jnp.where(too_far, span / rate, remaining)


def _quickest_rate(field: Field, t_local: Scalar, x: Sequence[Scalar], closed: Sequence[int]) -> Scalar:
    """Estimated largest modulus [1/s] of the eigenvalues of the field's Jacobian at `x`; see `span` of the methods.

    Once a transient has decayed, the error of the state allows any step.  Outside the method's region of stability
    derivatives and what rounding leaves still grow from step to step.  Two components a, b that act on each other turn
    or decay at the rate sqrt|J_ab J_ba|, whatever their units; if only one acts on the other, no eigenvalue changes.
    """

    def flow(x: Float[Array, " components"]) -> Float[Array, " components"]:
        return jnp.stack([jnp.asarray(constant(rate), float) for rate in field(t_local, list(x))])

    jacobian = jax.jacfwd(flow)(jnp.stack(x))
    weight = np.where(np.isin(np.arange(len(x)), closed), 1.0 / _FORCED**2, 1.0)
    mutual = jnp.abs(jacobian * jacobian.T) * weight
    return jnp.sqrt(jnp.max(jnp.sum(jnp.where(jnp.isfinite(mutual), mutual, 0.0), axis=1)))


def new_period(
    cycle: tuple[int, int] | None,
    system: AbstractHybridSystem,
    settle_tolerance: Scalar,
    loop: LoopState,
    ahead: Scalar,
    x: State,
    mode: Scalar,
    corner: Truth,
) -> tuple[Truth | bool, Truth]:
    """Whether a period of the drive opens here, and whether it repeats the last one.

    A period repeats the last one if both began settled and in the same state but for a shift.  That nothing slides is
    not enough: a contact that sticks can rest at another force each time, or while the platform rings.
    """
    if cycle is None:
        return False, jnp.zeros((), bool)
    first, every = cycle
    opens = corner & (ahead >= first) & ((ahead - first) % every == 0)
    # Each state is within the tolerance of the steady solution; the factor keeps that from looking like a difference.
    same = system.same_state(x, unflattener(system)(loop.period_start), 4.0 * settle_tolerance)
    return opens, opens & (loop.period_start_settled > 0) & (mode == SETTLED) & same


class StepControl(NamedTuple):
    """The settings of an `Accuracy` that a step needs, with its tolerances as arrays."""

    method: AbstractStepMethod
    tolerance: Scalar
    settle_tolerance: Scalar
    patience: Scalar
    """A rejection after so many others is a failure."""


def step_control(accuracy: Accuracy) -> StepControl:
    array = lambda number: jnp.asarray(number, float)
    return StepControl(
        accuracy.method,
        array(accuracy.tolerance),
        array(accuracy.effective_settle_tolerance),
        array(2.0 * accuracy.max_steps),
    )


# Traced once for values and once for derivatives: search, fit and prediction differ in numbers only.
@eqx.filter_jit
def one_step(
    system: AbstractHybridSystem, horizon: Scalar, control: StepControl, loop: LoopState, repeating: bool
) -> tuple[LoopState, Float[Array, " columns"], Truth]:
    """One attempted step: the new carry, its row for the table, and whether it was accepted."""
    opaque_one = 1.0 + 0.0 * loop.count
    segment = system.segment(loop.index)
    last = loop.origin + segment.duration >= horizon
    finish = jnp.where(last, horizon - loop.origin, segment.duration)
    remaining = jnp.maximum(finish - loop.t_local, 0.0)
    piece = attempt(system, segment, loop, control.method, control.tolerance, remaining, opaque_one)
    duration, event, which, x = until_event(system, segment, loop, piece, opaque_one)
    t_local = loop.t_local + duration
    ended = ~event & (duration >= remaining)
    corner = ended & ~last
    x, mode, becomes_settled = _after_step(
        system, segment, loop, t_local, x, event, which, ended, control.settle_tolerance, opaque_one
    )
    x = barrier(x, opaque_one)
    code = corner * CORNER + becomes_settled * BECAME_SETTLED + event * (EVENT + WHICH * which)
    row = table_row(loop, piece.step_size, duration, code)
    ahead = loop.index + 1.0
    started, opening = system.on_segment_start(system.segment(ahead), x, mode)
    if system.resets_at_corners:
        x = choose_each(corner, started, x)
    opening = opening / opaque_one
    cycle = system.period() if repeating else None
    opens, repeats = new_period(cycle, system, control.settle_tolerance, loop, ahead, x, mode, corner)
    finite = jnp.isfinite(sum(jax.tree.leaves(x))) & (duration >= 0)
    hopeless = ~piece.accepted & (loop.rejected > control.patience)
    failure = jnp.where((piece.accepted & ~finite) | hopeless, 2.0, 0.0)
    accepted = LoopState(
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
        period_start=choose_each(opens, tuple(jax.tree.leaves(x)), loop.period_start),
        period_start_settled=jnp.where(opens, (mode == SETTLED) * 1.0, loop.period_start_settled),
        period=jnp.where(opens & ~repeats, loop.count + 1, loop.period),
        repeats=repeats * 1.0,
    )
    rejected = loop._replace(
        proposed_step=piece.next_proposed_step,
        rejected=loop.rejected + 1,
        failure=failure,
        done=jnp.where(failure > 0, 1.0, 0.0),
    )
    return choose_each(piece.accepted, accepted, rejected), row, piece.accepted


def attempt(
    system: AbstractHybridSystem,
    segment: InputSegment,
    loop: LoopState,
    method: AbstractStepMethod,
    tolerance: Scalar,
    remaining: Scalar,
    opaque_one: Scalar,
) -> Piece:
    """A smooth piece that resolves the state and the system's extra error terms, over which no derivative grows."""
    unflatten = unflattener(system)
    error_weights = [scale / tolerance for scale in jax.tree.leaves(system.error_scale(unflatten(loop.x)))]
    field = field_of(system, segment, unflatten, loop.mode)
    allowed = longest_step(field, loop.t_local, loop.x, loop.mode, system.closed_components(), method.span, remaining)
    piece = method.attempt(field, loop.t_local, list(loop.x), error_weights, allowed, loop.proposed_step, opaque_one)
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
    guards, size = system.guards_along(segment, clock, motion, loop.mode, size, piece.step_size)
    duration, event, which = first_crossing(guards, size, piece.step_size)
    # Many places need these, and must agree: computed again they may differ by rounding.
    duration, event, which = barrier((duration, event * 1.0, which), opaque_one)
    event = event > 0.0
    x = [horner(c, duration) for c in piece.polynomials]
    x = system.exact(segment, loop.t_local, unflatten(loop.x), duration, unflatten(x))
    return duration, event, which, barrier(x, opaque_one)


def _after_step(
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
    """State and mode after the event, if there was one, and 1 where the motion has settled."""
    mode = loop.mode
    if has_guards(system, segment, t_local, x, mode):
        switched, following = system.after_event(segment, t_local, x, mode, which)
        x = choose_each(event, switched, x)
        mode = jnp.where(event, following, mode) / opaque_one
    becomes_settled = ~ended & system.is_settled(segment, t_local, x, mode, settle_tolerance)
    becomes_settled = jnp.where(becomes_settled, 1.0, 0.0) / opaque_one
    projected = system.project_to_steady(segment, t_local, x, mode)
    x = choose_each(becomes_settled > 0, projected, x)
    return x, jnp.where(becomes_settled > 0, SETTLED, mode), becomes_settled
