"""The clock of a drive: the segment in which a time lies."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ..core import Scalar
from ..drive.base import AbstractDrive, Segment

_FOR_EVER = 1e9
"""A time [s] by which a drive that does not repeat has come to its last segment."""


class DriveClock(eqx.Module):
    """When the segments of a drive begin: all of them, or those until the first period has ended."""

    drive: AbstractDrive
    origins: Float[Array, " segments"]
    """[s]"""
    period: Scalar
    """Of a drive that repeats, its length [s]; else infinite."""
    first: int = eqx.field(static=True)
    """Segment with which the first period begins."""

    def at(self, time: Scalar) -> tuple[Segment, Scalar]:
        """The segment at a `time` [s] from the start of the drive, and the time since it began [s]."""
        since = lax.stop_gradient((time - self.origins[self.first]) / self.period)
        cycles = jnp.maximum(jnp.floor(since), 0.0)
        time = time - jnp.where(cycles > 0.0, cycles * self.period, 0.0)
        # A comparison with all of them: a search would be a loop within the solver's.
        begun = jnp.sum(lax.stop_gradient(self.origins) <= lax.stop_gradient(time))
        place = jnp.maximum(begun - 1, 0)
        return self.drive.segment(place + cycles * (self.origins.size - self.first)), time - self.origins[place]


def drive_clock(drive: AbstractDrive) -> DriveClock:
    """The clock of `drive`; its functions are compiled once for drives of one kind."""
    cycle = drive.period()
    first, count = cycle or (0, drive.segments(_FOR_EVER))
    return _clock(drive, first, count, cycle is not None)


@eqx.filter_jit
def _clock(drive: AbstractDrive, first: int, count: int, repeats: bool) -> DriveClock:
    durations = jax.vmap(lambda index: drive.segment(index).duration)(jnp.arange(first + count) * 1.0)
    origins = jnp.concatenate([jnp.zeros(1), jnp.cumsum(durations)[:-1]])
    return DriveClock(drive, origins, jnp.sum(durations[first:]) if repeats else jnp.inf * jnp.ones(()), first)
