"""Which numbers of a record's drive come from the study's "drive.…" parameters, and which are the record's own."""

from collections.abc import Mapping

from ..core import ScalarLike
from ..drive.base import AbstractDrive
from .record import Record


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
