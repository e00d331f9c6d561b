"""The sawtooth of stick-slip locomotion: a slow flank and a fast one (thesis, section 3.3).

With T = 1/frequency, amplitude V, fall time tf and duty d the fast flank lasts
t_fast = tf + (1 - d) T, and

- forward: the first cycle rises from 0 to V over T; every later cycle falls from V to 0
  within t_fast, then rises to V over T - t_fast;
- backward: every cycle jumps from 0 up to V within t_fast, then falls to 0 over T - t_fast.

A recorded voltage tells the slope s of the slow flanks far better than where they end, between two samples.  So the
voltage may be told by it: U = s T, which a slow flank would come to in a whole period; then V = U (T - t_fast) / T.
"""

import dataclasses
import math
from typing import Self

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import Choice, Scalar, ScalarLike, choice, quantity
from ._flanks import flank, progress, too_long
from .base import AbstractDrive, Flanks, Segment


class Sawtooth(AbstractDrive):
    """Two straight segments a cycle: the fast flank, of zero length where it is ideal, then the slow one."""

    voltage: float = quantity(64.2, "V", positive=False)
    """Peak voltage V [V], or U."""
    frequency: float = quantity(5.0, "Hz")
    """Cycles a second [Hz]."""
    fall_time: float = quantity(0.0, "s", positive=False, low=0.0, optional=True)
    """Duration of the fast flank tf [s], beyond what the duty leaves it; 0 is a jump."""
    direction: Choice = choice({"forward": 1.0, "backward": -1.0})
    """Forward: slow rise and fast fall; backward: fast rise and slow fall."""
    duty: float = quantity(1.0, "", high=math.nextafter(1.0, 2.0), optional=True)
    """Share d of the period that the slow flank takes, but for the fall time [1]; up to 1."""
    told_by: Choice = choice({"peak": 0.0, "slope": 1.0})
    """Meaning of `voltage`: V, the peak, or U, the slope times the period."""

    def _fall(self) -> ScalarLike:
        return self.fall_time + (1.0 - self.duty) / self.frequency

    def _peak(self) -> ScalarLike:
        return self.voltage * (1.0 - self.told_by * jnp.minimum(self._fall() * self.frequency, 1.0))

    def with_peak_voltage(self) -> Self:
        return dataclasses.replace(self, voltage=float(self._peak()), told_by=0.0)

    def segment(self, index: Scalar) -> Segment:
        duration, start, change, _ = flank(index, 1.0 / self.frequency, self._fall(), self._peak(), self.direction)
        moves = duration > 0
        return Segment(duration, start, jnp.where(moves, change / jnp.where(moves, duration, 1.0), 0.0))

    def at(self, time: Float[Array, " n"]) -> Float[Array, " n"]:
        part, fast = progress(time, 1.0 / self.frequency, self._fall(), self.direction)
        level = jnp.where(fast == (self.direction > 0), 1.0 - part, part)
        return jnp.where(time < 0, 0.0, self._peak() * level)

    def period(self) -> tuple[int, int] | None:
        return (2, 2)

    def cycle_frequency(self) -> ScalarLike | None:
        return self.frequency

    def has_jumps(self) -> bool:
        return bool(self._fall() == 0)

    def peak(self) -> ScalarLike:
        return abs(self._peak())

    def flanks(self) -> Flanks | None:
        fast = self._fall()
        return Flanks(self.direction * self._peak() / (1.0 / self.frequency - fast), fast)

    def broken_conditions(self) -> dict[str, str]:
        room = self.duty / self.frequency
        whole = "the slow flank" if self.duty < 1.0 else "the period"
        broken = {} if self.fall_time < room else {"fall_time": too_long(self.fall_time, room, whole)}
        return super().broken_conditions() | broken

    @classmethod
    def examples(cls) -> tuple[Self, ...]:
        falls = [cls(-30.0, 20.0, fall, way) for fall in (0.0, 1.3e-3) for way in (1.0, -1.0)]
        return cls(), *falls, cls(30.0, 20.0, duty=0.8), cls(30.0, 20.0, 1e-3, -1.0, 0.8, 1.0)
