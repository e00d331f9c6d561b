"""Acceleration of the end-effector or of the platform: x_e''(t) or y''(t), from an accelerometer that rides on it.

`of` says on which of them.  It shows the rate of what a velocity sensor with the same low-pass shows; the delay
shifts it.  Where a contact switches, the acceleration may jump.  Under a piezo without inertia it has no bound at
a corner of the voltage, where the velocity jumps.
"""

from typing import ClassVar

from ...core import Choice, Display, choice
from ...simulation import ACCELERATION
from ..models import Models
from ..setups import AbstractSetup, sensor_on
from .base import AbstractMeasurement


class Acceleration(AbstractMeasurement):
    """The end-effector or the platform, by an accelerometer."""

    columns: ClassVar = {"time": "s", "acceleration": "m/s^2"}
    display: ClassVar = Display("acceleration", "accelerations", "m/s^2", 1.0)

    of: Choice = choice({"effector": 0.0, "platform": 1.0})
    """What the sensor rides on."""

    def parts(self) -> frozenset[str]:
        return frozenset({"piezo"} if self.of == 1.0 else {"piezo", "friction", "effector"})

    def setup(self, models: Models) -> AbstractSetup:
        return sensor_on(self.of, ACCELERATION, models)

    def at_a_jump(self) -> str:
        return "its acceleration has no bound there"

    def at_a_corner(self) -> str:
        return "its acceleration has no bound there"
