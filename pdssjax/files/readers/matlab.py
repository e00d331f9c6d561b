"""MATLAB's .mat files of versions 4 to 7.2, by SciPy: arrays of numbers, and those within structs.

Channels are called "name", "struct.field", and "name[2]" where an array has several columns.  A struct with the
fields Name and Data (dSPACE ControlDesk) is called by its Name, with its Unit.  Files of version 7.3 are HDF5, and
read as such.  A variable is read as a whole.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...core import InputError
from ._errors import library, refusing, same_length
from .base import BLOCK, AbstractReader, Block, Channel

_EXPECTED = "a MATLAB file"


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
            for number, (name, unit, values) in enumerate(self._arrays(), start=1)
        ]

    def blocks(self, numbers: Sequence[int], first: int = 0) -> Iterator[Block]:
        arrays = self._arrays()
        chosen = [arrays[number - 1] for number in numbers]
        count = same_length(self.file, {name: values.size for name, _, values in chosen})
        for begin in range(first, count, BLOCK):
            end = min(begin + BLOCK, count)
            yield Block(np.column_stack([v[begin:end] for *_, v in chosen]), np.arange(begin + 1, end + 1))

    def _arrays(self) -> list[tuple[str, str, np.ndarray]]:
        """Name, unit and samples of every channel."""
        scipy = library("scipy.io", "matlab", self.file)
        with refusing(self.file, _EXPECTED):
            held = scipy.loadmat(self.file, simplify_cells=True)
        found = [array for key, value in held.items() if not key.startswith("__") for array in _flat(key, value, "")]
        if not found:
            names = [key for key in held if not key.startswith("__")]
            raise InputError(
                f"{self.file}: found no channel among {names[:6]}, expected arrays of numbers "
                "(MATLAB's tables and timeseries: save them as plain arrays or structs)."
            )
        return found


def _flat(name: str, value: Any, unit: str) -> list[tuple[str, str, np.ndarray]]:
    """The channels within a variable."""
    if isinstance(value, Mapping):
        label, data = _text(value.get("Name", "")), value.get("Data")
        if label and isinstance(data, np.ndarray):
            return _flat(label, data, _text(value.get("Unit", "")))
        unit = _text(value.get("unit", value.get("units", value.get("Unit", ""))))
        return [array for key, inner in value.items() for array in _flat(f"{name}.{key}", inner, unit)]
    if isinstance(value, (list, tuple)) or (isinstance(value, np.ndarray) and value.dtype == object):
        items = enumerate(np.ravel(np.asarray(value, dtype=object)), start=1)
        return [array for number, inner in items for array in _flat(f"{name}[{number}]", inner, unit)]
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiu" or value.ndim not in (1, 2):
        return []
    if max(value.shape, default=0) < 2:
        return []
    if value.ndim == 1:
        return [(name, unit, value.astype(float))]
    lines = value if value.shape[0] < value.shape[1] else value.T
    several = len(lines) > 1
    return [(f"{name}[{k}]" if several else name, unit, line.astype(float)) for k, line in enumerate(lines, start=1)]


def _text(value: object) -> str:
    return value if isinstance(value, str) else ""
