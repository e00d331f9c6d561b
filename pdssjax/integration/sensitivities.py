"""The steps of a march again, side by side, with their derivatives.

Every step is linearised about its own start, and a linear recurrence joins them.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jax.flatten_util import ravel_pytree

from .expansion import horner
from .stepping import CORNER, EVENT, KNOWN, SETTLES, WHICH, begin, field_of, find_steps, unflattener

_TILE = 32
"""Steps expanded or linearised side by side."""


@eqx.filter_custom_jvp
def expanded_march(system, *, horizon, accuracy, keep):
    table, walk = find_steps(system, horizon, accuracy)

    def tile(carry, rows, real):
        return carry, _expanded(system, accuracy.method, jnp.asarray(accuracy.tolerance, float), keep, rows)

    # The loop itself keeps no polynomials: a carry that large would slow it down.
    return _outcome(table, walk, _tiled(tile, None, table, walk.count)[1])


@expanded_march.def_jvp
def _march_jvp(primals, tangents, *, horizon, accuracy, keep):
    (system,), (system_dot,) = primals, tangents
    table, walk = find_steps(system, horizon, accuracy)
    size = table.shape[1] - KNOWN
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

    first_dot = jnp.zeros(size)
    if system.jumps:
        started = lambda parameters: jnp.stack(jax.tree.leaves(begin(eqx.combine(rebuilt(parameters), fixed))[0]))
        first_dot = first_dot.at[2:].set(jax.jvp(started, (parameters,), (parameters_dot,))[1])
    end_dot, (begins_dot, polynomials, polynomials_dot) = _tiled(tile, first_dot, table, walk.count)
    out = _outcome(table, walk, polynomials)
    nothing = jax.tree.map(lambda _: None, out[3])
    return out, (begins_dot, end_dot, polynomials_dot, nothing)


def _outcome(table, walk, polynomials):
    size = table.shape[1] - KNOWN
    index, mode, reach, length, _ = table[:, size:].T
    known = dict(index=index, mode=mode, reach=reach, length=length)
    end = jnp.stack([walk.origin, walk.after, *walk.x])
    return table[:, :size], end, polynomials, (known, walk)


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
    size = rows.shape[1] - KNOWN
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

    The value is that of the march; the derivatives are those of the true flow, with the
    end of the step moving as the event or the corner does.
    """
    unflatten = unflattener(system)
    size = row.shape[0] - KNOWN
    origin, after, *x = row[:size]
    index, mode, reach, length, code = lax.stop_gradient(row[size:])
    code = code.astype(int)
    corner, settles, event = (code & bit > 0 for bit in (CORNER, SETTLES, EVENT))
    which = code // WHICH
    segment = system.segment(index)
    units = [scale / tolerance for scale in jax.tree.leaves(lax.stop_gradient(system.scales()))]
    field = field_of(system, segment, unflatten, mode)
    polynomials = method.expand(field, after, x, units, reach, 1.0 + 0.0 * reach)
    theta = length / jnp.where(reach > 0, reach, 1.0)
    end = unflatten([horner(c, theta) for c in polynomials])
    end = system.exact(segment, after, unflatten(x), length, end)
    at = after + length

    def margin(late):
        rates = system.field(segment, at + late, end, mode)
        moved = jax.tree.map(lambda a, b: a + late * b, end, rates)
        guards = [jnp.asarray(guard, float) for guard in system.guards(segment, at + late, moved, mode)]
        return jnp.minimum(*guards) if len(guards) == 2 else jnp.stack(guards)[which]

    gap, slope = jax.jvp(margin, (jnp.zeros_like(at),), (jnp.ones_like(at),))
    located = event & (slope != 0) & ~system.faint(slope, mode, which)
    late_event = jnp.where(located, -_tangent_only(gap) / lax.stop_gradient(jnp.where(located, slope, 1.0)), 0.0)
    late_corner = _tangent_only(jnp.where(corner, segment.duration, 0.0) - at)
    late = jnp.where(event, late_event, jnp.where(corner, late_corner, 0.0))
    rates = lax.stop_gradient(system.field(segment, at, end, mode))
    end = jax.tree.map(lambda a, b: a + late * b, end, rates)
    switched, following = system.switch(segment, at + late, end, mode, which)
    end = jax.tree.map(lambda a, b: jnp.where(event, a, b), switched, end)
    settled = system.settle(segment, at + late, end, jnp.where(event, following, mode))
    end = jax.tree.map(lambda a, b: jnp.where(settles, a, b), settled, end)
    if system.jumps:
        entered, _ = system.enter(system.segment(index + 1.0), end, mode)
        end = jax.tree.map(lambda a, b: jnp.where(corner, a, b), entered, end)
    origin = jnp.where(corner, origin + jnp.where(corner, segment.duration, 0.0), origin)
    after = jnp.where(corner, 0.0, at + late)
    return jnp.stack([origin, after, *jax.tree.leaves(end)]), jnp.stack([jnp.stack(polynomials[i]) for i in keep])


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
