"""A record, as a study's [[record]] table and its CSV file tell it."""

import warnings
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..core import InputError, InputWarning, choices, member, members, to_si
from ..drive.base import AbstractDrive
from ..study import MARK, STEP_TIME, AbstractMeasurement, Record, check_increasing, check_meets_drive
from .csv_columns import read_csv
from .drive_table import read_drive
from .toml_table import Table

_FAMILY = "study.measurement"

_KEYS = [
    *("name", "file", "columns", "units", "measures", "role", "noise", "offset"),
    *("window", "exclude", "start", "drive", "resolution", "sampling", "conditions"),
]


def read_record(table: Table, folder: Path, virtual: bool = False) -> Record:
    """The record that a [[record]] `table` describes; its file is relative to `folder`.

    Of a `virtual` rig the record is still to be made: where the table has `sampling`, nothing
    is read, and what was measured is zero.

    **Raises:** `InputError` if the table or the file is at fault, or if the record's clock cannot
    meet its drive.  Warns with `InputWarning` if the times look like milliseconds or end before
    the first period.
    """
    kinds = [member(_FAMILY, kind) for kind in members(_FAMILY)]
    table.only([*_KEYS, *dict.fromkeys(key for kind in kinds for key in choices(kind))])
    file = folder / table.text("file", "the path of a CSV file")
    name = table.text("name", "a name", file.stem)
    measurement = _measurement(table)
    unit = measurement.unit
    drive, overrides = None, frozenset()
    if measurement.driven:
        described = table.table("drive", 'a table such as { waveform = "step", voltage = "48.2 V" }')
        drive, overrides = read_drive(described, table, folder)
    elif "drive" in table.entries:
        raise InputError(
            f'{table.at("drive")}: found a drive, expected none: the "motion" of a {measurement.name} record is '
            "prescribed."
        )
    columns = _columns(table, measurement.columns)
    start = _start(table, measurement)
    if virtual and "sampling" in table.entries:
        data = _planned(table, measurement)
        begin = float(data["time"][0])
    else:
        data, begin = _samples(table, file, measurement.columns, columns)
    where = f'{file}: record "{name}"'
    check_meets_drive(where, begin, data["time"], drive, start)
    data["time"] = data["time"] - start
    _warn(where, data["time"], drive)
    return Record(
        name=name,
        file=file,
        role=table.option("role", ["fit", "validate"], "fit"),
        measurement=measurement,
        drive=drive,
        overrides=overrides,
        time=data["time"],
        measured=data[measurement.quantity],
        noise=_positive(table, "noise", unit),
        offset=None if table.entries.get("offset", "free") == "free" else table.number("offset", unit),
        motion=data.get("motion"),
        resolution=_positive(table, "resolution", unit) or 0.0,
        columns=columns,
        conditions=_conditions(table),
        start=start,
    )


def _conditions(table: Table) -> frozenset[str]:
    """What parameters such as "friction.f_ss_a@wet" refer to."""
    expected = 'a list of names such as ["wet"]'
    found = table.get("conditions", list, expected, [])
    for name in found:
        if not isinstance(name, str) or not name or MARK in name:
            raise InputError(f"{table.at('conditions')}: found {name!r}, expected {expected}, without {MARK}.")
    return frozenset(found)


def _measurement(table: Table) -> AbstractMeasurement:
    """What the record measures, with the keys that only a record of it has."""
    kind = member(_FAMILY, table.option("measures", members(_FAMILY)))
    named = choices(kind)
    table.only([*_KEYS, *named])
    return kind(**{key: table.option(key, options, next(iter(options))) for key, options in named.items()})


def _start(table: Table, measurement: AbstractMeasurement) -> float:
    """When the drive starts on the clock of the record's file [s]."""
    if not measurement.driven and "start" in table.entries:
        raise InputError(
            f"{table.at('start')}: found a start, expected none: a {measurement.name} record has no drive."
        )
    return table.number("start", "s", 0.0)


def _columns(table: Table, si_units: Mapping[str, str]) -> dict[str, tuple[str, str]]:
    """By quantity, the name of its column, and its unit as [record.units] says; "" where the name says it."""
    *_, explained = si_units
    columns = table.table("columns", f'a table such as {{ time = "time_s", {explained} = "..." }}')
    columns.only(si_units)
    units = table.table("units", f'a table such as {{ {explained} = "..." }}', {})
    units.only(si_units)
    names = {quantity: columns.text(quantity, "the name of a column") for quantity in si_units}
    written = {quantity: units.text(quantity, "a unit") for quantity in units.entries}
    return {quantity: (name, written.get(quantity, "")) for quantity, name in names.items()}


