"""Writes the records of a virtual rig, the study that describes them, and what went in."""

import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..core import Document, InputError, column_unit, factor
from ..study import FittedRecord, Record, Recording
from .json_text import json_text
from .prediction_results import Numbers, write_numbers, write_records
from .results_folder import staging_folder


def check_recordings(records: Sequence[Record], study: Path) -> None:
    """**Raises** `InputError` where the files of `records` cannot be made as the file `study` describes them."""
    for record in records:
        _place(record, study)
        column_scales(record, study)


def _place(record: Record, study: Path) -> Path:
    """Where its file lies beside the study."""
    if not record.file.is_relative_to(study.parent) or ".." in record.file.relative_to(study.parent).parts:
        raise InputError(f'{study}: record "{record.name}": found {record.file}, expected a file beside it.')
    return record.file.relative_to(study.parent)


def write_recordings(
    made: Sequence[Recording],
    compared: Sequence[FittedRecord],
    truth: Document,
    used: Numbers,
    study: Path,
    folder: Path,
) -> None:
    """Put the CSV files of a virtual rig, the study that describes them, and what went in into `folder`.

    With them `parameters.json`, the numbers `used`.

    **Raises:** `InputError` as `check_recordings` does.
    """
    with staging_folder(folder) as staging:
        write_numbers(used, staging)
        write_records(compared, staging)
        for recording in made:
            write_csv(recording, study, staging / "records" / _place(recording.record, study))
        shutil.copyfile(study, staging / "records" / study.name)
        (staging / "records" / "truth.json").write_text(json_text(truth), encoding="utf-8", errors="backslashreplace")


def column_scales(record: Record, study: Path) -> dict[str, float]:
    """By quantity, what one of the unit of its column is in SI.

    **Raises:** `InputError`, which names the file `study`, where the name of a column does not tell its unit.
    """
    si_units, where = record.measurement.columns, f'{study}: record "{record.name}"'
    return {
        quantity: factor(unit or column_unit(name), si_units[quantity], f'{where}: column "{name}"')
        for quantity, (name, unit) in record.columns.items()
    }


def write_csv(recording: Recording, study: Path, file: Path) -> None:
    """The record as the file `study` describes its file: columns by their names and units.

    **Raises:** `InputError` as `column_scales` does.
    """
    record = recording.record
    scales = column_scales(record, study)
    measurement = record.measurement
    data = {"time": record.time + record.start, measurement.quantity: record.measured}
    if measurement.prescribed is not None:
        data[measurement.prescribed] = record.motion
    names, columns, formats = [], [], []
    for quantity, (name, _) in record.columns.items():
        columns.append(np.asarray(data[quantity]) / scales[quantity])
        names.append(name)
        # A clock that began long ago needs all digits to tell its samples apart.
        formats.append("%.15g" if quantity == "time" else "%.9g")
    file.parent.mkdir(parents=True, exist_ok=True)
    header = ",".join(names)
    np.savetxt(file, np.column_stack(columns), fmt=formats, delimiter=",", header=header, comments="", encoding="utf-8")
