"""Writes what records say by themselves: figures, cycles and plots."""

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..core import display_unit
from ..metrics import Characterisation
from .json_text import json_text
from .prediction_results import file_stems
from .results_folder import staging_folder

CHARACTERISATION_FORMAT = "pdssjax-characterisation/1"


def write_characterisations(found: Sequence[Characterisation], folder: Path) -> None:
    """Put `characterise.json`, `cycles.csv` and a plot of each record into `folder`, in place of older results."""
    from ..report.figures import cycle_figure

    stems = file_stems(found)
    with staging_folder(folder) as staging:
        (staging / "plots").mkdir()
        for stem, record in zip(stems, found, strict=True):
            cycle_figure(record).savefig(staging / "plots" / f"{stem}.png")
        _write_cycles(dict(zip(stems, found, strict=True)), staging / "cycles.csv")
        document = {"format": CHARACTERISATION_FORMAT, "records": [_record_document(record) for record in found]}
        (staging / "characterise.json").write_text(json_text(document), encoding="utf-8", errors="backslashreplace")


def _write_cycles(found: dict[str, Characterisation], file: Path) -> None:
    """A row a cycle, in display units; cells stay empty where a record has no such figure."""
    units = {name: summary.unit for record in found.values() for name, summary in record.summary.items()}
    names = list(dict.fromkeys(name for record in found.values() for name in record.metrics))
    shown = {name: display_unit(units[name]) for name in names}
    titles = [f"{name}_{unit}" if unit else name for name, (unit, _) in shown.items()]
    with file.open("w", newline="", encoding="utf-8", errors="backslashreplace") as stream:
        table = csv.writer(stream, lineterminator="\n")
        table.writerow(["record", "cycle", "start_s", *titles])
        for stem, record in found.items():
            for index in range(record.cycles.count):
                start = record.cycles.start + index / record.cycles.frequency
                cells = [record.metrics[n][index] * shown[n][1] if n in record.metrics else None for n in names]
                written = ["" if cell is None else f"{cell:.6g}" for cell in cells]
                table.writerow([stem, index + 1, f"{start:.15g}", *written])


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
        "frequency": {"used": cycles.frequency, "given": record.given, "seen": cycles.seen, "error": cycles.seen_error},
        "cycles": {"complete": cycles.count, "left_out": cycles.rejected, "start": cycles.start},
        "sawtooth_fit": cycles.fit,
        "slip_duration": record.slip_duration,
        "figures": {name: vars(summary) for name, summary in record.summary.items()},
    }
