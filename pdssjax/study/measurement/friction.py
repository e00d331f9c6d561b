"""Friction force of the contact alone, under a prescribed relative motion: what a tribometer measures.

There is no drive; the motion is a column of the record, or planned as amplitude * sin(2 pi frequency t).
The contact is undeflected at the first sample.  A record without times, force against displacement, is read where
the law does not know how fast the motion is.
"""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from jaxtyping import Float

from ...core import member, member_name, members
from ..models import Models
from ..setups import AbstractSetup, ContactAlone
from .base import AbstractContactMeasurement, MeasuredRecord


class Friction(AbstractContactMeasurement):
    """The contact, by a tribometer."""

    columns: ClassVar = {"time": "s", "motion": "m", "force": "N"}

    def setup(self, models: Models) -> AbstractSetup:
        return ContactAlone()

    def refused(self, models: Models, fixed: Mapping[str, float], record: MeasuredRecord) -> str:
        needed, law = models.friction.without_rate, member_name(models.friction)
        if record.has_clock:
            return ""
        if needed is None:
            knows_none = [name for name in members("friction") if member("friction", name).without_rate is not None]
            return (
                f'found no times, which the law "{law}" needs, expected them (the key time in columns, or '
                f'time = {{ interval = "1 ms" }}) or a law that can do without: {", ".join(knows_none)}'
            )
        missing = {f"friction.{field}": number for field, number in needed.items()}
        missing = {path: number for path, number in missing.items() if fixed.get(path) != number}
        if not missing:
            return ""
        wanted = ", ".join(f'"{path}" = {{ value = {number:g} }}' for path, number in missing.items())
        return (
            f'found no times, expected them (the key time in columns) or {wanted}: then the law "{law}" does not know '
            "how fast the motion is"
        )

    def planned(
        self, time: Float[np.ndarray, " samples"], numbers: Mapping[str, float]
    ) -> dict[str, Float[np.ndarray, " samples"]]:
        return {"motion": numbers["amplitude"] * np.sin(2.0 * np.pi * numbers["frequency"] * time)}
