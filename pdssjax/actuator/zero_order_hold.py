"""The staircase that a digital-to-analogue converter makes of a voltage: zero-order hold."""

import dataclasses

import jax.numpy as jnp

from ..core import quantity
from ..drive.base import AbstractDrive, Segment

_LATE = 1e-6
"""Part of an interval after its begin at which the voltage is read: a jump that falls on the begin is over then."""


class ZeroOrderHold(AbstractDrive):
    """`drive`, read once every `interval` and held until the next time; it jumps at every corner."""

    drive: AbstractDrive
    interval: float = quantity(50e-6, "s")
    """Time between two values [s]."""

    def segment(self, index):
        index = jnp.asarray(index, float)
        return Segment(jnp.asarray(self.interval, float), self._read(index), jnp.zeros(()))

    def at(self, time):
        # Rounding must not put the begin of an interval into the one before.
        return jnp.where(time < 0, 0.0, self._read(jnp.floor(time / self.interval + 1e-9)))

    def period(self):
        # The period of the drive need not be a whole number of intervals.
        return None

    def cycle_frequency(self):
        """That of the drive it holds [Hz]: the staircase repeats but for where the intervals fall."""
        return self.drive.cycle_frequency()

    def has_jumps(self):
        return True

    def peak(self):
        """That of the drive it holds [V]: the staircase stays below by what the voltage changes in an interval."""
        return self.drive.peak()

    def flanks(self):
        return self.drive.flanks()

    def declared(self):
        """What is declared of the drive it holds: the interval is a record's own."""
        return self.drive.declared()

    def numbers(self):
        return self.drive.numbers()

    def with_numbers(self, numbers):
        return dataclasses.replace(self, drive=self.drive.with_numbers(numbers))

    def segments(self, until):
        return int(max(until, 0.0) / float(self.interval)) + 2

    def _read(self, index):
        return self.drive.at((index + _LATE) * self.interval)
