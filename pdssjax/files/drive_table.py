"""The drive of a record by its `drive` table in a study file, and its conditioning before t = 0.

Conditioning is the voltage before a record's t = 0: cycles, or a held voltage.  A sampled voltage that begins off zero
counts as held at its first value before, unless the study says otherwise: `rest_before`.
"""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from ..actuator import ZeroOrderHold
from ..core import InputError, choices, member, members, quantities, to_si
from ..drive.base import AbstractDrive
from ..drive.sampled import Sampled
from ..metrics import flicker_of, smoothed
from .record_columns import Layout, decimal_at, interval_at, name_at, read_columns, scales_at
from .toml_table import Table

_EXPECTED = '"3 cycles", or for a sampled drive { cycles = 3, period = "1 s" } or a time such as "60 s"'

_LONGEST_REST, _SHORTEST_REST = 60.0, 2.0
"""Time for which the first voltage was held [s] by default: long beside all oscillations.  Where the stack must be
integrated during the rest, the length of the record within these limits."""

_FLICKERS, _CHANGES = 2.0, 3.0
"""Multiples of its flicker from which a voltage is off zero; multiples of that up to which its extent is noise."""

_MOST_CYCLES = 10_000
"""More cycles than any stack remembers."""


def conditioned(record: Table, drive: AbstractDrive | None) -> tuple[AbstractDrive | None, float]:
    """The drive of a `record` with its "conditioning" before t = 0, and the time by which it starts earlier [s].

    A waveform runs for some cycles before t = 0.  A sampled drive repeats its first period or holds its first voltage
    for a time; with 0 s the voltage sets in at t = 0.
    """
    if "conditioning" not in record.entries:
        return drive, 0.0
    where = record.at("conditioning")
    if drive is None:
        raise InputError(f"{where}: found conditioning, expected none: the record has no drive.")
    if isinstance(drive, Sampled):
        return _of_samples(record, drive)
    frequency, given = drive.cycle_frequency(), record.get("conditioning", str, _EXPECTED)
    number, _, unit = given.strip().partition(" ")
    if unit.strip() not in ("cycle", "cycles") or not number.isdecimal():
        raise InputError(f'{where}: found "{given}", expected whole cycles such as "3 cycles".')
    if frequency is None:
        raise InputError(f'{where}: found "{given}", expected none: this waveform has no cycle.')
    if not 1 <= int(number) <= _MOST_CYCLES:
        raise InputError(f"{where}: found {number}, expected a number of cycles from 1 to {_MOST_CYCLES}.")
    return drive, int(number) / float(frequency)


def rest_before(
    record: Table, parameters: Table, drive: AbstractDrive | None, begin: float, length: float, settles: bool
) -> tuple[AbstractDrive | None, float, float | None]:
    """The drive of a `record` with its first voltage held before, where that is off zero and the study says nothing.

    **Arguments:** the study's `parameters`, of which those of the stack's initial state describe the time before; the
    `begin` of the record on the clock of the drive and its `length` [s]; whether the stack `settles`, so that a rest
    needs no integration.

    **Returns:** the drive, the time by which it starts earlier [s], and the voltage of the rest [V].  That is None
    where the voltage sets in at t = 0: where the record begins earlier and shows it, or the voltage never changes and
    could not move the actuator otherwise.
    """
    inner = drive.drive if isinstance(drive, ZeroOrderHold) else drive
    is_given = "conditioning" in record.entries or any(path.startswith("piezo.initial_") for path in parameters.entries)
    if drive is None or not isinstance(inner, Sampled) or is_given or begin < 0:
        return drive, 0.0, None
    volts = np.asarray(inner.voltages)
    noise = _FLICKERS * flicker_of(volts)
    # Without noise, a thousandth of the peak still counts as 0 V.
    if abs(volts[0]) <= max(noise, 1e-3 * float(np.max(np.abs(volts)))) or np.ptp(volts) <= _CHANGES * noise:
        return drive, 0.0, None
    rest = _LONGEST_REST if settles else float(np.clip(length, _SHORTEST_REST, _LONGEST_REST))
    if isinstance(drive, ZeroOrderHold):
        # In whole intervals, which keep the times of the steps.
        rest = float(np.ceil(rest / drive.interval)) * float(drive.interval)
        return dataclasses.replace(drive, drive=_with_rest(inner, rest)), rest, float(volts[0])
    return _with_rest(inner, rest), rest, float(volts[0])


