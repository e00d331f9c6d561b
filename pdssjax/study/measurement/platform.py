"""Displacement of the platform: y(t), from a sensor that looks at it.

Behind the sensor's low-pass and delay, with a zero of its own.  Without feedback the end-effector
does not matter, and where the piezo is known in closed form nothing is integrated.
"""

from typing import ClassVar

from ...core import LENGTH
from ...simulation import DISPLACEMENT
from ..setups import sensor_on
from .base import AbstractMeasurement


class Platform(AbstractMeasurement):
    """The platform, by a displacement sensor."""

    columns: ClassVar = {"time": "s", "displacement": "m"}
    display: ClassVar = LENGTH

    def parts(self):
        return frozenset({"piezo"})

    def setup(self, models):
        return sensor_on(1.0, DISPLACEMENT, models)

    def displacement(self, samples):
        return samples.measured
