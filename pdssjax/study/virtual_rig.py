"""A virtual rig: the records that a study's actuator would give, with everything a sensor adds.

Each record is predicted with the study's own numbers (amplifier, sensor bandwidth and delay
included, where listed), gets a zero of its own and noise, both from a seed, and is counted in
steps of the sensor's resolution.
"""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from .errors import InputError
from .records import Record
from .study import Study
from .units import column_unit, factor

_WANDERS = 0.1
"""Zeros of records whose offset is free lie within this share of the record's range."""


@dataclasses.dataclass(frozen=True, eq=False)
class Recording:
    """One record as the virtual rig made it."""

    record: Record
    """With what was measured filled in."""
    true: Float[np.ndarray, " samples"]
    """The motion or force without zero, noise and rounding."""
    offset: float
    """The zero that went in."""


def make_recordings(study: Study, seed: int = 0) -> list[Recording]:
    """Every record of `study`, as a rig with the study's values would measure it.

    **Arguments:** the numbers of the parameters are their values or starts.  The same `seed`
    gives the same records, and each record its own noise, whatever the others are.

    **Raises:** `InputError` for a parameter without a number, and for a simulation that fails.
    """
    where = study.path or study.title
    motions = study.predict()
    return [_recorded(*pair, seed, str(where)) for pair in zip(study.records, motions, strict=True)]


def _recorded(record: Record, motion: Any, seed: int, where: str) -> Recording:
    true = np.asarray(motion)
    if not np.isfinite(true).all():
        raise InputError(f'{where}: record "{record.name}": found a simulation that fails, expected numbers that work.')
    random = np.random.default_rng([seed, *record.name.encode()])
    offset = record.offset
    if offset is None:
        offset = float(random.uniform(-_WANDERS, _WANDERS) * np.ptp(true))
    shown = true + offset + random.normal(0.0, record.noise or 0.0, true.size)
    if record.resolution:
        shown = np.round(shown / record.resolution) * record.resolution
    return Recording(dataclasses.replace(record, measured=shown), true, offset)


def write_csv(recording: Recording, file: Path) -> None:
    """The record as the study describes its file: columns by their names and units.

    **Raises:** `InputError` where the name of a column does not tell its unit.
    """
    record = recording.record
    data = {"time": (record.time + record.start, "s"), "motion": (record.motion, "m"), "force": (record.measured, "N")}
    data["displacement"] = (record.measured, "m")
    names, columns, formats = [], [], []
    for quantity, (name, unit) in record.columns.items():
        values, si = data[quantity]
        where = f'record "{record.name}": column "{name}"'
        columns.append(np.asarray(values) / factor(unit or column_unit(name), si, where))
        names.append(name)
        # A clock that began long ago needs more digits to tell its samples apart.
        formats.append("%.15g" if quantity == "time" and record.start else "%.9g")
    file.parent.mkdir(parents=True, exist_ok=True)
    header = ",".join(names)
    np.savetxt(file, np.column_stack(columns), fmt=formats, delimiter=",", header=header, comments="", encoding="utf-8")


def truth(study: Study, recordings: list[Recording], seed: int) -> dict[str, Any]:
    """What went in, as plain data for a file."""
    return {
        "format": "pdssjax-truth/1",
        "seed": seed,
        "parameters": {
            path: {"value": float(number), "unit": study.parameters[path].unit}
            for path, number in study.values().items()
        },
        "records": [
            {"name": r.record.name, "offset": r.offset, "noise": r.record.noise, "resolution": r.record.resolution}
            for r in recordings
        ],
    }
