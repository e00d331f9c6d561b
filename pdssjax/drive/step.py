"""A step of voltage, ideal or with a linear rise: the drive of the thesis's section 4.4."""

from typing import Self

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import Scalar, ScalarLike, quantity
from .base import AbstractDrive, Segment


class Step(AbstractDrive):
    """0 V before t = 0, then `voltage` for good, reached in `rise_time`."""

    voltage: float = quantity(64.2, "V", positive=False)
    """Voltage after the step V [V]."""
    rise_time: float = quantity(0.0, "s", positive=False, low=0.0, optional=True)
    """Duration of the linear rise [s]; 0 is a jump."""

    def segment(self, index: Scalar) -> Segment:
        rises = index == 0
        rise = jnp.asarray(self.rise_time, float)
        slope = jnp.where(rise > 0, self.voltage / jnp.where(rise > 0, rise, 1.0), 0.0)
        return Segment(
            jnp.where(rises, rise, jnp.inf),
            jnp.where(rises, jnp.where(rise > 0, 0.0, 0.5), 1.0) * self.voltage,
            jnp.where(rises, slope, 0.0),
        )

    def at(self, time: Float[Array, " n"]) -> Float[Array, " n"]:
        rise = jnp.asarray(self.rise_time, float)
        ramp = jnp.where(rise > 0, time / jnp.where(rise > 0, rise, 1.0), 1.0)
        return jnp.where(time < 0, 0.0, self.voltage * jnp.minimum(ramp, 1.0))

    def period(self) -> tuple[int, int] | None:
        return None

    def cycle_frequency(self) -> ScalarLike | None:
        return None

    def has_jumps(self) -> bool:
        return bool(self.rise_time == 0)

    def peak(self) -> ScalarLike:
        return abs(self.voltage)

    @classmethod
    def examples(cls) -> tuple[Self, ...]:
        return cls(), cls(-48.2), cls(48.2, 2e-3)
