"""The columns of a record's file by its table: names or numbers, clock, units, scale, decimal sign."""

from collections.abc import Mapping

from ..core import Document, InputError, to_si
from .record_columns import Layout
from .toml_table import Table

_CLOCK = 'the name or the number of a column, or a table such as { interval = "50 us" }'

_NAME = "the name of a column, or its number from 1 on"


def name_at(table: Table, key: str, expected: str = _NAME) -> str | int:
    """The name or the number of a column."""
    value = table.get(key, object, expected)
    if isinstance(value, int) and not isinstance(value, bool):
        if value < 1:
            raise InputError(f"{table.at(key)}: found {value}, expected {expected}.")
        return value
    return table.text(key, expected)


def decimal_at(table: Table) -> str:
    """The decimal sign of a file of text, "" where the file is to tell it."""
    return table.option("decimal", [",", "."]) if "decimal" in table.entries else ""


def record_layout(table: Table, si_units: Mapping[str, str]) -> Layout:
    """The columns of the record that `table` describes; `si_units` by quantity, "time" first, what is explained last.

    **Raises:** `InputError` if a column is missing or named twice, or a key is illegal.
    """
    *_, explained = si_units
    names = _names(table, si_units)
    units = table.table("units", f'a table such as {{ {explained} = "..." }}', {})
    # The voltage of a sampled drive may stand in the same file.
    units.only([*si_units, "voltage"])
    written = {q: units.text(q, "a unit") for q in units.entries if q in si_units}
    interval, begin = interval_at(table)
    return Layout(names, si_units, written, scales_at(table, explained), interval, begin, decimal_at(table))


_LONGEST = 1e9
"""Between samples [s]: thirty years, and so little that no clock leaves the range of floats."""


def interval_at(table: Table) -> tuple[float | None, float]:
    """The interval of a clock that was not stored, and its first time [s], as the key `time` gives them."""
    given = table.entries.get("time")
    if not isinstance(given, dict):
        return None, 0.0
    clock = table.table("time", _CLOCK)
    clock.only(["interval", "start"])
    interval = clock.number("interval", "s")
    if not 0 < interval <= _LONGEST:
        raise InputError(
            f"{clock.at('interval')}: found {interval:g} s, expected a time above 0 and up to {_LONGEST:g} s."
        )
    return interval, clock.number("start", "s", 0.0)


def _names(table: Table, si_units: Mapping[str, str]) -> dict[str, str | int]:
    """By quantity, what its column is called."""
    *_, explained = si_units
    empty: Document = {}
    alone = "channel" in table.entries
    example = f'a table such as {{ time = "time_s", {explained} = "..." }}'
    columns = table.table("columns", example, empty) if alone else table.table("columns", example)
    columns.only(si_units)
    names = {quantity: name_at(columns, quantity) for quantity in columns.entries}
    given = [("channel", explained)] * alone + [("time", "time")] * ("time" in table.entries)
    for key, quantity in given:
        if quantity in names:
            raise InputError(f"{table.at(key)}: found the column of the {quantity} in columns, too, expected one.")
        if not isinstance(table.entries[key], dict):
            names[quantity] = name_at(table, key, _CLOCK if key == "time" else _NAME)
    for quantity in list(si_units)[1:]:
        if quantity not in names:
            columns.text(quantity, "the name of a column")
    return names


def scales_at(table: Table, quantity: str) -> dict[str, float | str]:
    """The factors on the numbers of a `quantity`; empty where the table does not say it."""
    if "scale" not in table.entries:
        return {}
    value = table.get("scale", object, 'a factor such as "0.5 um/V"')
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise InputError(f'{table.at("scale")}: found {value}, expected a factor such as "0.5 um/V".')
    return {quantity: value if isinstance(value, str) else to_si(value, "", table.at("scale"))}
