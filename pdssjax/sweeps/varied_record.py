"""The record whose drive a sweep varies."""

from ..core import InputError, nearest
from ..drive.base import AbstractDrive
from ..study import Record, Study


def driven_record(study: Study, name: str | None) -> Record:
    """The effector record `name`, by default the first one under a periodic drive.

    **Raises:** `InputError` where there is none.
    """
    where = study.path or study.title
    driven = [r for r in study.records if r.measurement.effector_free and drive_of(r).period() is not None]
    if not driven:
        raise InputError(f"{where}: found no effector record under a periodic drive, expected one whose drive to vary.")
    if name is None:
        return driven[0]
    for record in driven:
        if record.name == name:
            return record
    raise InputError(f'{where}: found no record "{name}" to sweep; {nearest(name, [r.name for r in driven])}')


def drive_of(record: Record) -> AbstractDrive:
    """That of a record whose end-effector moves."""
    assert record.drive is not None
    return record.drive
