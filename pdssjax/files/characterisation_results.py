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
        for stem, one in zip(stems, found, strict=True):
            cycle_figure(one).savefig(staging / "plots" / f"{stem}.png")
        _write_cycles(dict(zip(stems, found, strict=True)), staging / "cycles.csv")
        document = {"format": CHARACTERISATION_FORMAT, "records": [_record_document(one) for one in found]}
        (staging / "characterise.json").write_text(json_text(document), encoding="utf-8")


def _write_cycles(found: dict[str, Characterisation], file: Path) -> None:
    """A row a cycle, in display units; cells stay empty where a record has no such figure."""
    units = {name: summary.unit for one in found.values() for name, summary in one.summary.items()}
    names = list(dict.fromkeys(name for one in found.values() for name in one.metrics))
    shown = {name: display_unit(units[name]) for name in names}
    titles = [f"{name}_{unit}" if unit else name for name, (unit, _) in shown.items()]
    with file.open("w", newline="", encoding="utf-8") as stream:
        table = csv.writer(stream, lineterminator="\n")
        table.writerow(["record", "cycle", "start_s", *titles])
        for stem, one in found.items():
            for index in range(one.cycles.count):
                start = one.cycles.start + index / one.cycles.frequency
                cells = [one.metrics[n][index] * shown[n][1] if n in one.metrics else None for n in names]
                written = ["" if cell is None else f"{cell:.6g}" for cell in cells]
                table.writerow([stem, index + 1, f"{start:.9g}", *written])


def _record_document(one: Characterisation) -> dict[str, Any]:
    """One record of `characterise.json`, in SI."""
    cycles = one.cycles
    return {
        "file": str(one.file),
        "measures": one.measures,
        "column": one.column,
        "samples": len(one.time),
        "from": float(one.time[0]),
        "to": float(one.time[-1]),
        "direction": "backward" if cycles.falls else "forward",
        "frequency": {"used": cycles.frequency, "given": one.given, "seen": cycles.seen, "error": cycles.seen_error},
        "cycles": {"complete": cycles.count, "left_out": cycles.rejected, "start": cycles.start},
        "sawtooth_fit": cycles.fit,
        "slip_duration": one.slip_duration,
        "figures": {name: vars(summary) for name, summary in one.summary.items()},
    }
