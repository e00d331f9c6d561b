"""Writes the records of a virtual rig, the study that describes them, and what went in."""

import shutil
from collections.abc import Sequence
from pathlib import Path

from ..core import Document, InputError
from ..study import FittedRecord, Record, Recording
from .json_text import json_text
from .prediction_results import Numbers, write_numbers, write_records
from .results_folder import staging_folder
from .signal_csv import column_scales, write_csv


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
