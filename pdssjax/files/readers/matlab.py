"""MATLAB's .mat files of versions 4 to 7.2, by SciPy: arrays of numbers, and those within structs.

Channels are called "name", "struct.field", and "name[2]" where an array has several columns; complex numbers are two,
"name.real" and "name.imag".  A struct with the fields Name and Data (dSPACE ControlDesk) is called by its Name, with
its Unit, and by the end of its Path where several have that Name.  Files of version 7.3 are HDF5, and read as such.
A file is read as a whole, by a process of its own (`_matlab_process.py`), whose end by a broken file is not that of
this one.
"""

import functools
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ...core import InputError
from ._errors import refusing, same_length
from .base import BLOCK, AbstractReader, Block, Channel

_EXPECTED = "a MATLAB file"

_PROCESS = Path(__file__).with_name("_matlab_process.py")

_MEMORY = 2 << 30
"""Bytes that reading may take, and as many more for each byte of the file as `_PER_BYTE`."""

_PER_BYTE = 20

_SECONDS = 60
"""For reading, and one more for each so many bytes of the file."""

_BYTES_PER_SECOND = 5_000_000

_Arrays = list[tuple[str, str, Float[np.ndarray, " samples"]]]
"""Name, unit and samples of every channel."""


class Matlab(AbstractReader):
    """A .mat file before version 7.3."""

    ending = ".mat"

    def __init__(self, file: Path, decimal: str = "") -> None:
        self.file = file

    @classmethod
    def recognises(cls, file: Path, head: bytes) -> bool:
        return head.startswith(b"MATLAB 5.0") or (
            file.suffix.lower() == ".mat" and head[512:516] != b"\x89HDF" and not head.startswith(b"\x89HDF")
        )

    def channels(self) -> list[Channel]:
        return [
            Channel(name, number, unit, values.size)
            for number, (name, unit, values) in enumerate(self._arrays, start=1)
        ]

    def blocks(self, numbers: Sequence[int], first: int = 0) -> Iterator[Block]:
        chosen = [self._arrays[number - 1] for number in numbers]
        count = same_length(self.file, {name: values.size for name, _, values in chosen})
        for begin in range(first, count, BLOCK):
            end = min(begin + BLOCK, count)
            yield Block(np.column_stack([v[begin:end] for *_, v in chosen]), np.arange(begin + 1, end + 1))

    @functools.cached_property
    def _arrays(self) -> _Arrays:
        """What is in the file; samples lie in a temporary file that ends with this reader."""
        with refusing(self.file, _EXPECTED):
            found, names = _read(self.file)
        if not found:
            raise InputError(
                f"{self.file}: found no channel among {names[:6]}, expected arrays of numbers "
                "(MATLAB's tables and timeseries: save them as plain arrays or structs)."
            )
        return found


def _read(file: Path) -> tuple[_Arrays, list[str]]:
    """The arrays in `file` and the names of its variables; **raises** `ValueError` that says why it cannot be read."""
    size = file.stat().st_size
    most, seconds = _MEMORY + _PER_BYTE * size, _SECONDS + size // _BYTES_PER_SECOND
    command = [sys.executable, "-P", str(_PROCESS), str(file), str(most), str(seconds)]
    with tempfile.TemporaryFile() as made:
        try:
            # One thread: each that a library of linear algebra begins takes address space, which is limited.
            status = subprocess.run(
                command,
                stdin=subprocess.DEVNULL,
                stdout=made,
                stderr=subprocess.DEVNULL,
                timeout=2 * seconds,
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"},
            ).returncode
        except subprocess.TimeoutExpired:
            status = -1
        made.seek(0)
        length = int.from_bytes(made.read(8), "little")
        if status != 0 or not length:
            raise ValueError("SciPy crashed, or did not come to an end, on what is in it")
        said = json.loads(made.read(length))
        if "broken" in said:
            raise ValueError(said["broken"])
        counts = [count for *_, count in said["channels"]]
        # The mapping keeps what is in the temporary file after it is closed.
        samples = np.memmap(made, "<f8", "r", 8 + length, (sum(counts),)) if any(counts) else np.zeros(0)
    begins = np.cumsum([0, *counts])
    parts = [samples[begin : begin + count] for begin, count in zip(begins, counts, strict=False)]
    told = zip(said["channels"], parts, strict=True)
    return [(name, unit, values) for (name, unit, _), values in told], said["names"]
