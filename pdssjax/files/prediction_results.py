"""Writes predictions: a CSV file and a plot for each record."""

import dataclasses
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np
from jaxtyping import Float

from ..core import Display
from ..metrics import Characterisation
from ..study import FittedRecord, UsedNumber
from .json_text import json_text
from .results_folder import staging_folder

PARAMETERS_FORMAT = "pdssjax-parameters/1"

_TAKEN = ("amplification", "correlations", "draws", "multistart", "profiles", "standard_errors")
"""Names of the files in `plots` besides a plot of each record."""

COMPARED = "measured", "predicted", "residual"
"""Columns after the time, each with the unit behind it."""

_LONGEST = 60
"""Letters of a file's name: four bytes each at most, of the 255 that a name may have."""

Numbers: TypeAlias = Mapping[str, UsedNumber]
"""Numbers of parameters by path, as `pdssjax.study.numbers_used` returns them."""


def write_predictions(records: Sequence[FittedRecord], used: Numbers, folder: Path) -> None:
    """Put the plot and the prediction of each record into `folder`, in place of older results.

    With them `parameters.json`, the numbers `used`.
    """
    # Whatever a study has them for, none of these was fitted.
    predicted = [dataclasses.replace(record, role="validate") for record in records]
    with staging_folder(folder) as staging:
        write_numbers(used, staging)
        write_records(predicted, staging)


def write_numbers(used: Numbers, staging: Path) -> None:
    text = json_text({"format": PARAMETERS_FORMAT, "parameters": used})
    (staging / "parameters.json").write_text(text, encoding="utf-8", errors="backslashreplace")


def write_records(records: Sequence[FittedRecord], staging: Path) -> None:
    from ..report.figures import has_loops, loop_figure, record_figure, save_figure

    (staging / "predictions").mkdir()
    (staging / "plots").mkdir()
    for stem, record in zip(file_stems(records), records, strict=True):
        unit, scale = record.display.unit, record.display.scale
        table = np.column_stack([record.measured, record.predicted, record.measured - record.predicted])
        applied = applied_columns(record)
        np.savetxt(
            staging / "predictions" / f"{stem}.csv",
            np.column_stack([record.time, scale * table, *applied.values()]),
            fmt=("%.15g", *["%.9g"] * (3 + len(applied))),
            delimiter=",",
            header=",".join(["time_s", *(f"{name}_{unit}" for name in COMPARED), *applied]),
            comments="",
        )
        save_figure(record_figure(record), staging / "plots" / f"{stem}.png")
        if record.simulated and has_loops(record):
            (staging / "plots" / "loops").mkdir(exist_ok=True)
            save_figure(loop_figure(record), staging / "plots" / "loops" / f"{stem}.png")


def applied_columns(record: FittedRecord) -> dict[str, Float[np.ndarray, " n"]]:
    """What was applied to the rig in the unit of the column, by the column's name, as far as the record has it."""
    columns = {}
    if record.motion is not None:
        columns[prescribed_column(record.prescribed)] = record.prescribed.scale * record.motion
    if record.voltage is not None:
        columns[VOLTAGE] = record.voltage
    return columns


VOLTAGE = "voltage_V"
"""Column of the command, where the platform alone was measured."""


def prescribed_column(display: Display) -> str:
    """Name of the column of a motion or velocity that was prescribed."""
    return f"{display.quantity}_{display.unit}"


def file_stems(records: Sequence[FittedRecord] | Sequence[Characterisation]) -> list[str]:
    """File names after the records' own, different from each other on any file system."""
    stems: list[str] = []
    for record in records:
        plain = re.sub(r"[^\w.-]+", "_", record.name)[:_LONGEST].strip("._") or "record"
        taken = [stem.lower() for stem in [*stems, *_TAKEN]]
        copies = (f"{plain}-{number}" for number in range(2, len(taken) + 2))
        stems.append(next(stem for stem in (plain, *copies) if stem.lower() not in taken))
    return stems
