"""The sawtooth that makes the actuator walk: a slow flank and a fast one (thesis, section 3.3).

With T = 1/frequency, amplitude V and fall time tf:

- forward: the first cycle rises from 0 to V over T; every later cycle falls from V to 0
  within tf, then rises to V over T - tf;
- backward: every cycle jumps from 0 up to V within tf, then falls to 0 over T - tf.
"""

import jax.numpy as jnp

from ..quantity import choice, quantity
from .base import AbstractDrive, Segment


class Sawtooth(AbstractDrive):
    """Two segments a cycle: the fast flank, of zero length where tf = 0, then the slow one."""

    voltage: float = quantity(64.2, "V", positive=False)
    """Peak voltage V [V]."""
    frequency: float = quantity(5.0, "Hz")
    """Cycles a second [Hz]."""
    fall_time: float = quantity(0.0, "s", positive=False, low=0.0, optional=True)
    """Duration of the fast flank tf [s]; 0 is a jump."""
    direction: float = choice({"forward": 1.0, "backward": -1.0})
    """Forward: slow rise and fast fall; backward: fast rise and slow fall."""

    def _first_fall(self, index):
        # A forward drive starts at 0 V, so its first cycle has no fast flank.
        # A fit may try a fall longer than the cycle; time must not run backwards then.
        fall = jnp.minimum(jnp.asarray(self.fall_time, float), 1.0 / self.frequency)
        return jnp.where((index < 2) & (self.direction > 0), 0.0, fall)

    def segment(self, index):
        fast = index % 2 == 0
        fall = self._first_fall(index)
        length = jnp.where(fast, fall, 1.0 / self.frequency - fall)
        falls = fast == (self.direction > 0)
        change = jnp.where(falls, -1.0, 1.0) * self.voltage
        moves = length > 0
        start = jnp.where(moves, jnp.where(falls, self.voltage, 0.0), 0.5 * self.voltage)
        return Segment(length, start, jnp.where(moves, change / jnp.where(moves, length, 1.0), 0.0))

    def at(self, time):
        period = 1.0 / self.frequency
        phase = jnp.mod(time, period)
        fall = self._first_fall(jnp.where(time < period, 0, 2))
        fast = phase < fall
        level = jnp.where(fast, 1.0 - phase / jnp.where(fast, fall, 1.0), (phase - fall) / (period - fall))
        level = jnp.where(self.direction > 0, level, 1.0 - level)
        return jnp.where(time < 0, 0.0, self.voltage * level)

    def period(self):
        return (2, 2)
