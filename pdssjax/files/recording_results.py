"""Writes the records of a virtual rig, the study that describes them, and what went in."""

import shutil
from collections.abc import Sequence
from pathlib import Path

from ..core import Document, InputError
from ..study import FittedRecord, Recording
from .json_text import json_text
from .prediction_results import Numbers, write_numbers, write_records
from .results_folder import staging_folder
from .signal_csv import write_csv


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

    **Raises:** `InputError` where the study's records are to lie outside its folder.
    """
    files = [recording.record.file for recording in made]
    places = [file.relative_to(study.parent) if _beside(file, study) else None for file in files]
    for place, recording in zip(places, made, strict=True):
        if place is None:
            raise InputError(
                f'{study}: record "{recording.record.name}": found {recording.record.file}, expected a file beside it.'
            )
    with staging_folder(folder) as staging:
        write_numbers(used, staging)
        write_records(compared, staging)
        for place, recording in zip(places, made, strict=True):
            write_csv(recording, staging / "records" / str(place))
        shutil.copyfile(study, staging / "records" / study.name)
        (staging / "records" / "truth.json").write_text(json_text(truth), encoding="utf-8")


def _beside(file: Path, study: Path) -> bool:
    return file.is_relative_to(study.parent) and ".." not in file.relative_to(study.parent).parts
