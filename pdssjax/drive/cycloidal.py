"""A sawtooth whose slow flank is a cycloid, so that it begins and ends without a jerk.

With T = 1/frequency, amplitude V and fall time tf the slow flank, of length T' = T - tf, follows

    u = V (s / T' - sin(2 pi s / T') / (2 pi)),   s from 0 to T',

forward; backward it falls by as much from V.  The fast flank is straight, and the first
forward cycle rises over T, as those of the sawtooth.  The cycloid is the rise of a cycloidal
cam: velocity and acceleration vanish at its begin, acceleration at its end.
"""

from typing import Self

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import Choice, Scalar, ScalarLike, choice, quantity
from ._flanks import flank, progress, too_long
from .base import AbstractDrive, Flanks, Segment, Wave


class Cycloidal(AbstractDrive):
    """Two segments a cycle: the fast flank, of zero length where it is ideal, then the cycloid."""

    voltage: float = quantity(64.2, "V", positive=False)
    """Peak voltage V [V]."""
    frequency: float = quantity(5.0, "Hz")
    """Cycles a second [Hz]."""
    fall_time: float = quantity(0.0, "s", positive=False, low=0.0, optional=True)
    """Duration of the fast flank tf [s]; 0 is a jump."""
    direction: Choice = choice({"forward": 1.0, "backward": -1.0})
    """Forward: slow rise and fast fall; backward: fast rise and slow fall."""

    def segment(self, index: Scalar) -> Segment:
        period = 1.0 / self.frequency
        duration, start, change, fast = flank(index, period, self.fall_time, self.voltage, self.direction)
        moves = duration > 0
        lasts = jnp.where(moves, duration, 1.0)
        # - sin x = cos(x + pi / 2)
        wave = Wave(jnp.where(fast, 0.0, change / (2.0 * jnp.pi)), 2.0 * jnp.pi / lasts, 0.5 * jnp.pi)
        return Segment(duration, start, jnp.where(moves, change / lasts, 0.0), wave)

    def at(self, time: Float[Array, " n"]) -> Float[Array, " n"]:
        part, fast = progress(time, 1.0 / self.frequency, self.fall_time, self.direction)
        part = jnp.where(fast, part, part - jnp.sin(2.0 * jnp.pi * part) / (2.0 * jnp.pi))
        level = jnp.where(fast == (self.direction > 0), 1.0 - part, part)
        return jnp.where(time < 0, 0.0, self.voltage * level)

    def period(self) -> tuple[int, int] | None:
        return (2, 2)

    def cycle_frequency(self) -> ScalarLike | None:
        return self.frequency

    def has_jumps(self) -> bool:
        return bool(self.fall_time == 0)

    def peak(self) -> ScalarLike:
        return abs(self.voltage)

    def flanks(self) -> Flanks | None:
        fast = self.fall_time
        return Flanks(self.direction * self.voltage / (1.0 / self.frequency - fast), fast)

    def slow_flank_times(self, parts: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Times along the slow flank [1]: the cycloid solved for the time, by a table of 1e-5 of the flank."""
        times = np.linspace(0.0, 1.0, 100_001)
        return np.interp(parts, times - np.sin(2.0 * np.pi * times) / (2.0 * np.pi), times)

    def broken_conditions(self) -> dict[str, str]:
        room = 1.0 / self.frequency
        broken = {} if self.fall_time < room else {"fall_time": too_long(self.fall_time, room, "the period")}
        return super().broken_conditions() | broken

    @classmethod
    def examples(cls) -> tuple[Self, ...]:
        return cls(), cls(30.0, 20.0), cls(30.0, 20.0, 1e-3), cls(30.0, 20.0, 1e-3, -1.0)
