"""Keeps the draws of a bootstrap or a posterior in a file, line by line, so that a run that is broken off goes on.

The first line says of what the draws are, each line after it holds one entry as JSON; numbers are written in full.
"""

import json
import os
import warnings
from collections.abc import Sequence
from pathlib import Path

from ..core import Document, InputError, InputWarning

FORMAT = "pdssjax-draws/4"

DRAWS = "draws.jsonl"
"""The file in a folder of results (`results_folder` knows it)."""


def holds_draws(folder: Path) -> bool:
    """Whether a run has begun to draw in the `folder` of its results."""
    return (folder / DRAWS).exists()


class DrawsFile:
    """A store of draws (`inference.Store`) on the disk.

    Where the disk takes nothing more the run goes on in memory alone, and an `InputWarning` says so once: the fit and
    the draws still to be made are worth more than the file.

    **Arguments:** the `folder` of the results; `resume` what its file holds, or refuse to where there is none and
    begin anew.

    **Raises:** `InputError` where there is nothing to resume, or the file is none of draws.
    """

    def __init__(self, folder: Path, resume: bool):
        self._file = folder / DRAWS
        self._begun: Document | None = None
        self._entries: list[Document] = []
        self._is_writable = True
        if resume:
            self._read()

    def __str__(self) -> str:
        return str(self._file)

    def begun(self) -> Document | None:
        return self._begun

    def begin(self, what: Document) -> None:
        """Writes the first line, in place of an older file."""
        self._begun, self._entries = what, []
        self._write("w", {"format": FORMAT} | what)

    def kept(self) -> Sequence[Document]:
        return tuple(self._entries)

    def keep(self, entry: Document) -> None:
        """Appends a line, which is on the disk when this returns, if that has room."""
        self._entries.append(entry)
        self._write("a", entry)

    def _write(self, mode: str, line: Document) -> None:
        # A line after one that was cut would spoil the file: after the first that fails nothing more is written.
        if not self._is_writable:
            return
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            with self._file.open(mode, encoding="utf-8") as lines:
                lines.write(json.dumps(line) + "\n")
                lines.flush()
                os.fsync(lines.fileno())
        except OSError as error:
            self._is_writable = False
            warnings.warn(
                f"{self._file}: cannot be written to ({error.strerror or error}); what is drawn from now on is kept in "
                "memory alone, and lost if the run is broken off.",
                InputWarning,
                stacklevel=3,
            )

    def forget(self) -> None:
        """Removes the file of an earlier run, where there is one."""
        self._file.unlink(missing_ok=True)

    def _read(self) -> None:
        """What an earlier run has kept; a last line that was broken off is taken away."""
        try:
            text = self._file.read_text(encoding="utf-8")
        except FileNotFoundError:
            raise InputError(f"{self._file}: there is no such file, expected that of a run to go on with.") from None
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"{self._file}: cannot be read ({error}), expected that of a run to go on with.") from None
        whole = text[: text.rfind("\n") + 1]
        entries = [self._parsed(number, line) for number, line in enumerate(whole.splitlines(), 1)]
        if not entries or entries[0].get("format") != FORMAT:
            expected = "expected a file of draws that this version of pdssjax wrote"
            raise InputError(f'{self._file}: line 1: found no "format": "{FORMAT}", {expected}.')
        if whole != text:
            os.truncate(self._file, len(whole.encode("utf-8")))
        self._begun, self._entries = entries[0], entries[1:]

    def _parsed(self, number: int, line: str) -> Document:
        try:
            entry: object = json.loads(line)
        except (ValueError, RecursionError) as error:  # beside syntax: integers and nesting beyond what Python reads
            said = error.msg if isinstance(error, json.JSONDecodeError) else error
            raise InputError(f"{self._file}: line {number}: found no valid JSON: {said}.") from None
        if not isinstance(entry, dict):
            raise InputError(f"{self._file}: line {number}: found no JSON object, expected one a line.")
        return entry
