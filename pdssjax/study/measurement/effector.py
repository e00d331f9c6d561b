"""Displacement of the end-effector: x_e(t) = y - d, from a sensor that looks at it while it walks.

Behind the sensor's low-pass and delay, with a zero of its own.
"""

from typing import ClassVar

import numpy as np
from jaxtyping import Float

from ...core import LENGTH
from ...simulation import DISPLACEMENT
from ..models import Models
from ..setups import AbstractSetup, FreeActuator
from .base import AbstractMeasurement, Samples


class Effector(AbstractMeasurement):
    """The end-effector, by a displacement sensor."""

    columns: ClassVar = {"time": "s", "displacement": "m"}
    display: ClassVar = LENGTH

    def parts(self) -> frozenset[str]:
        return frozenset({"piezo", "friction", "effector"})

    def setup(self, models: Models) -> AbstractSetup:
        return FreeActuator(DISPLACEMENT)

    def displacement(self, samples: Samples) -> Float[np.ndarray, " samples"] | None:
        return samples.measured
