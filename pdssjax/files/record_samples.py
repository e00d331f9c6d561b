"""The samples that a record keeps of its file: within its window, outside what it excludes, thinned if it says so."""

from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from ..core import InputError, to_si
from ..metrics import decimated, fresh_samples
from ..study import check_increasing
from .record_columns import Columns, Layout
from .toml_table import Table


def window_of(table: Table) -> tuple[float, float] | None:
    """From when to when the record's `table` takes its samples, on the clock of the file [s]; None for all.

    **Raises:** `InputError` if the key is at fault.
    """
    return _interval(table.entries["window"], table.at("window")) if "window" in table.entries else None


def kept_samples(table: Table, file: Path, layout: Layout, read: Columns) -> dict[str, Float[np.ndarray, " samples"]]:
    """Of what was `read` the samples kept, by quantity [SI], checked.

    **Raises:** `InputError` if the file or a key of the record's `table` is at fault, or nothing is left.
    """
    keep, whole = _kept(table, read)
    keep &= _fresh(table, read.data[list(layout.si_units)[-1]])
    columns = read.kept(keep)
    columns.check_numbers()
    clock = columns.channels["time"].name if "time" in columns.channels else "time"
    check_increasing(file, clock, columns.data["time"], columns.places, columns.reader.place)
    data = _decimated(table, columns, whole[keep])
    for quantity in list(layout.si_units)[1:]:
        if np.all(data[quantity] == data[quantity][0]):
            raise InputError(
                f'{file}: column "{columns.channels[quantity].name}": found the same {quantity} in all '
                f"{data[quantity].size} samples, expected a record that moves."
            )
    return data


def _fresh(table: Table, measured: Float[np.ndarray, " samples"]) -> Bool[np.ndarray, " samples"]:
    """The samples at which a sensor shows a new value, where the record says with `held` at every how many it does."""
    if "held" not in table.entries:
        return np.ones(measured.size, bool)
    every = table.get("held", int, "a whole number such as 2")
    if isinstance(table.entries["held"], bool) or not 2 <= every <= measured.size // 2:
        raise InputError(
            f"{table.at('held')}: found {table.entries['held']} of {measured.size} samples, "
            "expected a whole number from 2 on, and at most half as many as there are samples."
        )
    return fresh_samples(measured, every)


def _decimated(table: Table, columns: Columns, stretch: np.ndarray) -> dict[str, np.ndarray]:
    """The columns, low-passed and thinned where the record says `decimate`; not across what was left out."""
    if "decimate" not in table.entries:
        return columns.data
    by = table.get("decimate", int, "a whole number such as 10")
    time = columns.data["time"]
    if isinstance(table.entries["decimate"], bool) or not 2 <= by <= time.size:
        raise InputError(
            f"{table.at('decimate')}: found {table.entries['decimate']} of {time.size} samples, "
            "expected a whole number from 2 on, and fewer than there are samples."
        )
    steps = np.diff(time)[np.diff(stretch) == 0]
    if steps.size == 0 or np.ptp(steps) > 0.02 * np.median(steps):
        raise InputError(
            f"{table.at('decimate')}: found samples {np.min(steps, initial=np.inf):g} s to "
            f"{np.max(steps, initial=0.0):g} s apart, expected even ones."
        )
    parts = [np.column_stack(list(columns.data.values()))[stretch == number] for number in np.unique(stretch)]
    thinned = [decimated(part, by) for part in parts]
    together = np.concatenate(thinned)
    if len(together) < 2:
        raise InputError(
            f"{table.at('decimate')}: found {time.size} samples, expected more than the {32 * by} of the filter."
        )
    return dict(zip(columns.data, together.T, strict=True))


def _kept(table: Table, read: Columns) -> tuple[np.ndarray, np.ndarray]:
    """Which samples `exclude`, on the clock of the file, leaves, and how many of its pairs lie before each."""
    time = read.data["time"]
    # A sample whose time is no number lies where the one before it does.
    known = np.maximum.accumulate(np.where(np.isfinite(time), np.arange(time.size), 0))
    time = time[known]
    keep, before = np.ones(time.shape, bool), np.zeros(time.shape, int)
    excluded = table.get("exclude", list, "a list of pairs of times", [])
    for index, pair in enumerate(excluded, start=1):
        start, end = _interval(pair, f"{table.at('exclude')}: pair {index}")
        keep &= (time < start) | (time > end)
        before += time > end
    if not keep.any():
        raise InputError(
            f'{table.where}: found no sample left by "window" and "exclude", '
            f"expected some of the record's {read.begin:g} s to {read.end:g} s."
        )
    return keep, before


def _interval(given: object, where: str) -> tuple[float, float]:
    if not isinstance(given, list) or len(given) != 2:
        raise InputError(f'{where}: found {given}, expected a pair of times such as ["3 s", "5 s"].')
    start, end = (to_si(time, "s", where) for time in given)
    if start >= end:
        raise InputError(f"{where}: found {start:g} s to {end:g} s, expected an end after its start.")
    return start, end