def _with_rest(drive: Sampled, time: float) -> Sampled:
    """The drive with its first voltage held for `time` [s] before its first sample."""
    return dataclasses.replace(drive, times=np.asarray(drive.times) + time)


def _of_samples(record: Table, drive: Sampled) -> tuple[Sampled, float]:
    where = record.at("conditioning")
    given = record.get("conditioning", object, _EXPECTED)
    if isinstance(given, str) and given.rstrip().endswith(("cycle", "cycles")):
        raise InputError(f'{where}: found "{given}" of a sampled drive, expected its period, too: {_EXPECTED}.')
    if not isinstance(given, dict):
        rest = to_si(given, "s", where)
        if rest < 0:
            raise InputError(f"{where}: found {rest:g} s, expected a time above 0, or 0 s to set in at t = 0.")
        return _with_rest(drive, rest), rest
    table = record.table("conditioning", _EXPECTED)
    table.only(["cycles", "period"])
    count = table.whole("cycles", f"a number of cycles from 1 to {_MOST_CYCLES}", most=_MOST_CYCLES)
    period = table.number("period", "s")
    times, voltages = np.asarray(drive.times), np.asarray(drive.voltages)
    inside = times < times[0] + period * (1.0 - 1e-9)
    samples = np.count_nonzero(inside)
    if not (period > 0 and 3 <= samples < times.size):
        raise InputError(f"{table.at('period')}: found {period:g} s, expected a time that the samples hold.")
    change = abs(float(voltages[samples] - voltages[0]))
    if change > 0.02 * float(np.ptp(voltages)):
        raise InputError(
            f"{table.at('period')}: found {period:g} s, after which the voltage is {change:.3g} V from where it began, "
            "expected a period of the voltage."
        )
    earlier = (np.arange(count)[:, None] * period + times[inside]).ravel()
    times = np.concatenate([earlier, times + count * period])
    voltages = np.concatenate([np.tile(voltages[inside], count), voltages])
    return dataclasses.replace(drive, times=times, voltages=voltages), count * period


SAMPLED_KEYS = {
    "column": "Name or number of the column with the voltages.",
    "file": "File with the voltages, by default the record's own.",
    "time": "Column of the times, or their interval, by default that of the record.",
    "unit": "Unit of the voltages, where the column's name does not end in it.",
    "scale": 'Factor of the voltages, such as "20 V/V".',
    "decimal": "Decimal sign of a text, by default that of the record, or found in the file.",
    "smooth": "Width [s] over which the voltages are smoothed.",
}
"""Meaning of each key of a sampled drive besides its choices."""


def read_drive(table: Table, record: Table, folder: Path, parameters: Table) -> tuple[AbstractDrive, frozenset[str]]:
    """The drive that the `drive` table of a `record` describes, and the fields that the table sets.

    With `hold` the drive is the staircase of a converter that renews the voltage at this interval.  A missing number
    is taken from the study's `parameters`, by path, if they have it.
    """
    name = table.option("waveform", members("drive"))
    drive = member("drive", name)
    words, numbers = choices(drive), quantities(drive)
    sampled = name == "sampled"
    table.only(["waveform", "hold", *words, *numbers, *(SAMPLED_KEYS if sampled else [])])
    fields: dict[str, Any] = {key: table.option(key, options, next(iter(options))) for key, options in words.items()}
    for key, declared in numbers.items():
        if key not in table.entries and not declared.optional and f"drive.{key}" in parameters.entries:
            parameter = parameters.table(f"drive.{key}", "a table such as { value = ... }")
            fields[key] = parameter.quantity("start" if "start" in parameter.entries else "value", declared)
        elif key in table.entries or not declared.optional:
            fields[key] = table.quantity(key, declared)
    overrides = frozenset(fields) & frozenset(table.entries)
    if sampled:
        fields |= _voltages(table, record, folder)
    waveform = drive(**fields)
    for key, clause in waveform.broken_conditions().items():
        raise InputError(f"{table.at(key)}: found {clause}.")
    if "hold" not in table.entries:
        return waveform, overrides
    interval, frequency = table.number("hold", "s"), waveform.cycle_frequency()
    period = np.inf if frequency is None else 1.0 / frequency
    if not 0 < interval < period:
        below = f" and below the period, {period:g} s" if frequency is not None else ""
        raise InputError(f"{table.at('hold')}: found {interval:g} s, expected a time above 0{below}.")
    return ZeroOrderHold(waveform, interval), overrides


