"""Force of the blocked end-effector: P(t) on a force sensor in its way, the stop.

Behind the sensor's low-pass and delay, with a zero of its own; `pdssjax.actuator.parts` has the law of the stop.
"""

from typing import ClassVar

import numpy as np
from jaxtyping import Float

from ...core import Display
from ..models import Models
from ..setups import AbstractSetup, BlockedActuator
from .base import AbstractMeasurement, Samples


class Force(AbstractMeasurement):
    """The push on a force sensor in the way of the end-effector."""

    columns: ClassVar = {"time": "s", "force": "N"}
    display: ClassVar = Display("force", "forces", "N", 1.0)

    def parts(self) -> frozenset[str]:
        return frozenset({"piezo", "friction", "effector", "stop"})

    def setup(self, models: Models) -> AbstractSetup:
        return BlockedActuator()

    def force(self, samples: Samples) -> Float[np.ndarray, " samples"] | None:
        return samples.measured
