"""A trapezoid: up to V, a while there, down to 0, a while there.

With T = 1/frequency, width w, rise time tr and fall time tf:

- from 0 to V within tr, then V until w T;
- from V to 0 within tf, then 0 until T.

With tr = tf = 0 it is a square wave that begins with a jump.
"""

from typing import Self

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import Scalar, ScalarLike, quantity
from ._flanks import too_long
from .base import AbstractDrive, Segment


class Trapezoid(AbstractDrive):
    """Four segments a cycle: rise, plateau, fall, rest; the flanks of zero length where they are ideal."""

    voltage: float = quantity(64.2, "V", positive=False)
    """Voltage of the plateau V [V]."""
    frequency: float = quantity(5.0, "Hz")
    """Cycles a second [Hz]."""
    width: float = quantity(0.5, "", high=1.0, optional=True)
    """Share w of the period from the begin of the rise to that of the fall [1]."""
    rise_time: float = quantity(0.0, "s", positive=False, low=0.0, optional=True)
    """Duration of the rise tr [s], below w T; 0 is a jump."""
    fall_time: float = quantity(0.0, "s", positive=False, low=0.0, optional=True)
    """Duration of the fall tf [s], below (1 - w) T; 0 is a jump."""

    def _lengths(self) -> tuple[ScalarLike, ScalarLike, Scalar, Scalar]:
        """Durations of rise and plateau together, of fall and rest together, of the rise and of the fall [s]."""
        high, low = self.width / self.frequency, (1.0 - self.width) / self.frequency
        # A fit may try a flank that is too long; time must not run backwards then.
        return high, low, jnp.minimum(self.rise_time, high), jnp.minimum(self.fall_time, low)

    def segment(self, index: Scalar) -> Segment:
        piece = index % 4
        high, low, rise, fall = self._lengths()
        flank = jnp.where(piece < 2, rise, fall)
        duration = jnp.where(piece % 2 == 0, flank, jnp.where(piece < 2, high, low) - flank)
        moves = (piece % 2 == 0) & (duration > 0)
        change = jnp.where(piece == 0, 1.0, -1.0) * self.voltage
        level = jnp.where((piece == 1) | (piece == 2), 1.0, 0.0)
        start = jnp.where((piece % 2 == 0) & ~moves, 0.5, level) * self.voltage
        return Segment(duration, start, jnp.where(moves, change / jnp.where(moves, duration, 1.0), 0.0))

    def at(self, time: Float[Array, " n"]) -> Float[Array, " n"]:
        high, _, rise, fall = self._lengths()
        phase = jnp.mod(time, 1.0 / self.frequency)
        risen = jnp.where(phase < rise, phase / jnp.where(rise > 0, rise, 1.0), 1.0)
        after = phase - high
        fallen = jnp.where(after < fall, after / jnp.where(fall > 0, fall, 1.0), 1.0)
        return jnp.where(time < 0, 0.0, self.voltage * jnp.where(after < 0, risen, 1.0 - fallen))

    def period(self) -> tuple[int, int] | None:
        return (0, 4)

    def cycle_frequency(self) -> ScalarLike | None:
        return self.frequency

    def has_jumps(self) -> bool:
        return bool((self.rise_time == 0) | (self.fall_time == 0))

    def peak(self) -> ScalarLike:
        return abs(self.voltage)

    def broken_conditions(self) -> dict[str, str]:
        period = 1.0 / self.frequency
        rooms = {
            "rise_time": (self.width * period, "the part of the period that its width leaves to rise and plateau"),
            "fall_time": ((1.0 - self.width) * period, "what its width leaves to fall and rest"),
        }
        lengths = {field: getattr(self, field) for field in rooms}
        broken = {f: too_long(lengths[f], *room) for f, room in rooms.items() if not lengths[f] < room[0]}
        return super().broken_conditions() | broken

    @classmethod
    def examples(cls) -> tuple[Self, ...]:
        return cls(), cls(30.0, 20.0, 0.4), cls(-30.0, 20.0, 0.4, 5e-3, 1e-2), cls(30.0, 20.0, 0.7, fall_time=1e-3)
