"""A sine that starts at its lowest point, at 0 V unless it is shifted.

    u = b + V/2 (1 - cos(2 pi f t + phi))

With bias b or phase phi the voltage jumps at t = 0, where the drive sets in.
"""

from typing import Self

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import Scalar, ScalarLike, quantity
from .base import AbstractDrive, Segment, Wave


class Sine(AbstractDrive):
    """One segment a period."""

    voltage: float = quantity(64.2, "V", positive=False)
    """Peak to peak voltage V [V]."""
    frequency: float = quantity(5.0, "Hz")
    """Periods a second f [Hz]."""
    bias: float = quantity(0.0, "V", positive=False, optional=True)
    """Lowest voltage b [V]; the highest of a negative V."""
    phase: float = quantity(0.0, "rad", positive=False, optional=True)
    """Phase phi at t = 0 [rad]; pi starts at the highest point."""

    def segment(self, index: Scalar) -> Segment:
        wave = Wave(-0.5 * self.voltage, 2.0 * jnp.pi * self.frequency, jnp.asarray(self.phase, float))
        middle = jnp.asarray(self.bias + 0.5 * self.voltage, float)
        return Segment(1.0 / jnp.asarray(self.frequency, float), middle, jnp.zeros(()), wave)

    def at(self, time: Float[Array, " n"]) -> Float[Array, " n"]:
        turn = 2.0 * jnp.pi * self.frequency * time + self.phase
        return jnp.where(time < 0, 0.0, self.bias + 0.5 * self.voltage * (1.0 - jnp.cos(turn)))

    def period(self) -> tuple[int, int] | None:
        return (0, 1)

    def cycle_frequency(self) -> ScalarLike | None:
        return self.frequency

    def has_jumps(self) -> bool:
        return bool(self.at(jnp.zeros(())) != 0)

    def has_corners(self) -> bool:
        # At t = 0 it sets in from a constant 0 V.
        return bool(self.has_jumps() or jnp.sin(self.phase) != 0.0)

    def peak(self) -> ScalarLike:
        return jnp.maximum(abs(self.bias), abs(self.bias + self.voltage))

    @classmethod
    def examples(cls) -> tuple[Self, ...]:
        return cls(), cls(30.0, 20.0, -20.0), cls(30.0, 20.0, 5.0, 1.0), cls(-30.0, 20.0)
