"""The drive of a record, as its `drive` table in a study file describes it."""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from ..actuator import ZeroOrderHold
from ..core import InputError, Quantity, choices, member, members, quantities
from ..drive.base import AbstractDrive
from .csv_columns import read_csv
from .toml_table import Table

_SAMPLED_KEYS = ["column", "file", "time", "unit"]
"""What a sampled drive needs besides its choices: where its voltages are."""

_QUIET = 0.02
"""Part of the peak up to which a measured voltage counts as 0 V."""


def read_drive(table: Table, record: Table, folder: Path) -> tuple[AbstractDrive, frozenset[str]]:
    """The drive that the `drive` table of a `record` describes, and the fields it sets itself.

    With `zero_order_hold` it is the staircase of a converter that renews the voltage that often.

    **Raises:** `InputError` if the waveform or a field is unknown, missing or illegal.
    """
    name = table.option("waveform", members("drive"))
    drive = member("drive", name)
    named, numbers = choices(drive), quantities(drive)
    sampled = name == "sampled"
    table.only(["waveform", "hold", *named, *numbers, *(_SAMPLED_KEYS if sampled else [])])
    fields: dict[str, Any] = {key: table.option(key, options, next(iter(options))) for key, options in named.items()}
    for key, declared in numbers.items():
        if key in table.entries or not declared.optional:
            fields[key] = table.quantity(key, declared)
    _check_drive(fields, numbers, table)
    overrides = frozenset(fields) & frozenset(table.entries)
    if sampled:
        fields |= _voltages(table, record, folder)
    made = drive(**fields)
    return (ZeroOrderHold(made, _hold_interval(table, made)) if "hold" in table.entries else made), overrides


def _voltages(table: Table, record: Table, folder: Path) -> dict[str, Any]:
    """Times [s] and voltages [V] of a sampled drive, from t = 0 on: a column of the record's file or of another.

    What comes from the record's own file is on its clock, which the record's `start` shifts.
    """
    column = table.text("column", "the name of a column of voltages")
    overrides = folder / record.text("file", "the path of a CSV file")
    file = folder / table.text("file", "the path of a CSV file") if "file" in table.entries else overrides
    columns = record.table("columns", "a table of columns")
    clock = (table if "time" in table.entries else columns).text("time", "the name of a column")
    elsewhere = record.table("units", "a table of units", {})
    written = {"voltage": (table, "unit"), "time": (elsewhere, "time")}
    written = {quantity: t.text(key, "a unit") for quantity, (t, key) in written.items() if key in t.entries}
    data, lines = read_csv(file, {"time": clock, "voltage": column}, {"time": "s", "voltage": "V"}, written)
    time, voltage = data["time"], data["voltage"]
    check_times(file, clock, time, lines)
    if file == overrides:
        time = time - record.number("start", "s", 0.0)
    where = f'{file}: column "{column}"'
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
            f"{where}, line {lines[first]}: found {voltage[first]:g} V at {time[first]:g} s, expected 0 V before "
            "t = 0, where the drive starts from rest; the record's key start shifts its clock."
        )
    if time[-1] <= 0:
        raise InputError(f"{where}: found {time[-1]:g} s as the last time, expected samples after t = 0.")
    if time[0] >= 0:
        return {"times": time, "voltages": voltage}
    kept = time > 0
    held = table.entries.get("interpolation") == "held"
    begin = voltage[~kept][-1] if held else np.interp(0.0, time, voltage)
    return {"times": np.append(0.0, time[kept]), "voltages": np.append(begin, voltage[kept])}


def _hold_interval(table: Table, drive: AbstractDrive) -> float:
    """The interval [s] of `zero_order_hold`, checked against the drive."""
    interval = table.number("hold", "s")
    frequency = drive.cycle_frequency()
    period = np.inf if frequency is None else 1.0 / frequency
    if not 0 < interval < period:
        below = f" and below the period, {period:g} s" if frequency is not None else ""
        raise InputError(f"{table.at('hold')}: found {interval:g} s, expected a time above 0{below}.")
    return interval


def _check_drive(fields: dict[str, Any], numbers: dict[str, Quantity], table: Table) -> None:
    if fields.get("voltage") == 0:
        raise InputError(f"{table.at('voltage')}: found 0 V, expected the voltage that moves the actuator.")
    # What the duty leaves of the period to the slow flank, the fall must not take.
    period = fields.get("duty", 1.0) / fields["frequency"] if "frequency" in fields else np.inf
    whole = "the slow flank" if fields.get("duty", 1.0) < 1.0 else "the period"
    for key, declared in numbers.items():
        if declared.unit == "s" and fields.get(key, 0.0) >= period:
            raise InputError(f"{table.at(key)}: found {fields[key]:g} s, expected less than {whole}, {period:g} s.")


def check_times(
    file: Path, column: str, time: Float[np.ndarray, " samples"], lines: Int[np.ndarray, " samples"]
) -> None:
    """**Raises** `InputError` that names the first line of `lines` at which the `time` [s] does not increase."""
    late = np.flatnonzero(np.diff(time) <= 0)
    if late.size:
        before, here = time[late[0]], time[late[0] + 1]
        raise InputError(
            f'{file}: line {lines[late[0] + 1]}, column "{column}": found {here:.9g} s after {before:.9g} s, '
            "expected times that increase."
        )
