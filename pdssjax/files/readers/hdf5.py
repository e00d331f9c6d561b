"""HDF5 files, by h5py, and MATLAB's since version 7.3, which are HDF5: channels are called by their paths.

Numbers in one dimension are a channel; of two, each line along the longer one is; a table's columns are, too.
Units are the attribute `units` or `unit`, a clock is one of `INTERVALS` [s] (`START` [s]) or `RATES` [Hz], of the
dataset or of its group, as Keysight's oscilloscopes and h5py's users write them.  Samples are read block by block.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...core import InputError
from ._errors import library, refusing, same_length
from .base import BLOCK, AbstractReader, Block, Channel

INTERVALS = ("interval", "sample_interval", "dt", "wf_increment", "XInc")
START = ("start", "t0", "wf_start_offset", "XOrg")
RATES = ("sample_rate", "sampling_rate", "samplerate", "fs")

_MAGIC = b"\x89HDF\r\n\x1a\n"


class _Line(NamedTuple):
    """Where a channel lies in a file."""

    path: str
    field: str
    """The column of a table, or ""."""
    across: int | None
    """The place in the shorter dimension, or None."""
    transposed: bool
    """Samples follow each other along the last dimension."""


class Hdf5(AbstractReader):
    """An HDF5 file."""

    ending = ".h5"

    def __init__(self, file: Path, decimal: str = "") -> None:
        self.file = file

    @classmethod
    def recognises(cls, file: Path, head: bytes) -> bool:
        return head.startswith(_MAGIC) or head[512:520] == _MAGIC or file.suffix.lower() in (".h5", ".hdf5", ".hdf")

    def channels(self) -> list[Channel]:
        h5py = library("h5py", "hdf5", self.file)
        with refusing(self.file, "an HDF5 file"), h5py.File(self.file, "r") as opened:
            lines = _lines(opened)
            if not lines:
                raise InputError(
                    f"{self.file}: found no channel among {list(opened)[:6]}, expected arrays of numbers "
                    "(MATLAB's tables and timeseries: save them as plain arrays or structs)."
                )
            return [_channel(opened, line, number) for number, line in enumerate(lines, start=1)]

    def blocks(self, numbers: Sequence[int], first: int = 0) -> Iterator[Block]:
        h5py = library("h5py", "hdf5", self.file)
        with refusing(self.file, "an HDF5 file"), h5py.File(self.file, "r") as opened:
            lines = _lines(opened)
            chosen = [lines[number - 1] for number in numbers]
            count = same_length(self.file, {_name(line): _length(opened, line) for line in chosen})
            for begin in range(first, count, BLOCK):
                end = min(begin + BLOCK, count)
                values = np.column_stack([_part(opened, line, begin, end) for line in chosen])
                yield Block(values, np.arange(begin + 1, end + 1))


def _lines(opened: Any) -> list[_Line]:
    found: list[_Line] = []

    def look(path: str, item: Any) -> None:
        if hasattr(item, "shape") and not path.startswith("#refs#"):
            found.extend(_of_dataset(path, item))

    opened.visititems(look)
    return found


def _of_dataset(path: str, stored: Any) -> list[_Line]:
    text = stored.attrs.get("MATLAB_class", b"") in (b"char", b"cell", b"logical", b"string")
    if text or stored.ndim not in (1, 2) or max(stored.shape) < 2:
        return []
    if stored.dtype.names and stored.ndim == 1:
        fields = [name for name in stored.dtype.names if _is_number(stored.dtype[name])]
        return [_Line(path, name, None, False) for name in fields]
    if not _is_number(stored.dtype):
        return []
    if stored.ndim == 1:
        return [_Line(path, "", None, False)]
    transposed = stored.shape[1] > stored.shape[0]
    return [_Line(path, "", across, transposed) for across in range(min(stored.shape))]


def _is_number(kind: np.dtype) -> bool:
    return bool(np.issubdtype(kind, np.number)) and not np.issubdtype(kind, np.complexfloating)


def _name(line: _Line, several: bool = True) -> str:
    if line.field:
        return f"{line.path}/{line.field}"
    return line.path if line.across is None or not several else f"{line.path}[{line.across + 1}]"


def _channel(opened: Any, line: _Line, number: int) -> Channel:
    stored = opened[line.path]
    told = {**dict(stored.parent.attrs), **dict(stored.attrs)}
    said = lambda keys: next((float(np.ravel(told[key])[0]) for key in keys if key in told), None)
    rate, interval = said(RATES), said(INTERVALS)
    unit = next((told[key] for key in ("units", "unit", "Unit", "Units", "YUnits") if key in stored.attrs), "")
    several = line.across is not None and min(stored.shape) > 1
    return Channel(
        _name(line, several),
        number,
        unit.decode() if isinstance(unit, bytes) else str(unit),
        _length(opened, line),
        interval or (1.0 / rate if rate else None),
        said(START) or 0.0,
    )


def _length(opened: Any, line: _Line) -> int:
    shape = opened[line.path].shape
    return max(shape) if line.across is not None else shape[0]


def _part(opened: Any, line: _Line, begin: int, end: int) -> np.ndarray:
    stored = opened[line.path]
    if line.field:
        return np.asarray(stored[line.field, begin:end], float)
    if line.across is None:
        return np.asarray(stored[begin:end], float)
    part = stored[line.across, begin:end] if line.transposed else stored[begin:end, line.across]
    return np.asarray(part, float)
