"""Event-located integration of a hybrid system on one-step solvers, with right gradients.

The system is smooth in each of its modes.  A step never leaves the mode it began in: where
the guard falls through zero within a step, the step is cut there, and the next begins in
the mode that follows.  Corners of the drive cut steps in the same way.

Gradients.  The sequence of steps (the march) is found without derivatives.  Its tangents
follow afterwards: every step is linearised about its own start, all of them side by side,
and a linear recurrence joins them.  The end of a step at an event or a corner moves with
the parameters by dt* = -dg / (dg/dt); since the local time is part of the state, the state
moves along the field by that much, and what the field does after the switch follows in the
next step.  This is the saltation matrix, without writing it down (P. C. Müller, Chaos,
Solitons & Fractals 5(9), 1995).  The recurrence is an ordinary linear scan, so forward
and reverse mode both work.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax

from .expansion import AbstractExpansion, Taylor, horner
from .series import Series, polynomial

_BLOCK = 5
"""Steps written to memory at a time: XLA runs a loop on small buffers two to three times faster."""
_TILE = 32
"""Steps expanded or linearised side by side."""
_SAMPLES = 6
"""Points of a step at which the sign of the guard is looked at."""
_ROOT_ITERATIONS = 8
"""Iterations that locate an event within its bracket, to rounding."""

RESTING = 2.0
"""The mode of a system that has settled until the next corner; no guard ends it."""

_CORNER, _SETTLES, _EVENT = 1, 2, 4

FAILURES = (
    "",
    "the march ran out of room before the end of the record; try a larger `max_steps`",
    "the motion did not stay finite",
)


class Accuracy(eqx.Module):
    """How finely to integrate."""

    tolerance: float = 1e-11
    """Local error allowed in one step, as a displacement [m]."""
    rest: float = 1e-12
    """Deviation [m] from the steady solution below which the rest of a segment is not stepped."""
    method: AbstractExpansion = Taylor(12)
    """The one-step method for the smooth pieces."""
    max_steps: int = eqx.field(static=True, default=4096)
    """Room for this many steps; a march that needs more ends there and says so."""


class Steps(NamedTuple):
    """The steps of a run, in order; the first axis has room to spare."""

    index: Any
    """Segment of the drive, counted from 0."""
    mode: Any
    reach: Any
    """Length for which the polynomials were made [s]."""
    length: Any
    """Length for which they are used: up to an event, a corner or the reach [s]."""
    origin: Any
    """Time at which the segment begins [s]."""
    after: Any
    """Local time at which the step begins, from the corner on [s]."""
    x: Any
    """State at the beginning, shape (room, n)."""
    polynomials: Any
    """Coefficients in (time - begin)/reach, shape (room, components kept, degree + 1)."""


class March(NamedTuple):
    """All that a run leaves behind."""

    steps: Steps
    end: Any
    """(time [s], state) where the march stopped."""
    period: Any
    """Step with which the last period of the drive began."""
    repeats: Any
    """From `end` on the motion repeats that period."""
    count: Any
    rejected: Any
    events: Any
    failure: Any
    """Index into `FAILURES`; 0 where the march finished."""


class _Walk(NamedTuple):
    """The carry of the march: scalars only, so that the loop is fast."""

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
    rested: Any
    period: Any
    repeats: Any


def march(system: Any, horizon: Any, accuracy: Accuracy, keep: tuple[int, ...] | None = None) -> March:
    """Integrates `system` from its initial state at t = 0 to `horizon` [s].

    Differentiable in every floating-point leaf of `system`, but not in `horizon`.  `keep`
    names the components of the state wanted between the steps, all by default: fewer
    spare memory and time.
    """
    keep = tuple(range(len(jax.tree.leaves(system.initial())))) if keep is None else keep
    horizon = lax.stop_gradient(jnp.asarray(horizon, float))
    begins, end, polynomials, rest = _march(system, horizon=horizon, accuracy=accuracy, keep=keep)
    known, walk = rest
    steps = Steps(**known, origin=begins[:, 0], after=begins[:, 1], x=begins[:, 2:], polynomials=polynomials)
    return March(
        steps,
        (end[0] + end[1], end[2:]),
        walk.period,
        walk.repeats,
        walk.count,
        walk.rejected,
        walk.events,
        walk.failure,
    )


def states_at(
    system: Any, run: March, times: Any, keep: tuple[int, ...] | None = None
) -> tuple[Any, Any, Any, Any]:
    """The state at `times` [s], shape (m,), each within the march or its repetition.

    **Returns:** the state (one array (m,) a component), its segment, the local time and
    the mode, vectorised over the times.  Components outside `keep`, as given to `march`,
    are those of the step's beginning unless the system knows them in closed form.
    """
    steps = run.steps
    start = steps.origin[run.period]
    stop, x_stop = run.end
    cycle = jnp.where(run.repeats, stop - start, 1.0)
    laps = jnp.where(run.repeats, jnp.maximum(jnp.floor((times - stop) / cycle) + 1.0, 0.0), 0.0)
    laps = lax.stop_gradient(laps)
    within = times - laps * cycle
    begins = steps.origin + steps.after
    real = jnp.arange(begins.shape[0]) < run.count
    ordered = jnp.where(real, lax.stop_gradient(begins), jnp.inf)
    j = jnp.clip(jnp.searchsorted(ordered, lax.stop_gradient(within), side="right") - 1, 0)
    lapse = jnp.maximum(within - begins[j], 0.0)
    reach = steps.reach[j]
    theta = lapse / jnp.where(reach > 0, reach, 1.0)
    polynomials = steps.polynomials[j]
    unflatten = _unflatten(system)
    degree = polynomials.shape[-1]
    shown = horner([polynomials[:, :, k] for k in range(degree)], theta[:, None])
    values = shown if keep is None else steps.x[j].at[:, jnp.array(keep)].set(shown)
    gained = (x_stop - steps.x[run.period]) * laps[:, None]

    def finish(index, after, begin, lapse, end):
        return system.exact(system.segment(index), after, unflatten(begin), lapse, unflatten(end))

    x = jax.vmap(finish)(steps.index[j], steps.after[j], steps.x[j], lapse, values)
    x = jax.tree.map(jnp.add, x, jax.vmap(unflatten)(gained))
    segment = jax.vmap(system.segment)(steps.index[j])
    return x, segment, steps.after[j] + lapse, steps.mode[j]


@eqx.filter_custom_jvp
def _march(system, *, horizon, accuracy, keep):
    table, walk = _walk_all(system, horizon, accuracy)

    def tile(carry, rows, real):
        return carry, jax.vmap(lambda row: _advance(system, accuracy, keep, row)[1])(rows)

    # The loop itself keeps no polynomials: a carry that large would slow it down.
    return _outcome(table, walk, _tiled(tile, None, table, walk.count)[1])


@_march.def_jvp
def _march_jvp(primals, tangents, *, horizon, accuracy, keep):
    (system,), (system_dot,) = primals, tangents
    table, walk = _walk_all(system, horizon, accuracy)
    size = table.shape[1] - _KNOWN

    def linearise(row):
        begin, known = row[:size], row[size:]

        def flow(begin, system):
            return _advance(system, accuracy, keep, jnp.concatenate([begin, known]))

        (_, polynomials), driven = eqx.filter_jvp(lambda s: flow(begin, s), (system,), (system_dot,))
        return polynomials, driven, jax.jacfwd(lambda b: flow(b, system))(begin)

    def join(tangent, step):
        real, matrix, vector = step
        moved = jnp.sum(matrix * tangent, axis=-1) + vector
        return jnp.where(real, moved, tangent), tangent

    def tile(tangent, rows, real):
        polynomials, driven, slopes = jax.vmap(linearise)(rows)
        end, begins = lax.scan(join, tangent, (real, slopes[0], driven[0]))
        moved = jnp.sum(slopes[1] * begins[:, None, None, :], axis=-1)
        return end, (begins, polynomials, moved + driven[1])

    end_dot, (begins_dot, polynomials, polynomials_dot) = _tiled(tile, jnp.zeros(size), table, walk.count)
    out = _outcome(table, walk, polynomials)
    nothing = jax.tree.map(lambda _: None, out[3])
    return out, (begins_dot, end_dot, polynomials_dot, nothing)


_KNOWN = 5
"""Columns of the table behind the state: index, mode, reach, length, code."""


def _outcome(table, walk, polynomials):
    size = table.shape[1] - _KNOWN
    index, mode, reach, length, _ = table[:, size:].T
    known = dict(index=index, mode=mode, reach=reach, length=length)
    end = jnp.stack([walk.origin, walk.after, *walk.x])
    return table[:, :size], end, polynomials, (known, walk)


def _walk_all(system, horizon, accuracy):
    """Every step from t = 0 to the horizon: the table of steps, and the last carry."""
    unflatten = _unflatten(system)
    first = system.initial()
    zero = jnp.zeros(())
    mode = system.enter(system.segment(zero), first, zero)
    blank = dict.fromkeys(_Walk._fields, zero)
    walk = _Walk(**blank | {"x": tuple(jax.tree.leaves(first)), "mode": mode, "trial": zero + 1e-6})
    start, unpack = _packed(walk)
    width = 2 + len(walk.x) + _KNOWN
    blocks = -(-accuracy.max_steps // _BLOCK)
    done = lambda packed: unpack(packed).done > 0

    def step(carry):
        packed, filled, block = carry
        moved, row, accepted = _one_step(system, horizon, accuracy, unflatten, unpack(packed))
        block = lax.dynamic_update_index_in_dim(block, row, filled, 0)
        return _packed(moved)[0], filled + accepted, block

    def steps(carry):
        packed, table, used = carry
        empty = (packed, jnp.zeros((), int), jnp.zeros((_BLOCK, width)))
        packed, _, block = lax.while_loop(lambda c: (c[1] < _BLOCK) & ~done(c[0]), step, empty)
        return packed, lax.dynamic_update_slice_in_dim(table, block, used * _BLOCK, 0), used + 1

    packed, table, used = lax.while_loop(
        lambda c: (c[2] < blocks) & ~done(c[0]), steps, (start, jnp.zeros((blocks * _BLOCK, width)), 0)
    )
    walk = unpack(packed)
    counts = ("count", "rejected", "events", "period", "failure")
    whole = {name: getattr(walk, name).astype(int) for name in counts}
    whole["failure"] = jnp.where(walk.done > 0, whole["failure"], 1)
    return table, walk._replace(**whole, repeats=walk.repeats > 0)


def _one_step(system, horizon, accuracy, unflatten, walk):
    """One attempt: the new carry, its row for the table, and whether it was accepted."""
    one = 1.0 + 0.0 * walk.count
    segment = system.segment(walk.index)
    units = [scale / accuracy.tolerance for scale in jax.tree.leaves(system.scales())]
    last = walk.origin + segment.duration >= horizon
    finish = jnp.where(last, horizon - walk.origin, segment.duration)
    remaining = jnp.maximum(finish - walk.after, 0.0)
    field = _field(system, segment, unflatten, walk.mode)
    piece = accuracy.method.attempt(field, walk.after, list(walk.x), units, remaining, walk.trial, one)

    clock = polynomial([walk.after, piece.reach])
    motion = unflatten([polynomial(c) for c in piece.polynomials])
    guards = system.guards(segment, clock, motion, walk.mode)
    crossing = _first_crossing(guards, len(piece.polynomials[0])) / one
    event = crossing < 1.0
    length = piece.reach * crossing
    after = walk.after + length
    x = [horner(c, crossing) for c in piece.polynomials]
    x = system.exact(segment, walk.after, unflatten(walk.x), length, unflatten(x))
    x = _kept(x, one)
    ended = ~event & (piece.reach >= remaining)
    corner = ended & ~last

    switched, mode = system.switch(segment, after, x, walk.mode)
    x = jax.tree.map(lambda a, b: jnp.where(event, a, b), switched, x)
    mode = jnp.where(event, mode, walk.mode) / one
    settles = ~ended & system.settled(segment, after, x, mode, accuracy.rest)
    settles = jnp.where(settles, 1.0, 0.0) / one
    settled = system.settle(segment, after, x, mode)
    x = jax.tree.map(lambda a, b: jnp.where(settles > 0, a, b), settled, x)
    mode = jnp.where(settles > 0, RESTING, mode)

    x = _kept(x, one)
    row = _row(walk, piece.reach, length, corner * _CORNER + settles * _SETTLES + event * _EVENT)
    ahead = walk.index + 1.0
    entered = system.enter(system.segment(ahead), x, mode) / one
    opens, repeats, rested = _new_period(system, walk, ahead, mode, corner)
    finite = jnp.isfinite(sum(jax.tree.leaves(x))) & (length >= 0)
    hopeless = ~piece.accepted & (walk.rejected > 2 * accuracy.max_steps)
    failure = jnp.where((piece.accepted & ~finite) | hopeless, 2.0, 0.0)
    moved = _Walk(
        index=walk.index + corner,
        origin=jnp.where(corner, walk.origin + segment.duration, walk.origin),
        after=jnp.where(corner, 0.0, after),
        x=tuple(jax.tree.leaves(x)),
        mode=jnp.where(corner, entered, mode),
        trial=piece.following,
        count=walk.count + 1,
        rejected=walk.rejected,
        events=walk.events + event,
        failure=failure,
        done=((ended & last) | repeats | (failure > 0)) * 1.0,
        rested=rested,
        period=jnp.where(opens & ~repeats, walk.count + 1, walk.period),
        repeats=repeats * 1.0,
    )
    again = walk._replace(
        trial=piece.following, rejected=walk.rejected + 1, failure=failure, done=jnp.where(failure > 0, 1.0, 0.0)
    )
    walk = jax.tree.map(lambda a, b: jnp.where(piece.accepted, a, b), moved, again)
    return walk, row, piece.accepted


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


def _new_period(system, walk, ahead, mode, corner):
    """Whether a period of the drive opens here, and whether it repeats the last one.

    It does where both began at rest: then they began in the same state but for a shift.
    """
    cycle = system.period()
    if cycle is None:
        return False, jnp.zeros((), bool), walk.rested
    first, every = cycle
    opens = corner & (ahead >= first) & ((ahead - first) % every == 0)
    rested = jnp.where(opens, jnp.where(mode == RESTING, 1.0 + walk.rested, 0.0), walk.rested)
    return opens, opens & (rested >= 2), rested


def _first_crossing(guards: tuple[Series, ...], size: int) -> Any:
    """The first theta in (0, 1] at which one of the guards has fallen through zero, else 1.

    Right after an event a guard starts from zero; one power of theta is then divided out,
    which takes the root at the start away.  An end point of exactly 1 is no crossing.
    """
    first = 2.0
    for guard in guards:
        first = jnp.minimum(first, _crossing([jnp.asarray(guard[k], float) for k in range(size)]))
    return jnp.where(first > 1.0, 1.0, jnp.minimum(first, 1.0 - 1e-15))


def _crossing(coefficients: list) -> Any:
    """The first root in (0, 1], or 2: bracketed by samples, then Newton's method.

    The slope is inverted by Newton's method as well (r <- r (2 - g' r)): without a
    division the compiler makes one kernel of it all.
    """
    fresh = coefficients[0] <= 0.0
    shifted = [*coefficients[1:], 0.0 * coefficients[0]]
    g = [jnp.where(fresh, b, a) for a, b in zip(coefficients, shifted, strict=True)]
    slope = [k * c for k, c in enumerate(g)][1:]
    low, g_low, high, g_high = 0.0, g[0], 1.0, g[0]
    found, before, g_before = jnp.zeros_like(fresh), low, g_low
    for i in range(1, _SAMPLES + 1):
        value = horner(g, i / _SAMPLES)
        hit = ~found & (value < 0.0)
        low, g_low = jnp.where(hit, before, low), jnp.where(hit, g_before, g_low)
        high, g_high = jnp.where(hit, i / _SAMPLES, high), jnp.where(hit, value, g_high)
        found, before, g_before = found | hit, i / _SAMPLES, value
    at_once = found & (g_low <= 0.0)
    gap = jnp.where(g_low > g_high, g_low - g_high, 1.0)
    inverse = (low - high) / gap
    root = low - g_low * inverse
    for _ in range(_ROOT_ITERATIONS):
        value = horner(g, root)
        low, high = jnp.where(value > 0.0, root, low), jnp.where(value > 0.0, high, root)
        inverse = inverse * (2.0 - horner(slope, root) * inverse)
        newton = root - value * inverse
        root = jnp.where((newton >= low) & (newton <= high), newton, 0.5 * (low + high))
    return jnp.where(found, jnp.where(at_once, 0.0, root), 2.0)


def _advance(system, accuracy, keep, row):
    """A step of the table again: (origin, after, x) at its end, and its polynomials.

    The value is that of the march; the derivatives are those of the true flow, with the
    end of the step moving as the event or the corner does.
    """
    unflatten = _unflatten(system)
    size = row.shape[0] - _KNOWN
    origin, after, *x = row[:size]
    index, mode, reach, length, code = lax.stop_gradient(row[size:])
    code = code.astype(int)
    corner, settles, event = (code & bit > 0 for bit in (_CORNER, _SETTLES, _EVENT))
    segment = system.segment(index)
    units = [scale / accuracy.tolerance for scale in jax.tree.leaves(lax.stop_gradient(system.scales()))]
    field = _field(system, segment, unflatten, mode)
    polynomials = accuracy.method.expand(field, after, x, units, reach, 1.0 + 0.0 * reach)
    theta = length / jnp.where(reach > 0, reach, 1.0)
    end = unflatten([horner(c, theta) for c in polynomials])
    end = system.exact(segment, after, unflatten(x), length, end)
    at = after + length

    def margin(late):
        rates = system.field(segment, at + late, end, mode)
        moved = jax.tree.map(lambda a, b: a + late * b, end, rates)
        return jnp.minimum(*system.guards(segment, at + late, moved, mode))

    gap, slope = jax.jvp(margin, (jnp.zeros_like(at),), (jnp.ones_like(at),))
    late_event = -_tangent_only(gap) / lax.stop_gradient(jnp.where(event & (slope != 0), slope, 1.0))
    late_corner = _tangent_only(jnp.where(corner, segment.duration, 0.0) - at)
    late = jnp.where(event, late_event, jnp.where(corner, late_corner, 0.0))
    rates = lax.stop_gradient(system.field(segment, at, end, mode))
    end = jax.tree.map(lambda a, b: a + late * b, end, rates)
    switched, following = system.switch(segment, at + late, end, mode)
    end = jax.tree.map(lambda a, b: jnp.where(event, a, b), switched, end)
    settled = system.settle(segment, at + late, end, jnp.where(event, following, mode))
    end = jax.tree.map(lambda a, b: jnp.where(settles, a, b), settled, end)
    origin = jnp.where(corner, origin + jnp.where(corner, segment.duration, 0.0), origin)
    after = jnp.where(corner, 0.0, at + late)
    return jnp.stack([origin, after, *jax.tree.leaves(end)]), jnp.stack([jnp.stack(polynomials[i]) for i in keep])


def _tangent_only(x):
    """Zero in value, `x` in derivative."""
    return x - lax.stop_gradient(x)


def _field(system, segment, unflatten, mode):
    return lambda after, x: jax.tree.leaves(system.field(segment, after, unflatten(x), mode))


def _unflatten(system):
    tree = jax.tree.structure(system.initial())
    return lambda leaves: jax.tree.unflatten(tree, list(leaves))


def _tiled(function, carry, table, count):
    """`function(carry, rows, real)` over the real rows, a tile at a time; zeros for the rest."""
    room, width = table.shape
    tiles = -(-room // _TILE)
    real = jnp.arange(tiles * _TILE) < count
    # Rows without a step are computed like the first one: finite, and never used.
    rows = jnp.concatenate([table, jnp.zeros((tiles * _TILE - room, width))])
    rows = jnp.where(real[:, None], rows, table[0])
    tiled = (real.reshape(tiles, _TILE), rows.reshape(tiles, _TILE, width))
    shapes = jax.eval_shape(function, carry, tiled[1][0], tiled[0][0])[1]

    def blank(carry, rows, real):
        return carry, jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), shapes)

    def tile(carry, args):
        real, rows = args
        return lax.cond(real[0], function, blank, carry, rows, real)

    carry, out = lax.scan(tile, carry, tiled)
    return carry, jax.tree.map(lambda a: a.reshape(tiles * _TILE, *a.shape[2:])[:room], out)
