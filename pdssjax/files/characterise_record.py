"""Characterises the record in a file: chooses and checks its columns, writes figures, cycles and plots."""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..core import InputError, display_unit
from ..metrics import SI_UNITS, Characterisation, characterisation_of
from .channel_samples import list_channels, name_or_number, open_file
from .json_text import json_text
from .readers.base import Channel
from .record_columns import Layout, read_columns
from .record_results import file_stems
from .results_folder import staging_folder, write_text


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
    decimal: str = "",
) -> Characterisation:
    """Characterise the walking or pushing of the actuator in `file`, of any known format.

    **Arguments:**

    - `time`, `displacement`, `force`: names of columns; if left out, they are chosen by name and unit.
    - `units`: of "time", "displacement" or "force" where the name of the column does not end in one.
    - `frequency`: of the drive [Hz]; if left out, it is found.
    - `window`: the part of the record to keep [s].
    - `slip_duration`: [s] as for `per_cycle.cycle_metrics`.
    - `decimal`: the decimal sign of a text, "" to detect it.

    **Raises:** `InputError` if the file or an option is at fault or no cycle is found.  Warns with
    `InputWarning` where the cycles are doubtful.
    """
    measures, columns = _choose(file, {"time": time, "displacement": displacement, "force": force}, decimal)
    si = {"time": "s", measures: SI_UNITS[measures]}
    try:
        read = read_columns(file, Layout(columns, si, units or {}, decimal=decimal), window)
    except InputError as error:
        # Without a study, an option gives the unit.
        text = str(error)
        for quantity, unit in si.items():
            text = text.replace(f'the key "{quantity}" in [record.units]', f'the option --unit "{quantity}={unit}"')
        raise InputError(text) from None
    read.check_numbers()
    times, values = read.data["time"], read.data[measures]
    if not times.size:
        low, high = window or (0.0, 0.0)
        raise InputError(
            f"{file}: found no sample in the window {low:g} s to {high:g} s, "
            f"expected some of the record's {read.begin:g} s to {read.end:g} s."
        )
    read.check_moves(measures, values)
    column = read.channels[measures].name
    return characterisation_of(
        times, values, measures, file=file, column=column, frequency=frequency, slip_duration=slip_duration
    )


def _choose(file: Path, named: Mapping[str, str | None], decimal: str) -> tuple[str, dict[str, str | int]]:
    """The measured quantity and the columns to read, without "time" where the file has a clock."""
    if named["displacement"] and named["force"]:
        raise InputError(f"{file}: found both a displacement and a force to read, expected one of them.")
    channels = open_file(file, decimal).channels()
    clock = _clock(file, named["time"], channels, decimal)
    for measures in SI_UNITS:
        if name := named[measures]:
            return measures, {**clock, measures: name_or_number(name)}
    others = [channel for channel in channels if channel.number not in clock.values()]
    for measures, unit in SI_UNITS.items():
        fitting = [channel for channel in others if channel.measures(unit)]
        words = {"displacement": ("displacement", "position"), "force": ("force",)}[measures]
        preferred = [channel for channel in fitting if any(word in channel.name.lower() for word in words)]
        if fitting:
            return measures, {**clock, measures: _choose_one(file, preferred or fitting, measures, channels).number}
    return "displacement", {**clock, "displacement": _choose_one(file, [], "displacement", channels).number}


def _clock(file: Path, named: str | None, channels: Sequence[Channel], decimal: str) -> dict[str, str | int]:
    """The column of the times; empty where the file has a clock."""
    if named:
        return {"time": name_or_number(named)}
    if any(channel.interval is not None for channel in channels):
        return {}
    # Other names of the column of the times in files of instruments.
    names = ("t", "s", "in s", "second", "seconds", "x-axis", "zeit", "source")
    fitting = [c for c in channels if c.name.rpartition("/")[2].lower().startswith(("time", "t_"))]
    fitting = fitting or [c for c in channels if (c.measures("s") or not c.unit) and c.name.lower() in names]
    fitting = fitting or [c for c in channels if c.measures("s")]
    if not fitting:
        found = {summary.number for summary in list_channels(file, decimal)[1] if summary.step and not summary.uneven}
        fitting = [channel for channel in channels if channel.number in found and not channel.unit]
    return {"time": _choose_one(file, fitting, "time", channels).number}


def _choose_one(file: Path, fitting: Sequence[Channel], quantity: str, channels: Sequence[Channel]) -> Channel:
    if len(fitting) == 1:
        return fitting[0]
    found = f"{len(fitting)} columns that may be the {quantity}" if fitting else f"no column with the {quantity}"
    listed = ", ".join(f'"{channel.name}"' for channel in fitting or channels)
    raise InputError(
        f"{file}: found {found} ({listed}), expected the option --{quantity} with a column's name or number."
    )


def write_characterisations(found: Sequence[Characterisation], folder: Path) -> None:
    """Put `characterise.json`, `cycles.csv` and a plot of each record into `folder`, in place of older results."""
    from ..report.figures import cycle_figure, save_figure

    records = dict(zip(file_stems(record.name for record in found), found, strict=True))
    with staging_folder(folder) as staging:
        (staging / "plots").mkdir()
        for stem, record in records.items():
            save_figure(cycle_figure(record), staging / "plots" / f"{stem}.png")
        _write_cycles(records, staging / "cycles.csv")
        document = {"format": "pdssjax-characterisation/1", "records": [_record_document(record) for record in found]}
        write_text(staging / "characterise.json", json_text(document))


def _write_cycles(records: dict[str, Characterisation], file: Path) -> None:
    """Write a row for each cycle, in display units; cells stay empty where a record has no such figure."""
    units = {name: summary.unit for record in records.values() for name, summary in record.summary.items()}
    names = list(dict.fromkeys(name for record in records.values() for name in record.metrics))
    display = {name: display_unit(units[name]) for name in names}
    titles = [f"{name}_{unit}" if unit else name for name, (unit, _) in display.items()]
    with file.open("w", newline="", encoding="utf-8", errors="backslashreplace") as stream:
        table = csv.writer(stream, lineterminator="\n")
        table.writerow(["record", "cycle", "start_s", *titles])
        for stem, record in records.items():
            for index in range(record.cycles.count):
                start = record.cycles.start + index / record.cycles.frequency
                metrics = record.metrics
                cells = [f"{metrics[n][index] * display[n][1]:.6g}" if n in metrics else "" for n in names]
                table.writerow([stem, index + 1, f"{start:.15g}", *cells])


def _record_document(record: Characterisation) -> dict[str, Any]:
    """One record of `characterise.json`, in SI."""
    cycles = record.cycles
    return {
        "file": str(record.file),
        "measures": record.measures,
        "column": record.column,
        "samples": len(record.time),
        "from": float(record.time[0]),
        "to": float(record.time[-1]),
        "direction": "backward" if cycles.falls else "forward",
        "frequency": {
            "used": cycles.frequency,
            "given": record.given,
            "seen": cycles.slip_frequency,
            "error": cycles.slip_frequency_error,
        },
        "cycles": {"complete": cycles.count, "left_out": cycles.rejected, "start": cycles.start},
        "sawtooth_fit": cycles.fit,
        "slip_duration": record.slip_duration,
        "figures": {name: vars(summary) for name, summary in record.summary.items()},
    }
