"""Any voltage, from samples of a generator's table or of a measurement at the piezo.

Between the samples the voltage is a straight line, or is held.  From t = 0 to the first
sample the first voltage holds, after the last sample the last one, for good.
"""

from typing import Any, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import Choice, Scalar, ScalarLike, choice
from .base import AbstractDrive, Segment


def _array(given: Any) -> Any:
    # Left to numpy, they keep their precision whenever JAX learns of its own.
    return given if isinstance(given, jax.Array) else np.asarray(given, float)


class Sampled(AbstractDrive):
    """One segment a sample, after one for the time before the first."""

    times: Float[Array | np.ndarray, " n"] = eqx.field(default=(0.0, 0.1, 0.2), converter=_array)
    """Sample times [s], ascending, from 0 on; shape (n,)."""
    voltages: Float[Array | np.ndarray, " n"] = eqx.field(default=(0.0, 64.2, 0.0), converter=_array)
    """Voltages [V], shape (n,)."""
    interpolation: Choice = choice({"linear": 1.0, "held": 0.0})
    """Linear: straight lines from sample to sample; held: each voltage until the next sample."""

    def segment(self, index: Scalar) -> Segment:
        times, voltages = jnp.asarray(self.times, float), jnp.asarray(self.voltages, float)
        last = times.shape[0]
        here = jnp.clip(jnp.asarray(index, float).astype(int), 0, last)
        opens, closes = jnp.maximum(here - 1, 0), jnp.minimum(here, last - 1)
        waits = here == 0
        duration = jnp.where(waits, times[0], jnp.where(here == last, jnp.inf, times[closes] - times[opens]))
        # The wait opens at 0 V; of no length, it is half a jump.
        start = jnp.where(waits & (duration == 0), 0.5, 1.0) * voltages[opens]
        sloped = (here > 0) & (here < last)
        rise = self.interpolation * (voltages[closes] - voltages[opens])
        return Segment(duration, start, jnp.where(sloped, rise / jnp.where(sloped, duration, 1.0), 0.0))

    def at(self, time: Float[Array, " n"]) -> Float[Array, " n"]:
        times, voltages = jnp.asarray(self.times, float), jnp.asarray(self.voltages, float)
        held = voltages[jnp.clip(jnp.searchsorted(times, time, side="right") - 1, 0)]
        level = jnp.where(jnp.asarray(self.interpolation) > 0.5, jnp.interp(time, times, voltages), held)
        return jnp.where(time < 0, 0.0, level)

    def period(self) -> tuple[int, int] | None:
        return None

    def cycle_frequency(self) -> ScalarLike | None:
        return None

    def has_jumps(self) -> bool:
        # From the first sample on, or at t = 0, where the drive sets in.
        held = float(self.interpolation) == 0.0
        return bool(self.voltages[0] != 0 or (held and np.any(np.diff(self.voltages) != 0)))

    def peak(self) -> ScalarLike:
        return jnp.max(jnp.abs(jnp.asarray(self.voltages, float)))

    def segments(self, until: float) -> int:
        return int(np.searchsorted(np.asarray(self.times), until)) + 2

    @classmethod
    def examples(cls) -> tuple[Self, ...]:
        times, voltages = (0.0, 0.01, 0.03, 0.04, 0.1), (0.0, 12.0, -5.0, -5.0, 40.0)
        late = cls([0.005, 0.015, 0.105], [3.0, 15.0, -2.0])
        held = [cls(times, v, "held") for v in (voltages, (4.0, *voltages[1:]))]
        return cls(), cls(times, voltages), cls([0.0, 0.1], [4.0, -6.0]), late, cls([0.01, 0.02], [0.0, 4.0]), *held
