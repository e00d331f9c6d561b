"""HDF5 files, by h5py, and MATLAB's since version 7.3, which are HDF5: channels are named by their paths.

A channel is an array of one dimension, a line of an array along the longer of two dimensions, or a column of a table.
Units are the attribute `units` or `unit`, a clock is one of `INTERVALS` [s] (`START` [s]) or `RATES` [Hz], of the
dataset or of its group, as Keysight's oscilloscopes and h5py's users write them.  Numbers packed by netCDF's CF
conventions (`scale_factor`, `add_offset`, `_FillValue`, `missing_value`, `valid_min` and the like) are unpacked, with
NaN for missing ones.  Complex numbers are two channels, "name.real" and "name.imag".  Samples are read
block by block.
"""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...core import InputError
from .base import AbstractReader, Block, Channel, blocks_of, library, refusing

INTERVALS = ("interval", "sample_interval", "dt", "wf_increment", "XInc")
START = ("start", "t0", "wf_start_offset", "XOrg")
RATES = ("sample_rate", "sampling_rate", "samplerate", "fs")

_PACKING, _MISSING = ("scale_factor", "add_offset"), ("_FillValue", "missing_value")

_UNREAD = ("_Unsigned", "YInc")
"""Attributes that change the meaning of integers, which this reader does not support."""

_MAGIC = b"\x89HDF\r\n\x1a\n"


class _Line(NamedTuple):
    """The place of a channel in a file."""

    path: str
    field: str
    """The column of a table, or ""."""
    across: int | None
    """The index in the shorter dimension, or None."""
    transposed: bool
    """Whether samples follow each other along the last dimension."""
    part: str = ""
    """Part of a complex number: "real" or "imag"."""


class Hdf5(AbstractReader):
    """An HDF5 file."""

    ending = ".h5"
    expected = "an HDF5 file"

    @classmethod
    def recognises(cls, file: Path, head: bytes) -> bool:
        return head.startswith(_MAGIC) or head[512:520] == _MAGIC or file.suffix.lower() in (".h5", ".hdf5", ".hdf")

    def channels(self) -> list[Channel]:
        h5py = library("h5py", "hdf5", self.file)
        with refusing(self.file, self.expected), h5py.File(self.file, "r") as opened:
            lines = _lines(opened)
            if not lines:
                raise InputError(
                    f"{self.file}: found no channel among {list(opened)[:6]}, expected arrays of numbers "
                    "(MATLAB's tables and timeseries: save them as plain arrays or structs)."
                )
            return [_channel(opened, line, number) for number, line in enumerate(lines, start=1)]

    def blocks(self, numbers: Sequence[int], first: int = 0) -> Iterator[Block]:
        h5py = library("h5py", "hdf5", self.file)
        with refusing(self.file, self.expected), h5py.File(self.file, "r") as opened:
            lines = _lines(opened)
            chosen = [lines[number - 1] for number in numbers]
            for line in chosen:
                _check_stored(self.file, opened[line.path])
            unpackers = [_unpacker(self.file, opened[line.path], bool(line.field)) for line in chosen]
            pairs = list(zip(chosen, unpackers, strict=True))
            read = lambda part: [unpack(_part(opened, line, part)) for line, unpack in pairs]
            yield from blocks_of(self.file, {_name(line): _length(opened, line) for line in chosen}, first, read)


def _lines(opened: Any) -> list[_Line]:
    lines: list[_Line] = []

    def visit(path: str, item: Any) -> None:
        if hasattr(item, "shape") and not path.startswith("#refs#"):
            lines.extend(_of_dataset(path, item))

    opened.visititems(visit)
    return lines


def _of_dataset(path: str, stored: Any) -> list[_Line]:
    text = stored.attrs.get("MATLAB_class", b"") in (b"char", b"cell", b"logical", b"string")
    if text or stored.ndim not in (1, 2) or max(stored.shape) < 2:
        return []
    if stored.dtype.names and stored.ndim == 1:
        fields = [(name, stored.dtype[name]) for name in stored.dtype.names]
        return [_Line(path, name, None, False, part) for name, kind in fields for part in _parts(kind)]
    parts = _parts(stored.dtype)
    if stored.ndim == 1:
        return [_Line(path, "", None, False, part) for part in parts]
    transposed = stored.shape[1] > stored.shape[0]
    return [_Line(path, "", across, transposed, part) for part in parts for across in range(min(stored.shape))]


