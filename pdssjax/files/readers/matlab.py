"""MATLAB's .mat files of versions 4 to 7.2, by SciPy: arrays of numbers, and those within structs.

Channels are named "name", "struct.field", and "name[2]" for arrays of several columns; complex numbers are two,
"name.real" and "name.imag".  A struct with the fields Name and Data (dSPACE ControlDesk) has its Name and Unit, and the
end of its Path before the Name where several share it.  Files of version 7.3 are HDF5, and read as such.  A file is
read as a whole.
"""

import functools
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ...core import InputError
from .base import AbstractReader, Block, Channel, blocks_of, refusing


class _Array(NamedTuple):
    name: str
    unit: str
    values: Float[np.ndarray, " samples"]


class Matlab(AbstractReader):
    """A .mat file before version 7.3."""

    ending = ".mat"
    expected = "a MATLAB file"

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
        lengths = {array.name: array.values.size for array in chosen}
        yield from blocks_of(self.file, lengths, first, lambda part: [array.values[part] for array in chosen])

    @functools.cached_property
    def _arrays(self) -> list[_Array]:
        import scipy.io  # a quarter of a second

        with refusing(self.file, self.expected):
            content = scipy.io.loadmat(self.file, simplify_cells=True)
        variables = {key: value for key, value in content.items() if not key.startswith("__")}
        arrays = [array for key, value in variables.items() for array in _flat(key, value, "")]
        if not arrays:
            raise InputError(
                f"{self.file}: found no channel among {list(variables)[:6]}, expected arrays of numbers "
                "(MATLAB's tables and timeseries: save them as plain arrays or structs)."
            )
        return arrays


def _flat(name: str, value: Any, unit: str) -> list[_Array]:
    """The channels within a variable."""
    if isinstance(value, Mapping):
        label, data = _text(value.get("Name", "")), value.get("Data")
        if label and isinstance(data, np.ndarray):
            return _flat(label, data, _text(value.get("Unit", "")))
        if isinstance(clock := value.get("X"), Mapping) and "Y" in value:
            # A capture of dSPACE: X is the clock of the series in Y, even without a name.
            if isinstance(clock.get("Data"), np.ndarray) and not _text(clock.get("Name", "")):
                clock = {**clock, "Name": "time", "Unit": _text(clock.get("Unit", "")) or "s"}
            parts = {**value, "X": clock}
            return [array for key, inner in parts.items() for array in _flat(f"{name}.{key}", inner, "")]
        unit = _text(value.get("unit", value.get("units", value.get("Unit", ""))))
        return [array for key, inner in value.items() for array in _flat(f"{name}.{key}", inner, unit)]
    if isinstance(value, (list, tuple)) or (isinstance(value, np.ndarray) and value.dtype == object):
        items = enumerate(_distinct_series(list(np.ravel(np.asarray(value, dtype=object)))), start=1)
        return [array for number, inner in items for array in _flat(f"{name}[{number}]", inner, unit)]
    is_numeric = isinstance(value, np.ndarray) and value.dtype.kind in "fiuc"
    if not is_numeric or value.ndim not in (1, 2) or max(value.shape) < 2:
        return []
    if value.dtype.kind == "c":
        return [*_flat(f"{name}.real", value.real, unit), *_flat(f"{name}.imag", value.imag, unit)]
    if value.ndim == 1:
        return [_Array(name, unit, value.astype(float))]
    lines = value if value.shape[0] < value.shape[1] else value.T
    names = [name] if len(lines) == 1 else [f"{name}[{k}]" for k in range(1, len(lines) + 1)]
    return [_Array(own, unit, line.astype(float)) for own, line in zip(names, lines, strict=True)]


def _distinct_series(items: Sequence[Any]) -> list[Any]:
    """Series of a list; those that share a Name (dSPACE's "ADC") get the end of their Path before it."""
    name_of = lambda item: _text(item.get("Name", "")) if isinstance(item, Mapping) else ""
    count = Counter(map(name_of, items))
    series: list[Any] = []
    for item in items:
        end = _text(item.get("Path", "")).rpartition("/")[2] if isinstance(item, Mapping) else ""
        series.append({**item, "Name": f"{end}/{name_of(item)}"} if end and count[name_of(item)] > 1 else item)
    return series


def _text(value: object) -> str:
    return value if isinstance(value, str) else ""
