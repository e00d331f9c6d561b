"""Records: one for each run of the rig, and which numbers of its drive are parameters of the study."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ..core import ScalarLike, member_name
from ..drive.base import AbstractDrive
from .measurement.base import AbstractMeasurement


@dataclasses.dataclass(frozen=True, eq=False)
class Record:
    """A run of the rig: the drive or the motion applied, and what was measured."""

    name: str
    """Name of the record in reports; no other record of the study has it."""
    file: Path
    """The data file it comes from, in any format of `pdssjax.files.readers`."""
    role: str
    """"fit": fitted; "validate": only predicted and compared."""
    measurement: AbstractMeasurement
    """The measurement: a member of the family `pdssjax.study.measurement`."""
    drive: AbstractDrive | None
    """The voltage, from t = 0 on; fields in SI.  None where a motion is prescribed."""
    overrides: frozenset[str]
    """The drive's fields that the record itself sets; they do not follow the study's "drive.…"."""
    time: Float[np.ndarray, " samples"]
    """Sample times [s], strictly increasing; the drive starts at 0."""
    measured: Float[np.ndarray, " samples"]
    """In the unit of the measurement: displacement [m], velocity [m/s] or force [N]."""
    noise: float | None
    """Standard deviation of the noise, in the same unit; None: estimate it."""
    offset: float | None
    """Zero of the sensor, in the same unit; None: free."""
    motion: Float[np.ndarray, " samples"] | None = None
    """The relative displacement of platform against end-effector [m] where that is prescribed, or its velocity [m/s]:
    the column that `measurement.prescribed` names."""
    resolution: float = 0.0
    """Step in which the sensor counts, in the same unit: for a virtual rig; a fit needs it within the noise."""
    columns: dict[str, tuple[str, str]] = dataclasses.field(default_factory=dict)
    """By quantity, the name of the column, and its unit; "" where the name says it."""
    conditions: frozenset[str] = frozenset()
    """Under which it was made: where a parameter is listed for one of them, that one holds."""
    start: float = 0.0
    """When the drive starts on the clock of the file [s]; `time` counts from there."""
    rest_voltage: float | None = None
    """Voltage [V] at which the actuator is taken to have rested before the record, since nothing says what was before;
    None where the study says it, or the drive starts from 0 V."""

    has_clock: bool = True
    """False: the file has no times, and its samples stand for one a second."""

    @property
    def measures(self) -> str:
        """Name of the measurement, as a study file writes it: "platform", "effector", ..."""
        return self.measurement.name

    @property
    def excitation(self) -> str:
        """The excitation in words: waveform, peak voltage and frequency of the drive."""
        if self.drive is None:
            return "prescribed motion"
        frequency = self.drive.cycle_frequency()
        cycles = "" if frequency is None else f", {float(frequency):g} Hz"
        return f"{member_name(type(self.drive))}, {float(self.drive.peak()):g} V{cycles}"


def shared_fields(record: Record) -> dict[str, str]:
    """The fields of the record's drive that the study sets, each with the path of its parameter.

    A field is the study's unless the record sets it; none without a drive.
    """
    if record.drive is None:
        return {}
    return {field: f"drive.{field}" for field in record.drive.declared() if field not in record.overrides}


def drive_with(record: Record, values: Mapping[str, ScalarLike]) -> AbstractDrive:
    """The drive of a record that has one, with those `values` [SI], by path, that it shares with the study."""
    assert record.drive is not None
    shared = shared_fields(record)
    return record.drive.with_numbers({field: values[path] for field, path in shared.items() if path in values})
