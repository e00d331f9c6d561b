"""The drive of a record, as its `drive` table in a study file describes it."""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from ..actuator import ZeroOrderHold
from ..core import InputError, Quantity, choices, member, members, quantities
from ..drive.base import AbstractDrive
from ..metrics import smoothed
from .layout_table import decimal_at, interval_at, name_at, scales_at
from .record_columns import Layout, read_columns
from .toml_table import Table

SAMPLED_KEYS = ["column", "file", "time", "unit", "scale", "decimal", "smooth"]
"""What a sampled drive needs besides its choices: where its voltages are."""

_UNEVEN = 0.01
"""Part of an interval by which samples that are to be smoothed may be off."""

_QUIET = 0.02
"""Part of the peak up to which a measured voltage counts as 0 V."""


def read_drive(table: Table, record: Table, folder: Path, told: Table) -> tuple[AbstractDrive, frozenset[str]]:
    """The drive that the `drive` table of a `record` describes, and the fields it sets itself.

    With `zero_order_hold` it is the staircase of a converter that renews the voltage that often.  A number that it
    needs and leaves out is that of the study's parameter: what is `told` of it, by path, if anything.

    **Raises:** `InputError` if the waveform or a field is unknown, missing or illegal.
    """
    name = table.option("waveform", members("drive"))
    drive = member("drive", name)
    named, numbers = choices(drive), quantities(drive)
    sampled = name == "sampled"
    table.only(["waveform", "hold", *named, *numbers, *(SAMPLED_KEYS if sampled else [])])
    fields: dict[str, Any] = {key: table.option(key, options, next(iter(options))) for key, options in named.items()}
    for key, declared in numbers.items():
        if key in table.entries or not declared.optional:
            fields[key] = _number(table, key, declared, told)
    overrides = frozenset(fields) & frozenset(table.entries)
    if sampled:
        fields |= _voltages(table, record, folder)
    made = drive(**fields)
    for key, clause in made.broken_conditions().items():
        raise InputError(f"{table.at(key)}: found {clause}.")
    return (ZeroOrderHold(made, _hold_interval(table, made)) if "hold" in table.entries else made), overrides


def _number(table: Table, key: str, declared: Quantity, told: Table) -> float:
    """What the drive's `table` says of a field, or else its parameter: the value, or where a fit starts."""
    path = f"drive.{key}"
    if key in table.entries or path not in told.entries:
        return table.quantity(key, declared)
    parameter = told.table(path, "a table such as { value = ... }")
    return parameter.quantity("start" if "start" in parameter.entries else "value", declared)


def _voltages(table: Table, record: Table, folder: Path) -> dict[str, Any]:
    """Times [s] and voltages [V] of a sampled drive, from t = 0 on: a column of the record's file or of another.

    What comes from the record's own file is on its clock, which the record's `start` shifts.
    """
    column = name_at(table, "column", "the name or the number of a column of voltages")
    beside = folder / record.text("file", "the path of a file")
    file = folder / table.text("file", "the path of a file") if "file" in table.entries else beside
    found = read_columns(file, _layout(table, record, column))
    found.check_numbers()
    time, voltage = found.data["time"], _smoothed(table, found.data["time"], found.data["voltage"])
    if file == beside:
        time = time - record.number("start", "s", 0.0)
    where = f'{file}: column "{found.channels["voltage"].name}"'
    peak = float(np.max(np.abs(voltage)))
    if peak == 0:
        raise InputError(
            f"{where}: found 0 V in all {time.size} samples, expected the voltage that moves the actuator."
        )
    early = np.flatnonzero((time < 0) & (np.abs(voltage) > _QUIET * peak))
    # The sample just before t = 0 may already be on the way to the next one.
    early = early[early < np.searchsorted(time, 0.0) - 1]
    if early.size:
        first = early[0]
        raise InputError(
            f"{where}, {found.reader.place} {found.places[first]}: found {voltage[first]:g} V at {time[first]:g} s, "
            "expected 0 V before t = 0, where the drive starts from rest; the record's key start shifts its clock."
        )
    if time[-1] <= 0:
        raise InputError(f"{where}: found {time[-1]:g} s as the last time, expected samples after t = 0.")
    if time[0] >= 0:
        return {"times": time, "voltages": voltage}
    kept = time > 0
    held = table.entries.get("interpolation") == "held"
    begin = voltage[~kept][-1] if held else np.interp(0.0, time, voltage)
    return {"times": np.append(0.0, time[kept]), "voltages": np.append(begin, voltage[kept])}


def _smoothed(table: Table, time: Float[np.ndarray, " n"], voltage: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """The voltages [V] without the noise of their measurement, as far as the key "smooth" asks for it."""
    width = table.number("smooth", "s", None)
    if width is None:
        return voltage
    intervals = np.diff(time)
    longest = 0.05 * float(time[-1] - time[0])
    if not 0 < width <= longest:
        raise InputError(f"{table.at('smooth')}: found {width:g} s, expected a time above 0 and up to {longest:g} s.")
    if np.ptp(intervals) > _UNEVEN * np.median(intervals):
        raise InputError(
            f"{table.at('smooth')}: found samples of the voltage from {intervals.min():g} to {intervals.max():g} s "
            "apart, expected evenly spaced ones."
        )
    return smoothed(voltage, width / float(np.median(intervals)))


def _layout(table: Table, record: Table, column: str | int) -> Layout:
    """Where the voltages are: the drive's table says it, and what it leaves out the record's."""
    elsewhere = record.table("units", "a table of units", {})
    written = {"voltage": (elsewhere, "voltage"), "time": (elsewhere, "time")}
    if "unit" in table.entries:
        written["voltage"] = (table, "unit")
    units = {quantity: t.text(key, "a unit") for quantity, (t, key) in written.items() if key in t.entries}
    columns = record.table("columns", "a table of columns", {})
    source = next((t for t in (table, record, columns) if "time" in t.entries), None)
    names: dict[str, str | int] = {"voltage": column}
    if source is not None and not isinstance(source.entries["time"], dict):
        names["time"] = name_at(source, "time")
    interval, begin = (None, 0.0) if source is None else interval_at(source)
    decimal = decimal_at(table) or decimal_at(record)
    return Layout(names, {"time": "s", "voltage": "V"}, units, scales_at(table, "voltage"), interval, begin, decimal)


def _hold_interval(table: Table, drive: AbstractDrive) -> float:
    """The interval [s] of `zero_order_hold`, checked against the drive."""
    interval = table.number("hold", "s")
    frequency = drive.cycle_frequency()
    period = np.inf if frequency is None else 1.0 / frequency
    if not 0 < interval < period:
        below = f" and below the period, {period:g} s" if frequency is not None else ""
        raise InputError(f"{table.at('hold')}: found {interval:g} s, expected a time above 0{below}.")
    return interval
