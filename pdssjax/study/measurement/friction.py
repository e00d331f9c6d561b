"""Friction force of the contact alone, under a prescribed relative motion: what a tribometer measures.

There is no drive; the motion is a column of the record, or planned as amplitude * sin(2 pi frequency t).
"""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from jaxtyping import Float

from ...core import Display
from ..models import Models
from ..prediction import AbstractSetup, ContactAlone
from .base import AbstractMeasurement, Samples


class Friction(AbstractMeasurement):
    """The contact, by a tribometer."""

    columns: ClassVar = {"time": "s", "motion": "m", "force": "N"}
    display: ClassVar = Display("force", "forces", "N", 1.0)
    plan: ClassVar = {"amplitude": "m", "frequency": "Hz"}

    def parts(self) -> frozenset[str]:
        return frozenset({"friction"})

    def setup(self, models: Models) -> AbstractSetup:
        return ContactAlone()

    def planned(
        self, time: Float[np.ndarray, " samples"], numbers: Mapping[str, float]
    ) -> dict[str, Float[np.ndarray, " samples"]]:
        return {"motion": numbers["amplitude"] * np.sin(2.0 * np.pi * numbers["frequency"] * time)}

    def force(self, samples: Samples) -> Float[np.ndarray, " samples"] | None:
        return samples.measured
