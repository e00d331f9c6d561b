"""Keeps the draws of a bootstrap or a posterior in a file, line by line, so that a run that is broken off goes on.

The first line says of what the draws are, each line after it holds one entry as JSON; numbers are written in full, and
null where they are not finite.  Each line ends with a digest: that of the first line is the run's, of study, settings
and fit; that of an entry is of the run and the entry, so that what was damaged, or came from another run, does not
match and is drawn again.
"""

import contextlib
import hashlib
import json
import os
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn, TextIO

from ..core import Document, InputError, InputWarning
from .file_lock import UNFINISHED
from .json_text import finite_numbers

FORMAT = "pdssjax-draws/5"

DRAWS = "draws.jsonl"
"""The file in a folder of results (`results_folder` knows it)."""

_DIGEST = "digest"
"""The last key of each line."""

_LISTED = 5
"""Lines that a message names."""


def holds_draws(folder: Path) -> bool:
    """Whether a run has begun to draw in the `folder` of its results."""
    return (folder / DRAWS).exists()


class DrawsFile:
    """A store of draws (`inference.Store`) on the disk.

    Where the disk takes nothing more the run goes on in memory alone, and an `InputWarning` says so once: the fit and
    the draws still to be made are worth more than the file.

    **Arguments:** the `folder` of the results; `resume` what its file holds, or refuse to where there is none and
    begin anew.

    **Raises:** `InputError` where there is nothing to resume, or the file is none of draws.  Warns with `InputWarning`
    of lines that are left out, since they are damaged or of another run.
    """

    def __init__(self, folder: Path, resume: bool):
        self._file = folder / DRAWS
        self._begun: Document | None = None
        self._entries: list[Document] = []
        self._lines: list[str] = []
        self._run = ""
        self._size = 0
        """Bytes of the file when nobody else has written to it."""
        self._is_writable = True
        if resume:
            self._read()

    def __str__(self) -> str:
        return str(self._file)

    def begun(self) -> Document | None:
        return self._begun

    def begin(self, what: Document) -> None:
        """Write the first line, in place of an older file."""
        self._begun, self._entries = what, []
        head = {"format": FORMAT} | what
        self._run = _digest_of(head, "")
        self._lines = [_line(head, "")]
        self._write_whole()

    def kept(self) -> Sequence[Document]:
        return tuple(self._entries)

    def keep(self, entry: Document) -> None:
        """Append a line, which is on the disk when this returns, if that has room."""
        self._entries.append(entry)
        self._lines.append(_line(finite_numbers(entry), self._run))
        try:
            is_as_it_was = self._file.stat().st_size == self._size
        except OSError:
            is_as_it_was = False
        if is_as_it_was:
            self._append(self._lines[-1])
        else:
            # Somebody has removed or changed it: it is made again, of all that was kept.
            self._write_whole()

    def _append(self, line: str) -> None:
        # A line after one that was cut would spoil the file: after the first that fails nothing more is written.
        if not self._is_writable:
            return
        try:
            with self._file.open("a", encoding="utf-8", newline="\n") as lines:
                _written(lines, line)
            self._size += len(line)  # JSON of ASCII: a byte a character
        except OSError as error:
            self._give_up(error)

    def _write_whole(self) -> None:
        """Write all lines beside the file and rename, so that the file is whole at any moment."""
        if not self._is_writable:
            return
        beside = self._file.with_name(f"{UNFINISHED}{DRAWS}")
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            with beside.open("w", encoding="utf-8", newline="\n") as lines:
                _written(lines, "".join(self._lines))
            beside.replace(self._file)
            self._size = sum(map(len, self._lines))
        except OSError as error:
            with contextlib.suppress(OSError):
                beside.unlink(missing_ok=True)
            self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        self._is_writable = False
        warnings.warn(
            f"{self._file}: cannot be written to ({error.strerror or error}); what is drawn from now on is kept in "
            "memory alone, and lost if the run is broken off.",
            InputWarning,
            stacklevel=5,
        )

    def forget(self) -> None:
        """Remove the file of an earlier run, where there is one."""
        self._file.unlink(missing_ok=True)

    def _read(self) -> None:
        """Read the entries of an earlier run; drop an unfinished last line, and lines whose digest does not match."""
        try:
            text = self._file.read_text(encoding="utf-8", errors="replace")
        except FileNotFoundError:
            raise InputError(f"{self._file}: there is no such file, expected that of a run to go on with.") from None
        except OSError as error:
            raise InputError(f"{self._file}: cannot be read ({error}), expected that of a run to go on with.") from None
        whole = text[: text.rfind("\n") + 1]
        head, *rest = whole.splitlines(keepends=True) or [""]
        self._begun = self._parsed_head(head)
        self._run = _digest_of(self._begun, "")
        self._lines, damaged = [head], []
        for number, line in enumerate(rest, 2):
            entry = _entry_of(line, self._run)
            if entry is None:
                damaged.append(number)
            else:
                self._entries.append(entry)
                self._lines.append(line)
        if damaged:
            listed = ", ".join(map(str, damaged[:_LISTED])) + (", ..." if len(damaged) > _LISTED else "")
            warnings.warn(
                f"{self._file}: found {len(damaged)} lines that are damaged or of another run (line {listed}); what "
                "they held is drawn again.",
                InputWarning,
                stacklevel=4,
            )
        # A file of another system may have other ends of lines; this one is then made of what was read.
        if damaged or self._file.stat().st_size != sum(map(len, self._lines)):
            self._write_whole()
        self._size = sum(map(len, self._lines))

    def _parsed_head(self, line: str) -> Document:
        """**Raises** `InputError` where a `line` is no first line of draws, or not as it was written."""
        expected = "expected a file of draws that this version of pdssjax wrote"
        head: object = None
        with contextlib.suppress(ValueError, RecursionError):
            head = json.loads(line)
        if not isinstance(head, dict) or head.get("format") != FORMAT:
            raise InputError(f'{self._file}: line 1: found no "format": "{FORMAT}", {expected}.')
        if head.pop(_DIGEST, None) != _digest_of(head, ""):
            raise InputError(
                f"{self._file}: line 1: found something else than its digest is of, {expected}; begin anew without "
                "--resume."
            )
        return head


def _written(lines: TextIO, text: str) -> None:
    """Write `text`, which is on the disk when this returns."""
    lines.write(text)
    lines.flush()
    os.fsync(lines.fileno())


def _line(document: Document, run: str) -> str:
    """A line of the file, with its digest."""
    return json.dumps(document | {_DIGEST: _digest_of(document, run)}) + "\n"


def _digest_of(document: Document, run: str) -> str:
    """The digest of a line of a `run`."""
    return hashlib.sha256(f"{run} {json.dumps(document, sort_keys=True)}".encode()).hexdigest()[:32]


def _entry_of(line: str, run: str) -> Document | None:
    """The entry in a `line`; None where a `run` has not written it."""
    try:
        entry: object = json.loads(line, parse_constant=_refused)
    except (ValueError, RecursionError):  # syntax, and integers and nesting beyond what Python reads
        return None
    if not isinstance(entry, dict) or entry.pop(_DIGEST, None) != _digest_of(entry, run):
        return None
    return entry


def _refused(constant: str) -> NoReturn:
    """Refuse NaN and infinities, which no line has."""
    raise ValueError(constant)
