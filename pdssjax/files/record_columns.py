"""Columns of a record from a file of any format as SI numbers, with units, scales, and the clock.

The record's table in a study names the columns, or they are chosen from the channels of the file.
"""

import contextlib
import dataclasses
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..core import InputError, column_unit, factor, split_text, to_si, unit_named
from .channel_samples import Clock, find_channel, open_file, read_samples
from .readers.base import AbstractSource, Channel
from .toml_table import Table


class Layout(NamedTuple):
    """The columns of a file, as a study describes them."""

    columns: Mapping[str, str | int]
    """By quantity, the name or the number of its column; "time" may be left out."""
    si_units: Mapping[str, str]
    """By quantity, its SI unit."""
    units: Mapping[str, str]
    """By quantity, the unit in the file, where its column does not give it."""
    scales: Mapping[str, float | str] = {}
    """By quantity, the factor of its numbers, such as "0.5 um/V"."""
    interval: float | None = None
    """Interval between samples [s], where no clock was stored."""
    begin: float = 0.0
    """Time of the first sample [s], where `interval` is given."""
    decimal: str = ""
    """The decimal sign of a text, "" to detect it."""
    needs_clock: bool = True
    """Whether a clock is required; else a record without one gets a sample a second."""


@dataclasses.dataclass(frozen=True, eq=False)
class Columns:
    """Columns of a file in SI; NaN where the file has no number."""

    reader: AbstractSource
    file: Path
    channels: Mapping[str, Channel]
    """By quantity; without "time" where an interval gives the times."""
    data: dict[str, Float[np.ndarray, " samples"]]
    """By quantity, including "time"."""
    places: Int[np.ndarray, " samples"]
    """Line or number of each sample in the file, from 1."""
    begin: float
    """Time of the first sample of the file [s]."""
    end: float
    """Time of the last sample that was read [s]."""
    has_clock: bool = True
    """Whether file or study gives the times."""

    def select(self, keep: Bool[np.ndarray, " samples"]) -> "Columns":
        """The samples where `keep` is True."""
        data = {quantity: column[keep] for quantity, column in self.data.items()}
        return dataclasses.replace(self, data=data, places=self.places[keep])

    def check_numbers(self) -> None:
        """**Raises** `InputError` that names the first place where there is no finite number."""
        wrong = {q: np.flatnonzero(~np.isfinite(column)) for q, column in self.data.items() if q in self.channels}
        first = {quantity: rows[0] for quantity, rows in wrong.items() if rows.size}
        if not first:
            return
        quantity = min(first, key=lambda key: first[key])
        place, channel = int(self.places[first[quantity]]), self.channels[quantity]
        text = self.reader.written(place, channel.number)
        cut = text if len(text) <= 80 else f"{text[:80]}..."
        found = f'"{cut}"' if text else ("an empty cell" if self.reader.place == "line" else "no number")
        raise InputError(
            f'{self.file}: {self.reader.place} {place}, column "{channel.name}": found {found}, '
            f"expected a finite number{_about_commas(text)}."
        )

    def check_moves(self, quantity: str, values: Float[np.ndarray, " samples"]) -> None:
        """**Raises** `InputError` where the `values` of a `quantity` are all the same."""
        if np.all(values == values[0]):
            raise InputError(
                f'{self.file}: column "{self.channels[quantity].name}": found the same {quantity} in all '
                f"{values.size} samples, expected a record that moves."
            )


def read_columns(file: Path, layout: Layout, window: tuple[float, float] | None = None) -> Columns:
    """The columns of `file` that a `layout` names, in SI, within the `window` [s] where one is given."""
    reader = open_file(file, layout.decimal)
    channels = reader.channels()
    chosen = {q: find_channel(reader, file, channels, given) for q, given in layout.columns.items()}
    factors = {quantity: _factor(file, layout, quantity, channel) for quantity, channel in chosen.items()}
    stored = layout.interval is not None or "time" in chosen or any(c.interval is not None for c in chosen.values())
    has_clock = stored or layout.needs_clock
    clock = _clock(file, layout, chosen, factors) if has_clock else Clock(None, interval=1.0)
    if clock.number is None:
        chosen.pop("time", None)
    others = [quantity for quantity in chosen if quantity != "time"]
    samples = read_samples(reader, file, [chosen[q].number for q in others], clock, window)
    values = {quantity: factors[quantity] * samples.values[:, k] for k, quantity in enumerate(others)}
    data = {"time": samples.time, **values}
    return Columns(reader, file, chosen, data, samples.places, samples.begin, samples.end, has_clock)


def _clock(file: Path, layout: Layout, chosen: Mapping[str, Channel], factors: Mapping[str, float]) -> Clock:
    clocked = [channel for channel in chosen.values() if channel.interval is not None]
    clocks = {(c.start, c.interval) for c in clocked if c.interval is not None}
    if len(clocks) > 1:
        listed = ", ".join(f'"{c.name}" from {c.start:g} s on every {c.interval:g} s' for c in clocked)
        raise InputError(f"{file}: found clocks that differ ({listed}), expected channels of one clock.")
    if layout.interval is not None:
        return Clock(None, start=layout.begin, interval=layout.interval)
    if "time" in chosen:
        return Clock(chosen["time"].number, factors["time"])
    without = [channel.name for channel in chosen.values() if channel.interval is None]
    if not clocks or without:
        found = f'no clock of "{without[0]}", which another channel has' if clocks else "no clock in it"
        raise InputError(
            f'{file}: found {found}, expected the key "time" in columns with the name of a channel, '
            'or the key time of the record, such as time = { interval = "50 us" }.'
        )
    start, interval = clocks.pop()
    return Clock(None, start=start, interval=interval)


