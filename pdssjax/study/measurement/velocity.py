"""Velocity of the end-effector or of the platform: x_e'(t) or y'(t), from a laser vibrometer.

`of` says which of them the beam meets.  With the sensor's low-pass of bandwidth f_s it shows s' = w_s (v - s),
w_s = 2 pi f_s, which is the true velocity less the rate of the lag of a displacement sensor with the same
low-pass (`pdssjax.actuator.sensor`); the delay shifts it.  A zero that is left free takes the mean of what
is left, a steady speed of walking included.
"""

from typing import ClassVar

import numpy as np
from jaxtyping import Float

from ...core import Choice, Display, choice
from ...simulation import VELOCITY
from ..models import Models
from ..setups import AbstractSetup, sensor_on
from .base import AbstractMeasurement, Samples

_FEWEST = 8
"""Samples whose mean is taken for a zero."""

_RESTS = 1e-3
"""Part of the largest voltage by which it may vary where the rig is taken to rest."""


class Velocity(AbstractMeasurement):
    """The end-effector or the platform, by a laser vibrometer."""

    columns: ClassVar = {"time": "s", "velocity": "m/s"}
    display: ClassVar = Display("velocity", "velocities", "mm/s", 1e3)

    of: Choice = choice({"effector": 0.0, "platform": 1.0})
    """What moves past the sensor."""

    def parts(self) -> frozenset[str]:
        return frozenset({"piezo"} if self.of == 1.0 else {"piezo", "friction", "effector"})

    def setup(self, models: Models) -> AbstractSetup:
        return sensor_on(self.of, VELOCITY, models)

    def at_a_jump(self) -> str:
        return "its velocity has no bound there"

    def displacement(self, samples: Samples) -> Float[np.ndarray, " samples"] | None:
        zero = self._zero(samples)
        if zero is None:
            return None
        speed = samples.measured - zero
        steps = 0.5 * (speed[1:] + speed[:-1]) * np.diff(samples.time)
        return np.concatenate([np.zeros(1), np.cumsum(steps)])

    def _zero(self, samples: Samples) -> float | None:
        """What the sensor shows of a thing at rest [m/s]; None where no part of the record tells it."""
        if samples.offset is not None:
            return samples.offset
        late = samples.voltage[-max(samples.voltage.size // 5, _FEWEST) :]
        if np.sum(samples.time < 0) >= _FEWEST:
            rests = samples.measured[samples.time < 0]
        elif np.ptp(late) <= _RESTS * np.max(np.abs(samples.voltage)):
            rests = samples.measured[-late.size :]
        elif self.of == 1.0:
            rests = samples.measured  # in the end the platform is about where it began
        else:
            return None
        return float(np.mean(rests))
