"""Writes records: each predicted one as CSV file and plot, and those of a virtual rig in the format of their study."""

import dataclasses
import re
import shutil
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np
from jaxtyping import Float

from ..core import Display, Document, InputError, column_unit, factor
from ..study import FittedRecord, Record, Recording, UsedNumber
from .json_text import json_text
from .results_folder import staging_folder, write_text

COMPARED = "measured", "predicted", "residual"
"""Columns after the time, each with the unit behind it."""

Numbers: TypeAlias = Mapping[str, UsedNumber]
"""Numbers of parameters by path, as `pdssjax.study.numbers_used` returns them."""


def write_predictions(records: Sequence[FittedRecord], numbers: Numbers, folder: Path) -> None:
    """Put plots, predictions, and `numbers` as `parameters.json` into `folder`, in place of older results."""
    # None of these was fitted, whatever its role in the study.
    predicted = [dataclasses.replace(record, role="validate") for record in records]
    with staging_folder(folder) as staging:
        write_numbers(numbers, staging)
        write_records(predicted, staging)


def write_numbers(numbers: Numbers, staging: Path) -> None:
    write_text(staging / "parameters.json", json_text({"format": "pdssjax-parameters/1", "parameters": numbers}))


def write_records(records: Sequence[FittedRecord], staging: Path) -> None:
    from ..report.figures import has_loops, loop_figure, record_figure, save_figure

    (staging / "predictions").mkdir()
    (staging / "plots").mkdir()
    for stem, record in zip(file_stems(record.name for record in records), records, strict=True):
        unit, scale = record.display.unit, record.display.scale
        compared = zip(COMPARED, (record.measured, record.predicted, record.measured - record.predicted), strict=True)
        columns = {"time_s": record.time, **{f"{name}_{unit}": scale * values for name, values in compared}}
        # The input of the rig, as far as the record has it.
        if record.motion is not None:
            columns[prescribed_column(record.prescribed)] = record.prescribed.scale * record.motion
        if record.voltage is not None:
            columns[VOLTAGE] = record.voltage
        write_columns(staging / "predictions" / f"{stem}.csv", columns, ["%.15g", *["%.9g"] * (len(columns) - 1)])
        save_figure(record_figure(record), staging / "plots" / f"{stem}.png")
        if record.simulated and has_loops(record):
            (staging / "plots" / "loops").mkdir(exist_ok=True)
            save_figure(loop_figure(record), staging / "plots" / "loops" / f"{stem}.png")


def write_columns(file: Path, columns: Mapping[str, Float[np.ndarray, " rows"]], formats: str | Sequence[str]) -> None:
    """Write `columns` of numbers, by their names, as a CSV file."""
    table = np.column_stack(list(columns.values()))
    np.savetxt(file, table, formats, ",", header=",".join(columns), comments="", encoding="utf-8")


VOLTAGE = "voltage_V"
"""Column of the voltage, where the platform alone was measured."""


def prescribed_column(display: Display) -> str:
    """Name of the column of a motion or velocity that was prescribed."""
    return f"{display.quantity}_{display.unit}"


def file_stems(names: Iterable[str]) -> list[str]:
    """File names for the `names` of records, distinct on any file system."""
    stems: list[str] = []
    plots = ("amplification", "correlations", "draws", "multistart", "profiles", "standard_errors")
    for name in names:
        # A letter has at most four bytes, and a file name at most 255.
        plain = re.sub(r"[^\w.-]+", "_", name)[:60].strip("._") or "record"
        used = [stem.lower() for stem in [*stems, *plots]]
        copies = (f"{plain}-{number}" for number in range(2, len(used) + 2))
        stems.append(next(stem for stem in (plain, *copies) if stem.lower() not in used))
    return stems


def check_recordings(records: Sequence[Record], study: Path) -> None:
    """**Raises** `InputError` where the files of `records` cannot be written as the file `study` describes them."""
    for record in records:
        _relative_path(record, study)
        column_scales(record, study)


def _relative_path(record: Record, study: Path) -> Path:
    """The path of a record's file, relative to the folder of the study."""
    if not record.file.is_relative_to(study.parent) or ".." in record.file.relative_to(study.parent).parts:
        raise InputError(f'{study}: record "{record.name}": found {record.file}, expected a file beside it.')
    return record.file.relative_to(study.parent)


def write_recordings(
    recordings: Sequence[Recording],
    compared: Sequence[FittedRecord],
    truth: Document,
    numbers: Numbers,
    study: Path,
    folder: Path,
) -> None:
    """Put the CSV files of a virtual rig, their study, the `truth` and the `numbers` of the simulation into `folder`.

    **Raises:** `InputError` as `check_recordings` does.
    """
    with staging_folder(folder) as staging:
        write_numbers(numbers, staging)
        write_records(compared, staging)
        for recording in recordings:
            write_csv(recording, study, staging / "records" / _relative_path(recording.record, study))
        shutil.copyfile(study, staging / "records" / study.name)
        write_text(staging / "records" / "truth.json", json_text(truth))


def column_scales(record: Record, study: Path) -> dict[str, float]:
    """The factor from the unit of each quantity's column to SI."""
    si_units, where = record.measurement.columns, f'{study}: record "{record.name}"'
    return {
        quantity: factor(unit or column_unit(name), si_units[quantity], f'{where}: column "{name}"')
        for quantity, (name, unit) in record.columns.items()
    }


def write_csv(recording: Recording, study: Path, file: Path) -> None:
    """Write a record with the names and units of columns in the file `study`."""
    record, measurement = recording.record, recording.record.measurement
    scales = column_scales(record, study)
    data = {"time": record.time + record.start, measurement.quantity: record.measured}
    if measurement.prescribed is not None:
        data[measurement.prescribed] = record.motion
    columns = {name: np.asarray(data[quantity]) / scales[quantity] for quantity, (name, _) in record.columns.items()}
    file.parent.mkdir(parents=True, exist_ok=True)
    # Times of a clock that began long ago differ in the last digits only.
    write_columns(file, columns, ["%.15g" if quantity == "time" else "%.9g" for quantity in record.columns])
