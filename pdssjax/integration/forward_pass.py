"""The march: every step of a run, found without derivatives.

A bare `while_loop` on a handful of scalars.  It writes one row a step to a table; `tangents`
expands the rows again, in value and in derivative.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from .crossing import first_crossing
from .expansion import AbstractExpansion, Taylor, horner, shortened
from .series import polynomial

_BLOCK = 5
"""Steps written to memory at a time: XLA runs a loop on small buffers two to three times faster."""

_FORCED = 1.5
"""So many times longer a step may be for what is known in closed form, and only enters the rest as a forcing."""

RESTING = 2.0
"""The mode of a system that has settled until the next corner; no guard ends it."""

CORNER, SETTLES, EVENT, WHICH = 1, 2, 4, 8
"""Bits of the code of a step, how it ended; the number of the guard that ended it follows from `WHICH` on."""

KNOWN = 5
"""Columns of the table behind the time and the state: index, mode, reach, length, code."""


class Accuracy(eqx.Module):
    """How finely to integrate."""

    tolerance: float = 1e-13
    """Local error allowed in one step, as a displacement [m]; hundreds of steps and reversals make 1e-10 m of it."""
    rest: float = 3e-13
    """Deviation [m] from the steady solution below which the rest of a segment is not stepped."""
    method: AbstractExpansion = Taylor(16)
    """The one-step method for the smooth pieces."""
    max_steps: int = eqx.field(static=True, default=8192)
    """Room for this many steps; a march that needs more ends there and says so."""

    @property
    def resting(self):
        """`rest`, but above the noise of the method."""
        return jnp.maximum(self.rest, self.method.noise * self.tolerance)


class Walk(NamedTuple):
    """The carry of the march, scalars only, so that the loop is fast; at the end its outcome."""

    index: Any
    origin: Any
    after: Any
    x: tuple
    mode: Any
    trial: Any
    count: Any
    rejected: Any
    events: Any
    failure: Any
    done: Any
    opened: tuple
    """State with which the last period of the drive began."""
    rested: Any
    """That state was at rest."""
    period: Any
    repeats: Any


def find_steps(system: Any, horizon: Any, accuracy: Accuracy) -> tuple[Any, Walk]:
    """Every step from t = 0 to the horizon: the table of steps, and the last carry."""
    finely = _fineness(accuracy)
    walk = _outset(system)
    start, unpack = _packed(walk)
    width = 2 + len(walk.x) + KNOWN
    blocks = -(-accuracy.max_steps // _BLOCK)
    done = lambda packed: unpack(packed).done > 0

    def step(carry):
        packed, filled, block = carry
        moved, row, accepted = _one_step(system, horizon, *finely, unpack(packed), True)
        block = lax.dynamic_update_index_in_dim(block, row, filled, 0)
        return _packed(moved)[0], filled + accepted, block

    def steps(carry):
        packed, table, used = carry
        empty = (packed, jnp.zeros((), int), jnp.zeros((_BLOCK, width)))
        packed, _, block = lax.while_loop(lambda c: (c[1] < _BLOCK) & ~done(c[0]), step, empty)
        return packed, lax.dynamic_update_slice_in_dim(table, block, used * _BLOCK, 0), used + 1

    packed, table, _ = lax.while_loop(
        lambda c: (c[2] < blocks) & ~done(c[0]), steps, (start, jnp.zeros((blocks * _BLOCK, width)), 0)
    )
    walk = unpack(packed)
    counts = ("count", "rejected", "events", "period", "failure")
    whole = {name: getattr(walk, name).astype(int) for name in counts}
    whole["failure"] = jnp.where(walk.done > 0, whole["failure"], 1)
    return table, walk._replace(**whole, repeats=walk.repeats > 0)


def pass_times(system: Any, times: Any, accuracy: Accuracy) -> tuple[Any, Any, Any, Any]:
    """The state at each of the ascending `times` [s], shape (m,), without keeping the steps between.

    For sweeps: little memory, no derivatives, no repetition of periods.

    **Returns:** the state, every leaf of shape (m,); steps accepted, rejected, and the failure
    as in `Walk`.
    """
    finely = _fineness(accuracy)
    start, unpack = _packed(_outset(system))

    def go(packed, time):
        walk = unpack(packed)
        packed = _packed(walk._replace(done=jnp.where(walk.failure > 0, 1.0, 0.0)))[0]
        running = lambda packed: (unpack(packed).done == 0) & (unpack(packed).count < accuracy.max_steps)
        step = lambda packed: _packed(_one_step(system, time, *finely, unpack(packed), False)[0])[0]
        packed = lax.while_loop(running, step, packed)
        return packed, jnp.stack(unpack(packed).x)

    packed, states = lax.scan(go, start, times)
    walk = unpack(packed)
    failure = jnp.where((walk.done == 0) & (walk.failure == 0), 1.0, walk.failure).astype(int)
    return unflattener(system)(states.T), walk.count.astype(int), walk.rejected.astype(int), failure


def _outset(system: Any) -> Walk:
    """The carry before the first step."""
    zero = jnp.zeros(())
    first, mode = begin(system)
    leaves = tuple(jax.tree.leaves(first))
    nothing: Any = zero
    blank = Walk(*[nothing] * len(Walk._fields))
    return blank._replace(x=leaves, opened=leaves, mode=mode, trial=zero + 1e-6)


def _fineness(accuracy: Accuracy) -> tuple[AbstractExpansion, Any, Any, Any]:
    """What a step needs to know of the accuracy: method, tolerance, rest, and how many rejections are too many."""
    array = lambda number: jnp.asarray(number, float)
    return accuracy.method, array(accuracy.tolerance), array(accuracy.resting), array(2.0 * accuracy.max_steps)


# Traced once for values and once for derivatives: search, fit and prediction differ in numbers only.
@eqx.filter_jit
def _one_step(system, horizon, method, tolerance, resting, patience, walk, repeating):
    """One attempt: the new carry, its row for the table, and whether it was accepted."""
    unflatten = unflattener(system)
    one = 1.0 + 0.0 * walk.count
    segment = system.segment(walk.index)
    units = [scale / tolerance for scale in jax.tree.leaves(system.scales())]
    last = walk.origin + segment.duration >= horizon
    finish = jnp.where(last, horizon - walk.origin, segment.duration)
    remaining = jnp.maximum(finish - walk.after, 0.0)
    field = field_of(system, segment, unflatten, walk.mode)
    allowed = remaining
    rate = _quickest_rate(field, walk.after, walk.x, system.closed_components())
    too_far = (walk.mode != RESTING) & (allowed * rate > method.span)
    allowed = jnp.where(too_far, method.span / rate, allowed)
    piece = method.attempt(field, walk.after, list(walk.x), units, allowed, walk.trial, one)

    hidden = system.hidden(unflatten([polynomial(c) for c in piece.polynomials]), walk.mode)
    piece = shortened(piece, hidden, tolerance, one) if hidden else piece
    clock = polynomial([walk.after, piece.reach])
    motion = unflatten([polynomial(c) for c in piece.polynomials])
    guards = system.guards(segment, clock, motion, walk.mode)
    crossing, which = first_crossing(guards, len(piece.polynomials[0]), piece.reach)
    crossing = crossing / one
    event = crossing < 1.0
    length = piece.reach * crossing
    after = walk.after + length
    x = [horner(c, crossing) for c in piece.polynomials]
    x = system.exact(segment, walk.after, unflatten(walk.x), length, unflatten(x))
    x = _kept(x, one)
    ended = ~event & (piece.reach >= remaining)
    corner = ended & ~last

    switched, mode = system.switch(segment, after, x, walk.mode, which)
    x = jax.tree.map(lambda a, b: jnp.where(event, a, b), switched, x)
    mode = jnp.where(event, mode, walk.mode) / one
    settles = ~ended & system.settled(segment, after, x, mode, resting)
    settles = jnp.where(settles, 1.0, 0.0) / one
    settled = system.settle(segment, after, x, mode)
    x = jax.tree.map(lambda a, b: jnp.where(settles > 0, a, b), settled, x)
    mode = jnp.where(settles > 0, RESTING, mode)

    x = _kept(x, one)
    row = _row(walk, piece.reach, length, corner * CORNER + settles * SETTLES + event * (EVENT + WHICH * which))
    ahead = walk.index + 1.0
    entered, opening = system.enter(system.segment(ahead), x, mode)
    if system.alters:
        x = jax.tree.map(lambda a, b: jnp.where(corner, a, b), entered, x)
    opening = opening / one
    cycle = system.period() if repeating else None
    opens, repeats = _new_period(cycle, system, resting, unflatten, walk, ahead, x, mode, corner)
    finite = jnp.isfinite(sum(jax.tree.leaves(x))) & (length >= 0)
    hopeless = ~piece.accepted & (walk.rejected > patience)
    failure = jnp.where((piece.accepted & ~finite) | hopeless, 2.0, 0.0)
    moved = Walk(
        index=walk.index + corner,
        origin=jnp.where(corner, walk.origin + segment.duration, walk.origin),
        after=jnp.where(corner, 0.0, after),
        x=tuple(jax.tree.leaves(x)),
        mode=jnp.where(corner, opening, mode),
        trial=piece.following,
        count=walk.count + 1,
        rejected=walk.rejected,
        events=walk.events + event,
        failure=failure,
        done=((ended & last) | repeats | (failure > 0)) * 1.0,
        opened=tuple(jnp.where(opens, a, b) for a, b in zip(jax.tree.leaves(x), walk.opened, strict=True)),
        rested=jnp.where(opens, (mode == RESTING) * 1.0, walk.rested),
        period=jnp.where(opens & ~repeats, walk.count + 1, walk.period),
        repeats=repeats * 1.0,
    )
    again = walk._replace(
        trial=piece.following, rejected=walk.rejected + 1, failure=failure, done=jnp.where(failure > 0, 1.0, 0.0)
    )
    walk = jax.tree.map(lambda a, b: jnp.where(piece.accepted, a, b), moved, again)
    return walk, row, piece.accepted


def _quickest_rate(field, after, x, closed):
    """About the largest modulus [1/s] of the eigenvalues of the field's Jacobian at `x`; see `span` of the methods.

    A transient that has died out has coefficients that vanish and allow any step.  What the same step
    does to derivatives is not seen there: beyond the method's region of stability they grow, and with them
    what is left of rounding, from step to step.  Two components a, b that feel each other turn or decay at
    the rate sqrt|J_ab J_ba|, whatever their units; what only one of them feels changes no eigenvalue.
    """

    def flow(x):
        return jnp.stack([jnp.asarray(rate, float) for rate in field(after, list(x))])

    jacobian = jax.jacfwd(flow)(jnp.stack(x))
    known = np.isin(np.arange(len(x)), closed)
    weight = np.where(known, 1.0 / _FORCED**2, 1.0)
    mutual = jnp.abs(jacobian * jacobian.T) * weight
    return jnp.sqrt(jnp.max(jnp.sum(jnp.where(jnp.isfinite(mutual), mutual, 0.0), axis=1)))


def _kept(tree, one):
    """`tree` as computed once: XLA repeats cheap scalars in every consumer, but no division.

    `one` is 1 in a way that the compiler cannot know.
    """
    packed, unpack = _packed(tree)
    return unpack(packed / one)


def _packed(tree):
    """The scalars of `tree` as one vector, and the way back."""
    leaves, structure = jax.tree.flatten(tree)
    return jnp.stack(leaves), lambda packed: jax.tree.unflatten(structure, [packed[i] for i in range(len(leaves))])


def _row(walk, reach, length, code):
    return jnp.stack([walk.origin, walk.after, *walk.x, walk.index, walk.mode, reach, length, code])


def _new_period(cycle, system, resting, unflatten, walk, ahead, x, mode, corner):
    """Whether a period of the drive opens here, and whether it repeats the last one.

    It does where both began at rest and in the same state but for a shift: a contact may
    also rest while it sticks, each time with another force, or while the platform rings.
    """
    if cycle is None:
        return False, jnp.zeros((), bool)
    first, every = cycle
    opens = corner & (ahead >= first) & ((ahead - first) % every == 0)
    # Each is within `rest` of the steady solution; the factor keeps that from looking like a difference.
    alike = system.alike(x, unflatten(walk.opened), 4.0 * resting)
    return opens, opens & (walk.rested > 0) & (mode == RESTING) & alike


def begin(system: Any) -> tuple[Any, Any]:
    """State and mode in which the first segment begins."""
    zero = jnp.zeros(())
    return system.enter(system.segment(zero), system.initial(), zero)


def field_of(system: Any, segment: Any, unflatten: Callable, mode: Any) -> Callable:
    """The field of one mode on lists of scalars, as the methods want it."""
    return lambda after, x: jax.tree.leaves(system.field(segment, after, unflatten(x), mode))


def unflattener(system: Any) -> Callable:
    """Makes a state of `system` from its components."""
    tree = jax.tree.structure(system.initial())
    return lambda leaves: jax.tree.unflatten(tree, list(leaves))