def _factor(file: Path, layout: Layout, quantity: str, channel: Channel) -> float:
    """The factor from the numbers of a channel to SI."""
    where, si = f'{file}: column "{channel.name}"', layout.si_units[quantity]
    unit, ending = layout.units.get(quantity) or channel.unit, column_unit(channel.name)
    if quantity in layout.scales:
        # With a scale, a name such as "U_mon" needs no unit.
        return scaled(layout.scales[quantity], unit or unit_named(ending), si, f"{where}: scale")
    if name := unit or ending:
        return factor(name, si, where)
    like = quantity if channel.name == str(channel.number) else channel.name
    raise InputError(
        f'{where}: found no unit, expected a column named like "{like}_{si}" or the key "{quantity}" in [record.units].'
    )


def scaled(scale: float | str, unit: str, si: str, where: str) -> float:
    """The factor to `si` of a `scale` such as "0.5 um/V"; numbers without a `unit` have none or volts."""
    number, per = split_text(scale, where) if isinstance(scale, str) else (float(scale), "")
    if number == 0 or not math.isfinite(number):
        raise InputError(f"{where}: found {number:g}, expected a factor other than 0.")
    for name in [unit] if unit else ["", "V"]:
        parts = " * ".join(f"({part})" for part in (per, name) if part)
        with contextlib.suppress(InputError):
            return number * (factor(parts, si, where) if parts else 1.0)
    numbers = f'numbers in "{unit}"' if unit else "numbers without a unit"
    raise InputError(f'{where}: found "{scale}" for {numbers}, expected a factor to {si}, such as "1 {si}/V".')


def _about_commas(text: str) -> str:
    """A hint for a number with a decimal comma or a separator of thousands."""
    try:
        float(text.replace(",", ".", 1))
    except ValueError:
        return ""
    if "," not in text:
        return '; what divides thousands is read with decimal = "," in the record'
    may_group = re.fullmatch(r"[+-]?[1-9]\d{0,2},\d{3}", text)
    hint = '; a decimal comma is read with decimal = "," in the record'
    return hint + (', one between thousands with decimal = "."' if may_group else "")


_CLOCK = 'the name or the number of a column, or a table such as { interval = "50 us" }'

_COLUMN = "the name of a column, or its number from 1 on"


def name_at(table: Table, key: str, expected: str = _COLUMN) -> str | int:
    """The name or the number of a column."""
    value = table.get(key, object, expected)
    if isinstance(value, int) and not isinstance(value, bool):
        if value < 1:
            raise InputError(f"{table.at(key)}: found {value}, expected {expected}.")
        return value
    return table.text(key, expected)


def decimal_at(table: Table) -> str:
    """The decimal sign of a file of text, "" to detect it."""
    return table.option("decimal", [",", "."]) if "decimal" in table.entries else ""


def record_layout(table: Table, si_units: Mapping[str, str]) -> Layout:
    """The columns of the record that `table` describes; `si_units` by quantity, "time" first, the measured one last."""
    *_, measured = si_units
    has_channel = "channel" in table.entries
    example = f'a table such as {{ time = "time_s", {measured} = "..." }}'
    columns = table.table("columns", example, {}) if has_channel else table.table("columns", example)
    columns.only(si_units)
    names = {quantity: name_at(columns, quantity) for quantity in columns.entries}
    for key, quantity, expected in (("channel", measured, _COLUMN), ("time", "time", _CLOCK)):
        if key in table.entries and quantity in names:
            raise InputError(f"{table.at(key)}: found the column of the {quantity} in columns, too, expected one.")
        if key in table.entries and not isinstance(table.entries[key], dict):
            names[quantity] = name_at(table, key, expected)
    for quantity in list(si_units)[1:]:
        if quantity not in names:
            columns.text(quantity, "the name of a column")
    units = table.table("units", f'a table such as {{ {measured} = "..." }}', {})
    # The file may also have the voltage of a sampled drive.
    units.only([*si_units, "voltage"])
    written = {q: units.text(q, "a unit") for q in units.entries if q in si_units}
    interval, begin = interval_at(table)
    return Layout(names, si_units, written, scales_at(table, measured), interval, begin, decimal_at(table))


_LONGEST_INTERVAL = 1e9
"""Longest interval between samples [s]: thirty years, and short enough for the range of floats."""


def interval_at(table: Table) -> tuple[float | None, float]:
    """The interval and the first time [s] of a clock that was not stored, from the key `time`; None without."""
    given = table.entries.get("time")
    if not isinstance(given, dict):
        return None, 0.0
    clock = table.table("time", _CLOCK)
    clock.only(["interval", "start"])
    interval = clock.number("interval", "s")
    if not 0 < interval <= _LONGEST_INTERVAL:
        raise InputError(
            f"{clock.at('interval')}: found {interval:g} s, expected a time above 0 and up to {_LONGEST_INTERVAL:g} s."
        )
    return interval, clock.number("start", "s", 0.0)


def scales_at(table: Table, quantity: str) -> dict[str, float | str]:
    """The factor of the numbers of a `quantity`, by quantity; empty where the table has none."""
    if "scale" not in table.entries:
        return {}
    value = table.get("scale", object, 'a factor such as "0.5 um/V"')
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise InputError(f'{table.at("scale")}: found {value}, expected a factor such as "0.5 um/V".')
    return {quantity: value if isinstance(value, str) else to_si(value, "", table.at("scale"))}
