"""The steps of the forward pass again, side by side, with their derivatives.

Every step is linearised about its own start, and a linear recurrence joins them.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jax.flatten_util import ravel_pytree

from .forward_pass import BECAME_SETTLED, CORNER, EVENT, KNOWN_COLUMNS, WHICH, find_steps
from .step_methods.base import horner
from .system import field_of, has_guards, initial_state_and_mode, unflattener

_TILE = 32
"""Steps expanded or linearised side by side."""


@eqx.filter_custom_jvp
def differentiable_steps(system, *, horizon, accuracy, keep):
    table, loop = find_steps(system, horizon, accuracy)

    def tile(carry, rows, real):
        return carry, _expanded(system, accuracy.method, jnp.asarray(accuracy.tolerance, float), keep, rows)

    # The loop itself keeps no polynomials: a carry that large would slow it down.
    return _step_arrays(table, loop, _tiled(tile, None, table, loop.count)[1])


@differentiable_steps.def_jvp
def _differentiable_steps_jvp(primals, tangents, *, horizon, accuracy, keep):
    (system,), (system_dot,) = primals, tangents
    table, loop = find_steps(system, horizon, accuracy)
    size = table.shape[1] - KNOWN_COLUMNS
    moving, fixed = eqx.partition(
        system, jax.tree.map(lambda t: t is not None, system_dot, is_leaf=lambda t: t is None)
    )
    parameters, rebuilt = ravel_pytree(moving)
    parameters_dot, _ = ravel_pytree(system_dot)

    def join(tangent, step):
        real, matrix, vector = step
        moved = jnp.sum(matrix * tangent, axis=-1) + vector
        return jnp.where(real, moved, tangent), tangent

    def tile(tangent, rows, real):
        polynomials, (ends, inner) = _linearised(
            moving, fixed, accuracy.method, jnp.asarray(accuracy.tolerance, float), keep, rows
        )
        driven = jnp.sum(ends[..., size:] * parameters_dot, axis=-1)
        end, begins = lax.scan(join, tangent, (real, ends[..., :size], driven))
        moved = jnp.sum(inner[..., :size] * begins[:, None, None, :], axis=-1)
        return end, (begins, polynomials, moved + jnp.sum(inner[..., size:] * parameters_dot, axis=-1))

    started = lambda parameters: jnp.stack(
        jax.tree.leaves(initial_state_and_mode(eqx.combine(rebuilt(parameters), fixed))[0])
    )
    first_dot = jnp.zeros(size).at[2:].set(jax.jvp(started, (parameters,), (parameters_dot,))[1])
    end_dot, (begins_dot, polynomials, polynomials_dot) = _tiled(tile, first_dot, table, loop.count)
    out = _step_arrays(table, loop, polynomials)
    nothing = jax.tree.map(lambda _: None, out[3])
    return out, (begins_dot, end_dot, polynomials_dot, nothing)


def _step_arrays(table, loop, polynomials):
    size = table.shape[1] - KNOWN_COLUMNS
    index, mode, step_radius, duration, _ = table[:, size:].T
    known = dict(index=index, mode=mode, step_radius=step_radius, duration=duration)
    end = jnp.stack([loop.origin, loop.t_local, *loop.x])
    return table[:, :size], end, polynomials, (known, loop)


# These two are compiled functions of their own so that they are traced once, however often loops and
# transformations look at them.
@eqx.filter_jit
def _expanded(system, method, tolerance, keep, rows):
    """The polynomials of the steps `rows`."""
    return jax.vmap(lambda row: _advance(system, method, tolerance, keep, row)[1])(rows)


@eqx.filter_jit
def _linearised(moving, fixed, method, tolerance, keep, rows):
    """The polynomials of the steps `rows`, and the Jacobians of their ends and polynomials.

    With respect to the begin and every `moving` parameter of the system, whatever the tangents
    asked for: directions asked for together share it.
    """
    size = rows.shape[1] - KNOWN_COLUMNS
    parameters, rebuilt = ravel_pytree(moving)

    def linearise(row):
        def flow(inputs):
            begin, known = inputs[:size], row[size:]
            system = eqx.combine(rebuilt(inputs[size:]), fixed)
            end, polynomials = _advance(system, method, tolerance, keep, jnp.concatenate([begin, known]))
            return (end, polynomials), polynomials

        slopes, polynomials = jax.jacfwd(flow, has_aux=True)(jnp.concatenate([row[:size], parameters]))
        return polynomials, slopes

    return jax.vmap(linearise)(rows)


def _advance(system, method, tolerance, keep, row):
    """A step of the table again: (origin, after, x) at its end, and its polynomials.

    The value is that of the forward pass; the derivatives are those of the true flow, with the
    end of the step moving as the event or the corner does.
    """
    unflatten = unflattener(system)
    size = row.shape[0] - KNOWN_COLUMNS
    origin, t_local, *x = row[:size]
    index, mode, step_radius, duration, code = lax.stop_gradient(row[size:])
    code = code.astype(int)
    corner, becomes_settled, event = (code & bit > 0 for bit in (CORNER, BECAME_SETTLED, EVENT))
    which = code // WHICH
    segment = system.segment(index)
    units = [scale / tolerance for scale in jax.tree.leaves(lax.stop_gradient(system.state_scale()))]
    field = field_of(system, segment, unflatten, mode)
    polynomials = method.expand(field, t_local, x, units, step_radius, 1.0 + 0.0 * step_radius)
    theta = duration / jnp.where(step_radius > 0, step_radius, 1.0)
    end = unflatten([horner(c, theta) for c in polynomials])
    end = system.exact(segment, t_local, unflatten(x), duration, end)
    at = t_local + duration

    def margin(event_shift):
        rates = system.field(segment, at + event_shift, end, mode)
        moved = jax.tree.map(lambda a, b: a + event_shift * b, end, rates)
        guards = [jnp.asarray(guard, float) for guard in system.guards(segment, at + event_shift, moved, mode)]
        return jnp.minimum(*guards) if len(guards) == 2 else jnp.stack(guards)[which]

    guarded, shift_of_event = has_guards(system, segment, at, end, mode), 0.0
    if guarded:
        gap, slope = jax.jvp(margin, (jnp.zeros_like(at),), (jnp.ones_like(at),))
        located = event & (slope != 0) & ~system.is_spurious_event(slope, mode, which)
        slope = lax.stop_gradient(jnp.where(located, slope, 1.0))
        shift_of_event = jnp.where(located, -_tangent_only(gap) / slope, 0.0)
    shift_of_corner = _tangent_only(jnp.where(corner, segment.duration, 0.0) - at)
    event_shift = jnp.where(event, shift_of_event, jnp.where(corner, shift_of_corner, 0.0))
    rates = lax.stop_gradient(_rates(system, segment, t_local, unflatten(x), duration, end, mode))
    end = jax.tree.map(lambda a, b: a + event_shift * b, end, rates)
    following = mode
    if guarded:
        switched, following = system.after_event(segment, at + event_shift, end, mode, which)
        end = jax.tree.map(lambda a, b: jnp.where(event, a, b), switched, end)
        following = jnp.where(event, following, mode)
    projected = system.project_to_steady(segment, at + event_shift, end, following)
    end = jax.tree.map(lambda a, b: jnp.where(becomes_settled, a, b), projected, end)
    if system.resets_at_corners:
        started, _ = system.on_segment_start(system.segment(index + 1.0), end, mode)
        end = jax.tree.map(lambda a, b: jnp.where(corner, a, b), started, end)
    origin = jnp.where(corner, origin + jnp.where(corner, segment.duration, 0.0), origin)
    t_local = jnp.where(corner, 0.0, at + event_shift)
    return jnp.stack([origin, t_local, *jax.tree.leaves(end)]), jnp.stack([jnp.stack(polynomials[i]) for i in keep])


def _rates(system, segment, t_local, begin, duration, end, mode):
    """How the state changes with time at the end of a step.

    What is known in closed form goes on moving where all else has settled (a platform that still rings under a
    stuck contact), and the field of that mode leaves it out.
    """
    rates = system.field(segment, t_local + duration, end, mode)

    def later(shift):
        moved = jax.tree.map(lambda a, b: a + shift * b, end, rates)
        return system.exact(segment, t_local, begin, duration + shift, moved)

    return jax.jvp(later, (jnp.zeros_like(duration),), (jnp.ones_like(duration),))[1]


def _tangent_only(x):
    """Zero in value, `x` in derivative."""
    return x - lax.stop_gradient(x)


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
