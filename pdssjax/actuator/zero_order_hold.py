"""The staircase that a digital-to-analogue converter makes of a voltage: zero-order hold."""

import dataclasses
from collections.abc import Mapping
from typing import Self

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import Quantity, Scalar, ScalarLike, quantity
from ..drive.base import AbstractDrive, Flanks, Segment

_LATE = 1e-6
"""Part of an interval after its begin at which the voltage is read: a jump that falls on the begin is over then."""


class ZeroOrderHold(AbstractDrive):
    """`drive`, read once every `interval` and held until the next time; it jumps at every corner."""

    drive: AbstractDrive
    interval: float = quantity(50e-6, "s")
    """Time between two values [s]."""

    def segment(self, index: Scalar) -> Segment:
        index = jnp.asarray(index, float)
        return Segment(jnp.asarray(self.interval, float), self._read(index), jnp.zeros(()))

    def at(self, time: Float[Array, " n"]) -> Float[Array, " n"]:
        # Rounding must not put the begin of an interval into the one before.
        return jnp.where(time < 0, 0.0, self._read(jnp.floor(time / self.interval + 1e-9)))

    def period(self) -> tuple[int, int] | None:
        # The period of the drive need not be a whole number of intervals.
        return None

    def cycle_frequency(self) -> ScalarLike | None:
        """Frequency of the held drive [Hz]: the staircase repeats but for where the intervals fall."""
        return self.drive.cycle_frequency()

    def has_jumps(self) -> bool:
        return True

    def peak(self) -> ScalarLike:
        """Peak of the held drive [V]: the staircase stays below by the change of the voltage in an interval."""
        return self.drive.peak()

    def flanks(self) -> Flanks | None:
        return self.drive.flanks()

    def slow_flank_times(self, parts: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        return self.drive.slow_flank_times(parts)

    def declared(self) -> dict[str, Quantity]:
        """Declared quantities of the held drive: the interval is a record's own."""
        return self.drive.declared()

    def numbers(self) -> dict[str, ScalarLike]:
        return self.drive.numbers()

    def with_numbers(self, numbers: Mapping[str, ScalarLike]) -> Self:
        return dataclasses.replace(self, drive=self.drive.with_numbers(numbers))

    def segments(self, until: float) -> int:
        return int(max(until, 0.0) / float(self.interval)) + 2

    def _read(self, index: Float[Array, "*n"]) -> Float[Array, "*n"]:
        return self.drive.at((index + _LATE) * self.interval)
