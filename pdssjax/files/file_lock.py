"""Locks by which one program at a time works on a folder of results, or on a store.

A lock is one of the operating system on a small file: it ends with the process that holds it, however that ends.  The
file is removed with the lock; one that a killed process has left is free.
"""

import contextlib
import dataclasses
import os
import shutil
import sys
import threading
import warnings
from collections.abc import Iterator
from pathlib import Path

from ..core import InputError, InputWarning

LOCK = ".pdssjax.lock"
"""The file in a folder of results whose lock is that of the folder."""

UNFINISHED = ".unfinished-"
"""How the names begin of what is written beside its place and then renamed."""

_TRIES = 100
"""How often a lock file that was removed while it was opened is made anew."""

_BEYOND = 1 << 20
"""Where in its file the byte lies that Windows locks: beyond the text, which others read."""


@dataclasses.dataclass
class _Held:
    """A lock that this process holds."""

    descriptor: int | None
    """Descriptor of the open file; None where the disk knows no locks."""
    holders: int = 0
    """How often it was taken and not yet given back."""


_held: dict[Path, _Held] = {}
"""The locks of this process, by file."""

_guard = threading.RLock()


def is_leftover(name: str) -> bool:
    """Whether a file or folder of this `name` is a lock or unfinished, and nothing that a user put there."""
    return name == LOCK or name.startswith(UNFINISHED)


@contextlib.contextmanager
def folder_lock(folder: Path) -> Iterator[None]:
    """Keep other processes out of the `folder`, which is made if it is missing.

    What a killed process has left unfinished in it is removed.  A folder that was made for the lock and is empty at
    the end is removed, too.

    **Raises:** `InputError` where another process has it.
    """
    with file_lock(folder / LOCK, folder, UNFINISHED):
        yield


@contextlib.contextmanager
def file_lock(file: Path, about: Path, unfinished: str) -> Iterator[None]:
    """Hold the lock of `file` against other processes; this process may take it several times.

    **Arguments:** `about` is what the lock is of, for messages; names that begin with `unfinished` are removed beside
    the file, since nobody else works there.

    **Raises:** `InputError` where another process has it.  Warns with `InputWarning` where the disk knows no locks.
    """
    place = file.absolute().parent.resolve() / file.name
    made = [folder for folder in place.parents if not folder.exists()]
    with _guard:
        if place not in _held:
            _held[place] = _Held(_locked(place, about))
            if _held[place].descriptor is not None:
                _remove_unfinished(place.parent, unfinished)
        held = _held[place]
        held.holders += 1
    try:
        place.parent.mkdir(parents=True, exist_ok=True)  # which somebody may have removed since the lock was taken
        yield
    finally:
        with _guard, contextlib.suppress(OSError):
            held.holders -= 1
            if not held.holders:
                del _held[place]
                _unlock(place, held.descriptor)
            for folder in made:
                folder.rmdir()


def _locked(place: Path, about: Path) -> int | None:
    """The descriptor of the lock file, locked; None where the disk knows no locks, of which a warning tells.

    **Raises:** `InputError` where another process has it.
    """
    try:
        for _ in range(_TRIES):
            place.parent.mkdir(parents=True, exist_ok=True)
            with contextlib.suppress(FileNotFoundError):  # whoever had the folder has just removed it
                descriptor = os.open(place, os.O_RDWR | os.O_CREAT, 0o666)
                _lock(descriptor, about)
                if _is_file_of(descriptor, place):
                    os.ftruncate(descriptor, 0)
                    os.write(descriptor, f"{os.getpid()}\n".encode())
                    return descriptor
                os.close(descriptor)
        raise InputError(_busy(about, ""))
    except OSError as error:
        told = (
            f"{about}: cannot be locked ({error.strerror or error}); see that no other program writes to it meanwhile."
        )
        warnings.warn(told, InputWarning, stacklevel=5)
        return None


def _busy(about: Path, holder: str) -> str:
    who = f" (process {holder})" if holder else ""
    return f"{about}: found another pdssjax at work in it{who}, expected another folder, or that it has ended."


def _lock(descriptor: int, about: Path) -> None:
    """Lock an open file without waiting for it, or close it.

    **Raises:** `InputError` where another process has the lock, `OSError` where the disk knows none.
    """
    try:
        _take_lock(descriptor)
    except (BlockingIOError, PermissionError):  # as POSIX and as Windows say it
        holder = os.read(descriptor, 80).decode(errors="replace").strip()
        os.close(descriptor)
        raise InputError(_busy(about, holder)) from None
    except OSError:
        os.close(descriptor)
        raise


def _take_lock(descriptor: int) -> None:
    if sys.platform == "win32":
        import msvcrt

        os.lseek(descriptor, _BEYOND, os.SEEK_SET)
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        finally:
            os.lseek(descriptor, 0, os.SEEK_SET)
    else:
        import fcntl

        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _unlock(place: Path, descriptor: int | None) -> None:
    """Give a lock back, and remove its file."""
    if descriptor is None:
        return
    is_ours = _is_file_of(descriptor, place)
    if sys.platform == "win32":  # which removes no open file
        os.close(descriptor)
    # Removed while it is locked: who has opened it meanwhile sees that it is gone, and makes a new one.
    if is_ours:
        place.unlink(missing_ok=True)
    if sys.platform != "win32":
        os.close(descriptor)


def _is_file_of(descriptor: int, place: Path) -> bool:
    """Whether the open file is the one that stands at its `place`."""
    try:
        here, there = os.fstat(descriptor), os.stat(place)
    except OSError:
        return False
    return (here.st_dev, here.st_ino) == (there.st_dev, there.st_ino)


def _remove_unfinished(folder: Path, unfinished: str) -> None:
    for path in folder.iterdir():
        if path.name.startswith(unfinished):
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink(missing_ok=True)
