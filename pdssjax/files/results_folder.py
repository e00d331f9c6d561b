"""Writes results to a folder: all of them or none, and never over others unasked."""

import contextlib
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TypeAlias

from ..core import InputError
from .file_lock import UNFINISHED, folder_lock, is_leftover

_RESULTS = """
comparison.txt comparison.png residuals.png comparison.html report.txt report.html records predictions cycles.csv plots
posterior.nc bootstrap.csv sweep.nc sweep.zarr sweep.png directions.png border.nc border.zarr border.png
characterise.json parameters.json plan.txt plan.png plan.html plan.toml plan-together.toml drives templates plan.json
comparison.json estimate.json
""".split()
"""Names that a folder of results may hold, the one that tells most last."""


DRAWS, CANDIDATES = "draws.jsonl", "candidates"
"""Lie beside them and are not replaced with them: a run that is broken off goes on with them."""


def check_empty(folder: Path) -> None:
    """**Raises** `InputError` where `folder` holds anything, is a file or cannot be written to.

    What a command that was killed has left unfinished there is nothing.
    """
    if folder.exists() and (not folder.is_dir() or not all(is_leftover(path.name) for path in folder.iterdir())):
        raise InputError(f"{folder}: found something there already, expected an empty folder or nothing.")
    _check_writable(folder)


def check_free(folder: Path, overwrite: bool) -> None:
    """See, before any work is spent, that results can go to `folder`.

    **Raises:** `InputError` if it holds results and `overwrite` is false, or cannot be written to.
    """
    held = [name for name in (*_RESULTS, DRAWS, CANDIDATES) if (folder / name).exists()]
    if held and not overwrite:
        goes_on = ", or --resume to go on with them" if {DRAWS, CANDIDATES} & set(held) else ""
        raise InputError(
            f"{folder}: found results already ({', '.join(held)}); expected another folder, or --overwrite{goes_on}."
        )
    _check_writable(folder)


def _check_writable(folder: Path) -> None:
    """**Raises** `InputError` where nothing can be written to `folder`, or it cannot be made."""
    ground = nearest_existing(folder)
    if not ground.is_dir():
        raise InputError(f"{folder}: found a file at {ground}, expected a folder or nothing.")
    if not os.access(ground, os.W_OK | os.X_OK):
        raise InputError(f"{folder}: found no permission to write to {ground}, expected a folder to write to.")


def nearest_existing(path: Path) -> Path:
    """The path itself, or the nearest folder above it that exists."""
    return next(place for place in (path, *path.absolute().parents) if place.exists())


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


_Contents: TypeAlias = dict[str, tuple[int, int]]
"""Number and time of the last change of each file or folder of the results, by name."""

_reserved: dict[Path, _Contents] = {}
"""Contents of the folders that commands of this process have reserved, as far as they know."""


@contextlib.contextmanager
def reserved_folder(folder: Path, overwrite: bool) -> Iterator[None]:
    """Reserve `folder` for the results of this process: no other process writes there.

    **Raises:** `InputError` as `check_free` does, and where another process has it.
    """
    check_free(folder, overwrite)
    with folder_lock(folder):
        # Another process may have put results there before the lock was taken.
        check_free(folder, overwrite)
        place = folder.resolve()
        _reserved[place] = _contents(place)
        try:
            yield
        finally:
            del _reserved[place]


@contextlib.contextmanager
def staging_folder(folder: Path, names: Sequence[str] = _RESULTS) -> Iterator[Path]:
    """A hidden folder inside `folder`, whose contents move up once all of them are written.

    **Arguments:** `names` are what may be in it; what `folder` holds of them is replaced.  The last that is written
    takes the place of the old one in one stroke, after the others of the old results are gone and before those of the
    new ones come: whoever is killed meanwhile leaves it whole, old or new, and nothing beside it that is not its own.

    **Raises:** `InputError` where another process has the folder, `FileExistsError` where other results have come into
    it since this one has reserved it.
    """
    with folder_lock(folder), tempfile.TemporaryDirectory(prefix=UNFINISHED, dir=folder) as temporary:
        staging, place = Path(temporary), folder.resolve()
        yield staging
        if place in _reserved and _reserved[place] != _contents(place):
            raise FileExistsError("other results have come into it meanwhile")
        try:
            written = [name for name in reversed(names) if (staging / name).exists()]
            for name in reversed(names):
                if name not in written[:1] or (folder / name).is_dir():
                    _remove(folder / name)
            for name in written:
                (staging / name).replace(folder / name)
        finally:
            if place in _reserved:
                _reserved[place] = _contents(place)


def _contents(folder: Path) -> _Contents:
    found: _Contents = {}
    for name in _RESULTS:
        with contextlib.suppress(OSError):
            status = (folder / name).stat()
            found[name] = status.st_ino, status.st_mtime_ns
    return found


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def write_text(file: Path, text: str) -> None:
    """Write a `text` into a `file`; what no encoding has, such as half of a pair of surrogates, as an escape."""
    file.write_text(text, encoding="utf-8", errors="backslashreplace")


def write_whole(file: Path, content: bytes) -> None:
    """Write a `file` beside its place and rename it, so that it is whole at any moment, and then on the disk."""
    beside = file.with_name(f"{UNFINISHED}{file.name}")
    try:
        with beside.open("wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        beside.replace(file)
    finally:
        with contextlib.suppress(OSError):
            beside.unlink(missing_ok=True)


EXAMPLE = Path(__file__).parents[1] / "example"
"""Folder of the packaged study."""


def copy_example(folder: Path) -> None:
    """Copy the packaged example into `folder`, all of it or nothing.

    **Raises:** `InputError` where the folder holds something already, or cannot be written to.
    """
    check_empty(folder)
    with staging_folder(folder, sorted(path.name for path in EXAMPLE.iterdir())) as staging:
        for path in EXAMPLE.iterdir():
            shutil.copyfile(path, staging / path.name)
