"""Systems known in closed form between two corners: the state at any time, without a step."""

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ..core import Count, Scalar
from .system import AbstractHybridSystem, State, Visited


def is_closed(system: AbstractHybridSystem) -> bool:
    """Its states at any times are known without a step: all at once, or on each segment, which no guard ends."""
    return system.has_closed_states() or len(system.closed_components()) == len(jax.tree.leaves(system.initial()))


def exact_states_at(system: AbstractHybridSystem, times: Float[Array, " m"], segments: int) -> Visited:
    """The state of a closed `system` at `times` [s], shape (m,), none before 0.

    **Arguments:** `segments` is how many segments of the drive the times may reach into.

    **Returns:** as `states_at` does.
    """
    if system.has_closed_states():
        return system.closed_states(times, segments)

    def pass_segment(
        carry: tuple[Scalar, State, Scalar], index: Scalar
    ) -> tuple[tuple[Scalar, State, Scalar], tuple[Scalar, State, Scalar]]:
        origin, state, mode = carry
        segment = system.segment(index)
        state, mode = system.on_segment_start(segment, state, mode)
        lasts = jnp.isfinite(segment.duration)
        duration = jnp.where(lasts, segment.duration, 0.0)
        ahead = system.exact(segment, 0.0, state, duration, state)
        return (jnp.where(lasts, origin + duration, jnp.inf), ahead, mode), (origin, state, mode)

    zero = jnp.zeros(())
    first = jax.tree.map(lambda x: jnp.asarray(x, float), system.initial())
    _, (origins, states, modes) = lax.scan(pass_segment, (zero, first, zero), jnp.arange(segments) * 1.0)
    j = jnp.clip(jnp.searchsorted(lax.stop_gradient(origins), times, side="right") - 1, 0)

    def inside(j: Count, time: Scalar) -> Visited:
        begin, t_local = jax.tree.map(lambda x: x[j], states), time - origins[j]
        segment = system.segment(j * 1.0)
        return Visited(system.exact(segment, 0.0, begin, t_local, begin), segment, t_local, modes[j])

    return jax.vmap(inside)(j, times)
