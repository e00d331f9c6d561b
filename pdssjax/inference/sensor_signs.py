"""Questions a record that moves against its drive: a sensor that counts the other way, or the other direction.

A platform follows the voltage, an end-effector late on the slow flanks of its drive; where one goes the other way,
something is the wrong way round.
"""

import warnings
from collections.abc import Sequence

from ..core import InputWarning
from ..metrics import goes_against, rides_against
from ..study import Record
from .initial_values.record_features import voltages

_FEWEST = 8
"""Samples from which it is looked at."""


def question_signs(records: Sequence[Record]) -> None:
    """Warns with `InputWarning` of records of displacements that move against their drives."""
    for record in records:
        if found := _doubt(record):
            warnings.warn(f"{record.file}: {found}", InputWarning, stacklevel=2)


def about_signs(records: Sequence[Record]) -> list[str]:
    """The same as sentences for a report."""
    return [f"{found[0].upper()}{found[1:]}" for record in records if (found := _doubt(record))]


def _doubt(record: Record) -> str | None:
    if not (_told(record) and _against(record)):
        return None
    turned = " or the drive's direction is the other one" if _has_flanks(record) else ""
    return (
        f'record "{record.name}": found a motion against the voltage, expected one with it; the sensor counts the '
        f"other way (scale = -1 in the record turns it; where it has a scale, the other sign){turned}."
    )


def _against(record: Record) -> bool:
    samples = record.time, record.measured, voltages(record)
    frequency = record.drive.cycle_frequency() if record.drive is not None else None
    if frequency is None or not _has_flanks(record) or record.measurement.platform_alone:
        return goes_against(*samples)
    return rides_against(*samples, 1.0 / float(frequency))


def _has_flanks(record: Record) -> bool:
    return record.drive is not None and record.drive.flanks() is not None


def _told(record: Record) -> bool:
    """Whether the voltage says which way a record goes: not where it is a wave that the platform may lag behind."""
    if record.drive is None or record.measurement.unit != "m" or record.time.size < _FEWEST:
        return False
    return _has_flanks(record) or (record.measurement.platform_alone and record.drive.cycle_frequency() is None)
