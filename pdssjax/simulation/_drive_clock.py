"""In which segment of a drive a time lies."""

import jax
import jax.numpy as jnp
from jax import lax

from ..core import Scalar
from ..drive.base import AbstractDrive, Segment

_FOR_EVER = 1e9
"""A time [s] by which a drive that does not repeat has come to its last segment."""


def segment_at(drive: AbstractDrive, time: Scalar) -> tuple[Segment, Scalar]:
    """The segment of `drive` at a `time` [s] from its start, and the time since that segment began [s]."""
    cycle = drive.period()
    first, count = cycle or (0, drive.segments(_FOR_EVER))
    durations = jax.vmap(lambda index: drive.segment(index).duration)(jnp.arange(first + count) * 1.0)
    ends = jnp.cumsum(durations)
    origins = jnp.concatenate([jnp.zeros(1), ends[:-1]])
    cycles = jnp.zeros(())
    if cycle is not None:
        length = jnp.sum(durations[first:])
        cycles = jnp.maximum(jnp.floor(lax.stop_gradient((time - origins[first]) / length)), 0.0)
        time = time - cycles * length
    place = jnp.clip(jnp.searchsorted(lax.stop_gradient(origins), lax.stop_gradient(time), side="right") - 1, 0)
    return drive.segment(place + cycles * count), time - origins[place]
