"""Writes results to a folder: all of them or none, and never over others unasked."""

import contextlib
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from ..core import InputError

_RESULTS = (
    "comparison.txt",
    "comparison.png",
    "report.txt",
    "records",
    "predictions",
    "cycles.csv",
    "plots",
    "posterior.nc",
    "bootstrap.csv",
    "sweep.nc",
    "sweep.zarr",
    "sweep.png",
    "directions.png",
    "border.nc",
    "border.zarr",
    "border.png",
    "characterise.json",
    "parameters.json",
    "estimate.json",
)
"""What a folder of results may hold; the JSON file is moved in last, so where it is, all is."""


_DRAWS = "draws.jsonl"
"""Lies beside them and is not replaced with them: a run that is broken off goes on with it."""


def check_empty(folder: Path) -> None:
    """**Raises** `InputError` where `folder` holds anything, is a file or cannot be written to."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder}: found something there already, expected an empty folder or nothing.")
    _check_writable(folder)


def check_free(folder: Path, overwrite: bool) -> None:
    """See, before any work is spent, that results can go to `folder`.

    **Raises:** `InputError` if it holds results and `overwrite` is false, or cannot be written to.
    """
    held = [name for name in (*_RESULTS, _DRAWS) if (folder / name).exists()]
    if held and not overwrite:
        raise InputError(
            f"{folder}: found results already ({', '.join(held)}); expected another folder, or --overwrite."
        )
    _check_writable(folder)


def _check_writable(folder: Path) -> None:
    """**Raises** `InputError` where nothing can be written to `folder`, or it cannot be made."""
    ground = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    if not ground.is_dir():
        raise InputError(f"{folder}: found a file at {ground}, expected a folder or nothing.")
    if not os.access(ground, os.W_OK | os.X_OK):
        raise InputError(f"{folder}: found no permission to write to {ground}, expected a folder to write to.")


def write_aside(write: Callable[[Path], None]) -> Path:
    """A new folder for temporary files, in which `write` has put what it writes.

    **Raises:** `OSError` where that fails, too; then nothing is left behind.
    """
    folder = Path(tempfile.mkdtemp(prefix="pdssjax-"))
    try:
        write(folder)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    return folder


@contextlib.contextmanager
def staging_folder(folder: Path) -> Iterator[Path]:
    """A hidden folder inside `folder`, whose contents move up once all of them are written."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".unfinished-", dir=folder) as temporary:
        staging = Path(temporary)
        yield staging
        for name in reversed(_RESULTS):
            _remove(folder / name)
        for name in _RESULTS:
            if (staging / name).exists():
                (staging / name).rename(folder / name)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
