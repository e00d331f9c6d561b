"""Locks that let one program at a time use a folder of results or a store.

A lock is one of the operating system on a small file: it always ends with its process.  The file is removed with the
lock; a file left by a killed process is free.
"""

import contextlib
import dataclasses
import errno
import os
import shutil
import sys
import threading
import warnings
from collections.abc import Iterator
from pathlib import Path

from ..core import InputError, InputWarning

LOCK = ".pdssjax.lock"
"""The file for the lock of a folder of results."""

UNFINISHED = ".unfinished-"
"""Beginning of the names of files and folders that are written beside their place and then renamed."""

_BUSY = {errno.EAGAIN, errno.EWOULDBLOCK, errno.EACCES, errno.EDEADLK, getattr(errno, "EDEADLOCK", errno.EDEADLK)}
"""Numbers of errors of a lock that another process holds."""


@dataclasses.dataclass
class _Held:
    """A lock that this process holds."""

    descriptor: int | None
    """Descriptor of the open file; None where the disk has no locks."""
    made: list[Path]
    """Folders that were made for the lock, the innermost first."""
    holders: int = 1
    """Number of holders in this process."""


_held: dict[Path, _Held] = {}
"""The locks of this process, by file."""

_guard = threading.RLock()


def is_leftover(name: str) -> bool:
    """Whether a file or folder of this `name` is a lock or an unfinished one, and not the user's."""
    return name == LOCK or name.startswith(UNFINISHED)


def folder_lock(folder: Path) -> contextlib.AbstractContextManager[None]:
    """Keep other processes out of the `folder`, which is made if missing.

    Unfinished files of killed processes in it are removed, and at the end an empty folder that was made for the lock.
    """
    return file_lock(folder / LOCK, folder, UNFINISHED)


@contextlib.contextmanager
def file_lock(file: Path, about: Path, unfinished: str) -> Iterator[None]:
    """Hold the lock of `file` against other processes; this process may take it several times.

    **Arguments:** `about` is the path in messages; files beside `file` whose names begin with `unfinished` are removed,
    since no other process works there.

    **Raises:** `InputError` where another process has the lock.  Warns with `InputWarning` where the disk has no locks.
    """
    place = file.absolute().parent.resolve() / file.name
    _take(place, about, unfinished)
    try:
        yield
    finally:
        _release(place)


def _take(place: Path, about: Path, unfinished: str) -> None:
    with _guard:
        held = _held.get(place)
        if held is not None and (held.descriptor is None or _is_file_of(held.descriptor, place)):
            held.holders += 1
            return
        _held[place] = _acquire(place, about, unfinished)
        if held is not None:  # its file has been removed
            _held[place].holders += held.holders
            _close(held.descriptor)


def _release(place: Path) -> None:
    with _guard:
        held = _held[place]
        held.holders -= 1
        if held.holders:
            return
        del _held[place]
        if held.descriptor is not None:
            is_ours = _is_file_of(held.descriptor, place)
            if sys.platform == "win32":
                _close(held.descriptor)
            # Removed while locked: a process that has opened it meanwhile sees that it is gone, and makes a new one.
            with contextlib.suppress(OSError):
                if is_ours:
                    place.unlink()
            if sys.platform != "win32":
                _close(held.descriptor)
        with contextlib.suppress(OSError):
            for folder in held.made:
                folder.rmdir()


def _acquire(place: Path, about: Path, unfinished: str) -> _Held:
    """Take the lock of the operating system."""
    made = [folder for folder in place.parents if not folder.exists()]
    try:
        for _ in range(100):  # other processes may remove the file just after it was opened
            place.parent.mkdir(parents=True, exist_ok=True)
            with contextlib.suppress(FileNotFoundError):  # another process has just removed the folder
                descriptor = _open_file(place)
                try:
                    _lock(descriptor)
                except OSError as error:
                    holder = os.read(descriptor, 80).decode(errors="replace").strip()
                    os.close(descriptor)
                    if error.errno not in _BUSY:
                        raise
                    raise InputError(_busy(about, holder)) from None
                if _is_file_of(descriptor, place):
                    with contextlib.suppress(OSError):  # the process id is only for messages of other processes
                        os.ftruncate(descriptor, 0)
                        os.write(descriptor, f"{os.getpid()}\n".encode())
                    for path in place.parent.iterdir():
                        if path.name.startswith(unfinished):
                            with contextlib.suppress(OSError):
                                remove(path)
                    return _Held(descriptor, made)
                os.close(descriptor)
        raise InputError(_busy(about, ""))
    except OSError as error:
        reason = error.strerror or error
        message = f"{about}: cannot be locked ({reason}); make sure that no other program writes to it meanwhile."
        warnings.warn(message, InputWarning, stacklevel=5)
        return _Held(None, made)


def _busy(about: Path, holder: str) -> str:
    who = f" (process {holder})" if holder else ""
    return f"{about}: found another pdssjax at work in it{who}, expected another folder, or the end of that process."


def _open_file(place: Path) -> int:
    try:
        return os.open(place, os.O_RDWR | os.O_CREAT, 0o666)
    except PermissionError:
        if not place.exists():
            raise
        # The file of another user; a lock needs no right to write.
        return os.open(place, os.O_RDONLY)


def _lock(descriptor: int) -> None:
    """**Raises** `OSError` where another process has the lock, without waiting for it."""
    if sys.platform == "win32":
        import msvcrt

        os.lseek(descriptor, 1 << 20, os.SEEK_SET)  # a byte beyond the text, which stays readable
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        finally:
            os.lseek(descriptor, 0, os.SEEK_SET)
    else:
        import fcntl

        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _is_file_of(descriptor: int, place: Path) -> bool:
    """Whether the open file is still the one at its `place`."""
    try:
        opened, present = os.fstat(descriptor), os.stat(place)
    except OSError:
        return False
    return (opened.st_dev, opened.st_ino) == (present.st_dev, present.st_ino)


def remove(path: Path) -> None:
    """Remove a file, a link or a folder, if it exists."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _close(descriptor: int | None) -> None:
    if descriptor is not None:
        with contextlib.suppress(OSError):
            os.close(descriptor)
