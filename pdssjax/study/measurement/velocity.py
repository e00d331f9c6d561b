"""Velocity of the end-effector or of the platform: x_e'(t) or y'(t), from a laser vibrometer.

`of` says which of them the beam meets.  With the sensor's low-pass of bandwidth f_s it shows s' = w_s (v - s),
w_s = 2 pi f_s, which is the true velocity less the rate of the lag of a displacement sensor with the same
low-pass (`pdssjax.actuator.parts`); the delay shifts it.  A zero that is left free takes the mean of what
is left, a steady speed of walking included.
"""

from typing import ClassVar

import numpy as np
from jaxtyping import Float

from ...core import VELOCITY as SHOWN, Choice, choice
from ...metrics import integrated, velocity_zero
from ...simulation import VELOCITY
from ..models import Models
from ..setups import AbstractSetup, sensor_on
from .base import AbstractMeasurement, Samples


class Velocity(AbstractMeasurement):
    """The end-effector or the platform, by a laser vibrometer."""

    columns: ClassVar = {"time": "s", "velocity": "m/s"}
    display: ClassVar = SHOWN

    of: Choice = choice({"effector": 0.0, "platform": 1.0})
    """What moves past the sensor."""

    def parts(self) -> frozenset[str]:
        return frozenset({"piezo"} if self.of == 1.0 else {"piezo", "friction", "effector"})

    def setup(self, models: Models) -> AbstractSetup:
        return sensor_on(self.of, VELOCITY, models)

    def at_a_jump(self) -> str:
        return "its velocity has no bound there"

    def displacement(self, samples: Samples) -> Float[np.ndarray, " samples"] | None:
        zero = samples.offset
        if zero is None:
            # In the end the platform is about where it began.
            zero = velocity_zero(samples.time, samples.measured, samples.voltage, returns=self.of == 1.0)
        return None if zero is None else integrated(samples.time, samples.measured - zero)
