"""Curved segments as short straight lines, for what is known in closed form on these only."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..drive.base import Segment

_MOST_ALTOGETHER = 100_000
"""Lines of a chain, unless `_FEWEST` of a segment are more: their states, with derivatives, take memory."""

_MOST = 2000
"""Lines a segment; with so many the voltage is off by 6e-7 of the swing of a sine, (2 pi / lines)^2 / 16, at most."""

_FEWEST = 256
"""By 4e-5."""


def lines_a_segment(segments: int) -> int:
    """Into how many lines each of so many curved segments is divided."""
    return min(max(_MOST_ALTOGETHER // segments, _FEWEST), _MOST)


def straightened(segments: Segment, many: int) -> Segment:
    """The chords of `many` equal parts of every segment, one after the other.

    **Arguments:** `segments` are arrays of shape (k,), all of finite length.

    **Returns:** arrays of shape (k `many`,), without a wave.
    """
    parts = jnp.arange(many + 1) / many
    times = segments.duration[:, None] * parts
    of_segment = lambda segment, at: jax.vmap(lambda t: segment.voltage(t).level)(at)
    levels = jax.vmap(of_segment)(segments, times)
    lasts = jnp.repeat(segments.duration / many, many)
    rises = jnp.diff(levels, axis=1).ravel()
    slopes = jnp.where(lasts > 0.0, rises, 0.0) / jnp.where(lasts > 0.0, lasts, 1.0)
    return Segment(lasts, levels[:, :-1].ravel(), slopes)


def place_among_lines(
    segments: Segment, places: Int[Array, " m"], t_local: Float[Array, " m"], many: int
) -> tuple[Int[Array, " m"], Float[Array, " m"]]:
    """The line of `straightened` in which a moment is, `t_local` [s] into its segment, and how far into it [s]."""
    lasts = segments.duration[places] / many
    part = jnp.floor(t_local / jnp.where(lasts > 0.0, lasts, 1.0)).astype(int)
    part = jnp.clip(part, 0, many - 1)
    return places * many + part, t_local - part * lasts