def _parts(kind: np.dtype) -> list[str]:
    """The parts of numbers of a `kind`: one without a name, two for complex numbers, none for other types."""
    if np.issubdtype(kind, np.complexfloating):
        return ["real", "imag"]
    return [""] if np.issubdtype(kind, np.number) else []


def _name(line: _Line, several: bool = True) -> str:
    path = f"{line.path}/{line.field}" if line.field else line.path
    place = f"[{line.across + 1}]" if line.across is not None and several else ""
    return f"{path}{place}{'.' if line.part else ''}{line.part}"


def _unpacker(file: Path, stored: Any, of_table: bool) -> Callable[[np.ndarray], np.ndarray]:
    """A function that unpacks numbers of the dataset `stored`, with NaN for missing ones."""
    unread = _UNREAD if stored.dtype.kind in "iu" else ()
    attrs = {**{key: stored.parent.attrs[key] for key in unread if key in stored.parent.attrs}, **dict(stored.attrs)}
    keys = (*_PACKING, *_MISSING, "valid_range", "valid_min", "valid_max", *unread)
    attributes = {key: attrs[key] for key in keys if key in attrs}
    numbers: dict[str, np.ndarray] = {}
    for key, value in attributes.items():
        where = f'{file}: channel "{stored.name.lstrip("/")}": attribute "{key}"'
        if of_table or key in _UNREAD:
            of_what = "of a table" if of_table else repr(value)
            raise InputError(f"{where}: found {of_what}, which is not read; expected the values themselves.")
        number = np.ravel(np.asarray(value))
        count = 2 if key == "valid_range" else 1
        if number.dtype.kind not in "fiu" or number.size < 1 or (key not in _MISSING and number.size != count):
            raise InputError(f"{where}: found {value!r:.80}, expected {'two numbers' if count == 2 else 'a number'}.")
        # Markers have the precision of what is stored.
        is_marker = key not in _PACKING and stored.dtype.kind == "f"
        numbers[key] = (number.astype(stored.dtype) if is_marker else number).astype(float)
    first_of = lambda key, default: float(numbers[key][0]) if key in numbers else default
    scale, offset = first_of("scale_factor", 1.0), first_of("add_offset", 0.0)
    missing = np.concatenate([np.zeros(0), *(numbers[key] for key in _MISSING if key in numbers)])
    low, high = numbers.get("valid_range", (-np.inf, np.inf))
    low, high = first_of("valid_min", low), first_of("valid_max", high)

    def unpack(raw: np.ndarray) -> np.ndarray:
        valid = (raw >= low) & (raw <= high) & ~np.isin(raw, missing)
        return np.where(valid, scale * raw + offset, np.nan)

    return unpack


def _check_stored(file: Path, stored: Any) -> None:
    """**Raises** `InputError` where a dataset claims more samples than its bytes can hold."""
    claimed = stored.size * stored.dtype.itemsize
    if stored.is_virtual or claimed <= 1 << 27:
        return
    size = stored.id.get_storage_size()
    if claimed > 2000 * size:  # deflate, the usual filter, makes 1032 bytes of one
        raise InputError(
            f'{file}: channel "{stored.name.lstrip("/")}": found {stored.size:.3g} samples claimed by {size} bytes, '
            "expected a file that holds them."
        )


def _channel(opened: Any, line: _Line, number: int) -> Channel:
    stored = opened[line.path]
    attributes = {**dict(stored.parent.attrs), **dict(stored.attrs)}
    first_of = lambda keys: next((float(np.ravel(attributes[key])[0]) for key in keys if key in attributes), None)
    rate, interval = first_of(RATES), first_of(INTERVALS)
    unit = next((attributes[key] for key in ("units", "unit", "Unit", "Units", "YUnits") if key in stored.attrs), "")
    several = line.across is not None and min(stored.shape) > 1
    return Channel(
        _name(line, several),
        number,
        unit.decode() if isinstance(unit, bytes) else str(unit),
        _length(opened, line),
        interval or (1.0 / rate if rate else None),
        first_of(START) or 0.0,
    )


def _length(opened: Any, line: _Line) -> int:
    shape = opened[line.path].shape
    return max(shape) if line.across is not None else shape[0]


def _part(opened: Any, line: _Line, part: slice) -> np.ndarray:
    stored = opened[line.path]
    if line.field:
        values = stored[line.field, part]
    elif line.across is None:
        values = stored[part]
    else:
        values = stored[line.across, part] if line.transposed else stored[part, line.across]
    return np.asarray(getattr(values, line.part) if line.part else values, float)
