"""The record whose drive a sweep varies."""

import dataclasses

from ..core import InputError, nearest
from ..drive.base import AbstractDrive
from ..study import Record, Study


def driven_record(study: Study, name: str | None) -> Record:
    """The effector record `name`, by default the first one under a periodic drive.

    Its drive's voltage is told by the peak, however the study tells it, unless the study lists "drive.voltage".

    **Raises:** `InputError` where there is none.
    """
    where = study.path or study.title
    driven = [r for r in study.records if r.measurement.effector_free and drive_of(r).period() is not None]
    if not driven:
        raise InputError(f"{where}: found no effector record under a periodic drive, expected one whose drive to vary.")
    if name is None:
        return _by_peak(driven[0], study)
    for record in driven:
        if record.name == name:
            return _by_peak(record, study)
    raise InputError(f'{where}: found no record "{name}" to sweep; {nearest(name, [r.name for r in driven])}')


def _by_peak(record: Record, study: Study) -> Record:
    if "drive.voltage" in study.parameters:
        return record
    drive, listed = drive_of(record), study.as_in(record).parameters
    shared = {field: p.number for field in drive.numbers() if (p := listed.get(f"drive.{field}")) is not None}
    known = {f: number for f, number in shared.items() if number is not None and f not in record.overrides}
    return dataclasses.replace(record, drive=drive.with_numbers(known).told_by_peak())


def drive_of(record: Record) -> AbstractDrive:
    """That of a record whose end-effector moves."""
    assert record.drive is not None
    return record.drive
