"""Displacement of the platform: y(t), from a sensor that looks at it.

Behind the sensor's low-pass and delay, with a zero of its own.  Without feedback the end-effector
does not matter, and where the piezo is known in closed form nothing is integrated.
"""

from typing import ClassVar

import numpy as np
from jaxtyping import Float

from ...core import LENGTH
from ...simulation import DISPLACEMENT
from ..models import Models
from ..setups import AbstractSetup, sensor_on
from .base import AbstractMeasurement, Samples


class Platform(AbstractMeasurement):
    """The platform, by a displacement sensor."""

    columns: ClassVar = {"time": "s", "displacement": "m"}
    display: ClassVar = LENGTH

    def parts(self) -> frozenset[str]:
        return frozenset({"piezo"})

    def setup(self, models: Models) -> AbstractSetup:
        return sensor_on(1.0, DISPLACEMENT, models)

    def displacement(self, samples: Samples) -> Float[np.ndarray, " samples"] | None:
        return samples.measured
