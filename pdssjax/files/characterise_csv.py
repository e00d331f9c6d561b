"""Characterises the record in a CSV file: which columns to read, and the checks of what was read."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..core import InputError, column_unit, factor
from ..metrics import SI_UNITS, Characterisation, characterisation_of
from .csv_columns import column_names, read_csv

_SIGNS = {"displacement": ("displacement", "position"), "force": ("force",)}
"""What the name of a column contains that is to be preferred to others of the same dimension."""


def characterise(
    file: Path,
    *,
    time: str | None = None,
    displacement: str | None = None,
    force: str | None = None,
    units: Mapping[str, str] | None = None,
    frequency: float | None = None,
    window: tuple[float, float] | None = None,
    slip_duration: float = 0.0,
) -> Characterisation:
    """Walking or pushing of the actuator that the CSV `file` records.

    **Arguments:** `time`, `displacement` and `force` name columns; left out, they are told by
    their names and units.  `units` gives the units of "time", "displacement" or "force" where the
    name of the column does not end in one.  `frequency` [Hz] of the drive; left out, it is found.
    `window` [s] keeps part of the record.  `slip_duration` [s] as for `per_cycle.cycle_metrics`.

    **Raises:** `InputError` if the file or an option is at fault or no cycle is found.  Warns with
    `InputWarning` where the cycles are doubtful.
    """
    measures, columns = _choose(file, {"time": time, "displacement": displacement, "force": force}, units or {})
    times, values = _read(file, measures, columns, units or {}, window)
    return characterisation_of(
        times, values, measures, file=file, column=columns[measures], frequency=frequency, slip_duration=slip_duration
    )


def _choose(file: Path, named: Mapping[str, str | None], units: Mapping[str, str]) -> tuple[str, dict[str, str]]:
    """What is measured, and the columns to read."""
    if named["displacement"] and named["force"]:
        raise InputError(f"{file}: found both a displacement and a force to read, expected one of them.")
    names = column_names(file)
    time = named["time"] or _only(file, [n for n in names if n.lower().startswith(("time", "t_"))], "time", names)
    for measures in SI_UNITS:
        if name := named[measures]:
            return measures, {"time": time, measures: name}
    for measures, unit in SI_UNITS.items():
        fitting = [name for name in names if name != time and _measures(name, unit)]
        preferred = [name for name in fitting if any(sign in name.lower() for sign in _SIGNS[measures])]
        if fitting:
            column = fitting[0] if len(fitting) == 1 else _only(file, preferred or fitting, measures, names)
            return measures, {"time": time, measures: column}
    return "displacement", {"time": time, "displacement": _only(file, [], "displacement", names)}


def _only(file: Path, fitting: list[str], quantity: str, names: list[str]) -> str:
    if len(fitting) == 1:
        return fitting[0]
    found = f"{len(fitting)} columns that may be the {quantity}" if fitting else f"no column that tells the {quantity}"
    listed = ", ".join(f'"{name}"' for name in fitting or names)
    raise InputError(f"{file}: found {found} ({listed}), expected the option --{quantity} with a column's name.")


def _measures(name: str, unit: str) -> bool:
    """Whether a column's name ends in a unit that converts to `unit`."""
    try:
        return bool(column_unit(name)) and factor(column_unit(name), unit, "") > 0
    except InputError:
        return False


def _read(file: Path, measures: str, columns: dict[str, str], units: Mapping[str, str], window: Any):
    """Checked times [s] and values [m or N]."""
    si = {"time": "s", measures: SI_UNITS[measures]}
    for quantity, column in columns.items():
        if quantity not in units and not column_unit(column) and column in column_names(file):
            raise InputError(
                f'{file}: column "{column}": found no unit, expected a name like "{column}_{si[quantity]}" '
                f'or the option --unit "{quantity}={si[quantity]}".'
            )
    data, lines = read_csv(file, columns, si, units)
    time, values = data["time"], data[measures]
    late = np.flatnonzero(np.diff(time) <= 0)
    if late.size:
        here = late[0] + 1
        raise InputError(
            f'{file}: line {lines[here]}, column "{columns["time"]}": found {time[here]:.9g} s after '
            f"{time[here - 1]:.9g} s, expected times that increase."
        )
    if window is not None:
        keep = (time >= window[0]) & (time <= window[1])
        if not keep.any():
            raise InputError(
                f"{file}: found no sample in the window {window[0]:g} s to {window[1]:g} s, "
                f"expected some of the record's {time[0]:g} s to {time[-1]:g} s."
            )
        time, values = time[keep], values[keep]
    if np.all(values == values[0]):
        raise InputError(
            f'{file}: column "{columns[measures]}": found the same {measures} in all {len(time)} samples, '
            "expected a record that moves."
        )
    return time, values