def _planned(table: Table, measurement: AbstractMeasurement) -> dict[str, np.ndarray]:
    """Sample times, and the motion where that is prescribed, as the record's `sampling` plans them."""
    example = 'a table such as { start = "0.2 s", end = "2 s", interval = "1 ms" }'
    plan = table.table("sampling", example)
    plan.only(["start", "end", "interval", *measurement.plan])
    start, end, interval = plan.number("start", "s", 0.0), plan.number("end", "s"), plan.number("interval", "s")
    if not 0.0 < interval < end - start:
        raise InputError(
            f"{plan.at('interval')}: found {interval:g} s for samples from {start:g} s to {end:g} s, "
            "expected an interval above 0 that fits in between."
        )
    time = start + interval * np.arange(int((end - start) / interval * (1 + 1e-12)) + 1)
    planned = measurement.planned(time - start, {key: plan.number(key, unit) for key, unit in measurement.plan.items()})
    return {"time": time, **planned, measurement.quantity: np.zeros(time.shape)}


def _samples(
    table: Table, file: Path, si_units: Mapping[str, str], columns: dict[str, tuple[str, str]]
) -> tuple[dict[str, np.ndarray], float]:
    """The columns of the samples kept, by quantity, checked, and the first time in the file [s]."""
    names = {quantity: name for quantity, (name, _) in columns.items()}
    data, lines = read_csv(file, names, si_units, {quantity: unit for quantity, (_, unit) in columns.items()})
    time = data["time"]
    check_increasing(file, names["time"], time, lines)
    keep = _kept(table, time)
    for quantity in list(si_units)[1:]:
        if np.all(data[quantity][keep] == data[quantity][keep][0]):
            raise InputError(
                f'{file}: column "{names[quantity]}": found the same {quantity} in all {np.sum(keep)} samples, '
                "expected a record that moves."
            )
    return {quantity: column[keep] for quantity, column in data.items()}, float(time[0])


def _kept(table: Table, time: np.ndarray) -> np.ndarray:
    """Which samples the record's `window` and `exclude`, on the clock of its file, leave, shape (samples,)."""
    keep = np.ones(time.shape, bool)
    if "window" in table.entries:
        start, end = _interval(table.entries["window"], table.at("window"))
        keep &= (time >= start) & (time <= end)
    excluded = table.get("exclude", list, "a list of pairs of times", [])
    for index, pair in enumerate(excluded, start=1):
        start, end = _interval(pair, f"{table.at('exclude')}: pair {index}")
        keep &= (time < start) | (time > end)
    if not keep.any():
        raise InputError(
            f'{table.where}: found no sample left by "window" and "exclude", '
            f"expected some of the record's {time[0]:g} s to {time[-1]:g} s."
        )
    return keep


def _interval(given: object, where: str) -> tuple[float, float]:
    if not isinstance(given, list) or len(given) != 2:
        raise InputError(f'{where}: found {given}, expected a pair of times such as ["3 s", "5 s"].')
    start, end = (to_si(time, "s", where) for time in given)
    if start >= end:
        raise InputError(f"{where}: found {start:g} s to {end:g} s, expected an end after its start.")
    return start, end


def _positive(table: Table, key: str, unit: str) -> float | None:
    value = table.number(key, unit, None)
    if value is not None and value <= 0:
        what = "a standard deviation" if key == "noise" else "a step"
        raise InputError(f"{table.at(key)}: found {value:g} {unit}, expected {what} above 0.")
    return value


def _warn(where: str, time: np.ndarray, drive: AbstractDrive | None) -> None:
    if drive is None:
        return
    if not drive.declared():
        return  # samples say nothing of how long they should be
    frequency = drive.cycle_frequency()
    period = STEP_TIME if frequency is None else 1.0 / frequency
    interval = float(np.median(np.diff(time)))
    length = float(time[-1] - time[0])
    # A thousand times too long, a record has too few samples or too many periods to be true.
    if interval >= period / 2 or length >= 1000 * period:
        warnings.warn(
            f"{where}: the times look like milliseconds: found samples {interval:g} s apart over {length:g} s, "
            f"expected many in {period:g} s. [record.units] or the column's name tells their unit.",
            InputWarning,
            stacklevel=2,
        )
    elif frequency is not None and length + interval < period * (1 - 1e-6):
        warnings.warn(
            f"{where}: found {length:g} s of samples, expected at least one period of the drive, {period:g} s.",
            InputWarning,
            stacklevel=2,
        )
