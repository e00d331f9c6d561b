"""A virtual rig: the records that a study's actuator would give, with everything a sensor adds.

Each record is predicted with the study's own numbers (amplifier, sensor bandwidth and delay
included, where listed), gets a zero of its own and noise, both from a seed, and is counted in
steps of the sensor's resolution.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from ..core import Document, InputError
from .record import Record
from .simulation_failure import failure_cause
from .study import Study


@dataclasses.dataclass(frozen=True, eq=False)
class Recording:
    """One record as the virtual rig made it."""

    record: Record
    """The record with what was measured filled in."""
    true: Float[np.ndarray, " samples"]
    """True values of the measured quantity, in SI, without zero, noise and rounding."""
    offset: float
    """The zero that went in."""


def make_recordings(study: Study, seed: int = 0) -> list[Recording]:
    """Every record of `study`, as a rig with the study's values would measure it.

    **Arguments:** the numbers of the parameters are their values or starts.  The same `seed`
    gives the same records, and each record its own noise, whatever the others are.

    **Raises:** `InputError` for a parameter without a number, and for a simulation that fails.
    """
    motions = [np.asarray(motion) for motion in study.predict()]
    if not all(np.isfinite(motion).all() for motion in motions):
        cause = failure_cause(study.predictor, study.records, study.values(), study.accuracy)
        raise InputError(
            f"{study.path or study.title}: found a simulation that fails, expected one that reaches the end of its "
            f"records: {cause}."
        )
    recordings = []
    for record, true in zip(study.records, motions, strict=True):
        random = np.random.default_rng([seed, *record.name.encode()])
        offset = record.offset
        if offset is None:
            offset = float(random.uniform(-0.1, 0.1) * np.ptp(true))
        shown = true + offset + random.normal(0.0, record.noise or 0.0, true.size)
        if record.resolution:
            shown = np.round(shown / record.resolution) * record.resolution
        recordings.append(Recording(dataclasses.replace(record, measured=shown), true, offset))
    return recordings


def truth(study: Study, recordings: list[Recording], seed: int) -> Document:
    """The true numbers of a virtual rig, as plain data for a file."""
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
