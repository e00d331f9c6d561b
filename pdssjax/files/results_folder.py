"""Writes results to a folder: all of them or none, and over older ones only on request; reads and writes texts."""

import contextlib
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TypeAlias

from ..core import InputError
from .file_lock import UNFINISHED, folder_lock, is_leftover, remove

_RESULTS = """
comparison.txt comparison.png residuals.png comparison.html report.txt report.html records predictions cycles.csv plots
posterior.nc bootstrap.csv sweep.nc sweep.zarr sweep.png directions.png border.nc border.zarr border.png
characterise.json parameters.json plan.txt plan.png plan.html plan.toml plan-together.toml drives templates plan.json
comparison.json estimate.json
""".split()
"""Names that a folder of results may hold, the main one of a command last."""

DRAWS, CANDIDATES = "draws.jsonl", "candidates"
"""Files beside the results that are not replaced with them: an interrupted run goes on from these."""


def check_empty(folder: Path) -> None:
    """**Raises** `InputError` where `folder` holds more than leftovers of a killed command, or is not writable."""
    if folder.exists() and (not folder.is_dir() or not all(is_leftover(path.name) for path in folder.iterdir())):
        raise InputError(f"{folder}: found something there already, expected an empty folder or nothing.")
    _check_writable(folder)


def check_free(folder: Path, overwrite: bool) -> None:
    """Check before any work that results can be written to `folder`.

    **Raises:** `InputError` if it holds results and `overwrite` is false, or cannot be written to.
    """
    present = [name for name in (*_RESULTS, DRAWS, CANDIDATES) if (folder / name).exists()]
    if present and not overwrite:
        resume = ", or --resume to go on with them" if {DRAWS, CANDIDATES} & set(present) else ""
        raise InputError(
            f"{folder}: found results already ({', '.join(present)}); expected another folder, or --overwrite{resume}."
        )
    _check_writable(folder)


def _check_writable(folder: Path) -> None:
    """**Raises** `InputError` where nothing can be written to `folder`, or it cannot be made."""
    existing = nearest_existing(folder)
    if not existing.is_dir():
        raise InputError(f"{folder}: found a file at {existing}, expected a folder or nothing.")
    if not os.access(existing, os.W_OK | os.X_OK):
        raise InputError(f"{folder}: found no permission to write to {existing}, expected a folder to write to.")


def nearest_existing(path: Path) -> Path:
    """The path itself, or the nearest folder above it that exists."""
    return next(place for place in (path, *path.absolute().parents) if place.exists())


def write_aside(write: Callable[[Path], None]) -> Path:
    """A new temporary folder with the files of `write`.

    **Raises:** `OSError` as `write` does; then nothing is left behind.
    """
    folder = Path(tempfile.mkdtemp(prefix="pdssjax-"))
    try:
        write(folder)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    return folder


_Contents: TypeAlias = dict[str, tuple[int, int]]
"""Inode and time of the last change of each file or folder of the results, by name."""

_reserved: dict[Path, _Contents] = {}
"""Last known contents of the folders that commands of this process have reserved."""


@contextlib.contextmanager
def reserved_folder(folder: Path, overwrite: bool) -> Iterator[None]:
    """Reserve `folder` for the results of this process.

    **Raises:** `InputError` as `check_free` does, and where another process has reserved it.
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

    **Arguments:** `names` of the possible contents, which replace those in `folder`.  The last name that is written
    replaces its predecessor in one step, after the other old results are removed and before the other new ones come: a
    killed process leaves this main file whole, old or new, and beside it no results of another run.

    **Raises:** `InputError` where another process has the folder, `FileExistsError` where its results changed since it
    was reserved.
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
                    remove(folder / name)
            for name in written:
                (staging / name).replace(folder / name)
        finally:
            if place in _reserved:
                _reserved[place] = _contents(place)


def _contents(folder: Path) -> _Contents:
    contents: _Contents = {}
    for name in _RESULTS:
        with contextlib.suppress(OSError):
            status = (folder / name).stat()
            contents[name] = status.st_ino, status.st_mtime_ns
    return contents


def read_text(file: Path, expected: str) -> str:
    """The text of a `file` in UTF-8; **raises** `InputError` where it cannot be read as what is `expected`."""
    try:
        return file.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputError(f"{file}: there is no such file, expected {expected}.") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{file}: found {error.reason} at byte {error.start}, expected UTF-8 text.") from None
    except (OSError, ValueError) as error:  # ValueError: of a name that no file can have
        raise InputError(
            f"{file}: cannot be read ({getattr(error, 'strerror', error)}), expected {expected}."
        ) from None


def write_text(file: Path, text: str) -> None:
    """Write a `text` into a `file`; characters without an encoding, such as half a pair of surrogates, as escapes."""
    file.write_text(text, encoding="utf-8", errors="backslashreplace")


def write_whole(file: Path, content: bytes) -> None:
    """Write a `file` beside its place, flush it to the disk and rename it, so that it is whole at any moment."""
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
