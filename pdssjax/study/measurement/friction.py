"""Friction force of the contact alone, under a prescribed relative motion: what a tribometer measures.

There is no drive; the motion is a column of the record, or planned as amplitude * sin(2 pi frequency t).
"""

from typing import ClassVar

import numpy as np

from ...core import Display
from ..setups import ContactAlone
from .base import AbstractMeasurement


class Friction(AbstractMeasurement):
    """The contact, by a tribometer."""

    columns: ClassVar = {"time": "s", "motion": "m", "force": "N"}
    display: ClassVar = Display("force", "forces", "N", 1.0)
    plan: ClassVar = {"amplitude": "m", "frequency": "Hz"}

    def parts(self):
        return frozenset({"friction"})

    def setup(self, models):
        return ContactAlone()

    def planned(self, time, numbers):
        return {"motion": numbers["amplitude"] * np.sin(2.0 * np.pi * numbers["frequency"] * time)}

    def force(self, samples):
        return samples.measured
