"""A triangle: up from 0 to V, down to 0 again, each along a straight line.

With T = 1/frequency and symmetry p the rise takes p T and the fall (1 - p) T.  Near p = 1 it is
a sawtooth whose fast flank ends the cycle in place of beginning the next one.
"""

from typing import Self

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import Scalar, ScalarLike, quantity
from .base import AbstractDrive, Segment


class Triangle(AbstractDrive):
    """Two segments a cycle: the rise, then the fall."""

    voltage: float = quantity(64.2, "V", positive=False)
    """Peak voltage V [V]."""
    frequency: float = quantity(5.0, "Hz")
    """Cycles a second [Hz]."""
    symmetry: float = quantity(0.5, "", high=1.0, optional=True)
    """Share p of the period that the rise takes [1]."""

    def segment(self, index: Scalar) -> Segment:
        rises = index % 2 == 0
        duration = jnp.where(rises, self.symmetry, 1.0 - self.symmetry) / self.frequency
        return Segment(
            duration, jnp.where(rises, 0.0, self.voltage), jnp.where(rises, 1.0, -1.0) * self.voltage / duration
        )

    def at(self, time: Float[Array, " n"]) -> Float[Array, " n"]:
        phase = jnp.mod(time * self.frequency, 1.0)
        level = jnp.where(phase < self.symmetry, phase / self.symmetry, (1.0 - phase) / (1.0 - self.symmetry))
        return jnp.where(time < 0, 0.0, self.voltage * level)

    def period(self) -> tuple[int, int] | None:
        return (0, 2)

    def cycle_frequency(self) -> ScalarLike | None:
        return self.frequency

    def has_jumps(self) -> bool:
        return False

    def peak(self) -> ScalarLike:
        return abs(self.voltage)

    @classmethod
    def examples(cls) -> tuple[Self, ...]:
        return cls(), cls(30.0, 20.0, 0.3)