def _voltages(table: Table, record: Table, folder: Path) -> dict[str, Any]:
    """Times [s] and voltages [V] of a sampled drive, from t = 0 on: a column of the record's file or of another.

    Samples from the record's own file have its clock, which the record's `start` shifts.
    """
    column = name_at(table, "column", "the name or the number of a column of voltages")
    own_file = folder / record.text("file", "the path of a file")
    file = folder / table.text("file", "the path of a file") if "file" in table.entries else own_file
    columns = read_columns(file, _layout(table, record, column))
    columns.check_numbers()
    time, voltage = columns.data["time"], _smoothed(table, columns.data["time"], columns.data["voltage"])
    if file == own_file:
        time = time - record.number("start", "s", 0.0)
    where = f'{file}: column "{columns.channels["voltage"].name}"'
    peak = float(np.max(np.abs(voltage)))
    if peak == 0:
        raise InputError(
            f"{where}: found 0 V in all {time.size} samples, expected the voltage that moves the actuator."
        )
    early = np.flatnonzero((time < 0) & (np.abs(voltage) > 0.02 * peak))
    # The sample just before t = 0 may already lie on the way to the next one.
    early = early[early < np.searchsorted(time, 0.0) - 1]
    if early.size:
        k = early[0]
        raise InputError(
            f"{where}, {columns.reader.place} {columns.places[k]}: found {voltage[k]:g} V at {time[k]:g} s, "
            "expected 0 V before t = 0, where the drive starts from rest; the record's key start shifts its clock."
        )
    if time[-1] <= 0:
        raise InputError(f"{where}: found {time[-1]:g} s as the last time, expected samples after t = 0.")
    if time[0] >= 0:
        return {"times": time, "voltages": voltage}
    after = time > 0
    held = table.entries.get("interpolation") == "held"
    begin = voltage[~after][-1] if held else np.interp(0.0, time, voltage)
    return {"times": np.append(0.0, time[after]), "voltages": np.append(begin, voltage[after])}


def _smoothed(table: Table, time: Float[np.ndarray, " n"], voltage: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """The voltages [V], smoothed where the table has the key "smooth"."""
    width = table.number("smooth", "s", None)
    if width is None:
        return voltage
    intervals = np.diff(time)
    longest = 0.05 * float(time[-1] - time[0])
    if not 0 < width <= longest:
        raise InputError(f"{table.at('smooth')}: found {width:g} s, expected a time above 0 and up to {longest:g} s.")
    if np.ptp(intervals) > 0.01 * np.median(intervals):
        raise InputError(
            f"{table.at('smooth')}: found samples of the voltage from {intervals.min():g} to {intervals.max():g} s "
            "apart, expected evenly spaced ones."
        )
    return smoothed(voltage, width / float(np.median(intervals)))


def _layout(table: Table, record: Table, column: str | int) -> Layout:
    """Columns, units and clock of the voltages: from the drive's `table`, else from the `record`."""
    of_record = record.table("units", "a table of units", {})
    units = {
        quantity: of_record.text(quantity, "a unit")
        for quantity in ("voltage", "time")
        if quantity in of_record.entries
    }
    if "unit" in table.entries:
        units["voltage"] = table.text("unit", "a unit")
    columns = record.table("columns", "a table of columns", {})
    source = next((t for t in (table, record, columns) if "time" in t.entries), None)
    names: dict[str, str | int] = {"voltage": column}
    if source is not None and not isinstance(source.entries["time"], dict):
        names["time"] = name_at(source, "time")
    interval, begin = (None, 0.0) if source is None else interval_at(source)
    decimal = decimal_at(table) or decimal_at(record)
    return Layout(names, {"time": "s", "voltage": "V"}, units, scales_at(table, "voltage"), interval, begin, decimal)
