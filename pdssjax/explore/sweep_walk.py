"""The walk at a point of a sweep, and a small map to click in."""

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float

from ..core import InputError
from ..study import Record, Study
from ..sweeps import Grid, driven_record, sweep
from .background_job import Report
from .knobs import inner_drive
from .live_record import LiveRecord
from .settings import Settings, study_at

if TYPE_CHECKING:
    import xarray

CYCLES = 5
"""Of a walk that are shown."""

_INSTANTS = 1500

_EACH_WAY = 9
"""Values of voltage and of frequency of a small map."""


class Walk(NamedTuple):
    """A few cycles from rest; arrays of shape (k,)."""

    time: Float[np.ndarray, " k"]
    """[s]"""
    voltage: Float[np.ndarray, " k"]
    """[V]"""
    platform: Float[np.ndarray, " k"]
    """[m]"""
    effector: Float[np.ndarray, " k"]
    """[m]"""
    message: str
    """Why it could not be simulated; empty where it could."""


class Walker:
    """Walks the record of a sweep at any of its points; compiled at the first."""

    def __init__(self, study: Study, record: str | None):
        self.record = driven_record(study, record)
        self.study = study.as_in(self.record)
        self._live: LiveRecord | None = None

    def motion(self, numbers: Mapping[str, float]) -> Walk:
        """The first `CYCLES` cycles with the `numbers` [SI] of a point, parameters and drive, by path.

        **Raises:** `InputError` where parameters are left without a number.
        """
        record, values = self._at(numbers)
        instants = np.linspace(0.0, float(record.time[-1]), _INSTANTS)
        self._live = self._live or LiveRecord(self.study, record, values)
        found = self._live.run(record, values, instants)
        inside = found.inside
        platform = np.asarray(inside.platform)
        effector = platform - np.asarray(inside.relative)
        return Walk(instants, np.asarray(inside.voltage), platform, effector, found.message)

    def _at(self, numbers: Mapping[str, float]) -> tuple[Record, dict[str, float]]:
        assert self.record.drive is not None
        named = {field.name for field in dataclasses.fields(inner_drive(self.record.drive))}
        fields = {path.removeprefix("drive."): n for path, n in numbers.items() if path.startswith("drive.")}
        drive = self.record.drive.with_numbers({field: n for field, n in fields.items() if field in named})
        frequency = drive.cycle_frequency()
        assert frequency is not None
        time = np.linspace(0.0, CYCLES / float(frequency), 2)
        legal = self.study.legal()
        # What the drive has is no parameter of the study here.
        values = {path: n for path, n in numbers.items() if path in legal and not path.startswith("drive.")}
        study = dataclasses.replace(
            self.study, parameters={p: q for p, q in self.study.parameters.items() if not p.startswith("drive.")}
        )
        whole = study.values(values) | values
        return dataclasses.replace(self.record, drive=drive, time=time, measured=np.zeros(2)), whole


def small_map(study: Study, settings: Settings, report: Report, chosen: str) -> "xarray.Dataset":
    """A sweep over voltage and frequency about those of a record, at the numbers of `settings`.

    Of the record `chosen`, by name, or of the first that walks where that one does not.

    **Raises:** `InputError` where no end-effector walks, or the drive has no voltage and frequency.
    """
    here = study_at(study, settings)
    record = _walking(here, chosen)
    assert record.drive is not None
    numbers = record.drive.numbers()
    if not {"voltage", "frequency"} <= set(numbers):
        raise InputError(
            f'record "{record.name}": found a drive without voltage and frequency, expected one with both.'
        )
    voltage, frequency = float(numbers["voltage"]), float(numbers["frequency"])
    axes = {
        "drive.voltage": voltage * np.linspace(0.25, 1.25, _EACH_WAY),
        "drive.frequency": frequency * np.geomspace(0.25, 4.0, _EACH_WAY),
    }
    report("sweeping: compiling")
    return sweep(
        here,
        Grid(axes),
        record=record.name,
        progress=lambda done, points: report(f"sweeping: {done} of {points} points"),
    )


def _walking(study: Study, chosen: str) -> Record:
    try:
        return driven_record(study, chosen)
    except InputError:
        return driven_record(study, None)
