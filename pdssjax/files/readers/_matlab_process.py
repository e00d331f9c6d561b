"""Reads a MATLAB file in a process of its own, since SciPy trusts what is in one: a single wrong bit can crash it.

A script, not to be imported: `python -P _matlab_process.py FILE BYTES SECONDS` reads FILE with at most so much memory
more than it began with, in so many seconds of processor time, as far as the system knows such limits.  It writes to
standard output the length of a JSON text (8 bytes, little-endian), that text, blanks up to a multiple of 8 bytes, and
the samples as 8-byte floats.  The text has either `broken`, what is wrong, or `channels`, each [name, unit, samples],
and `names`, the variables.  It imports nothing but NumPy and SciPy, so that it starts quickly.
"""

import contextlib
import json
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import scipy.io

_Array: TypeAlias = "tuple[str, str, np.ndarray]"
"""Name, unit and samples of a channel."""


def main() -> None:
    file, most, seconds = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    _limit(most, seconds)
    found: list[_Array] = []
    try:
        held = scipy.io.loadmat(file, simplify_cells=True)
        variables = {key: value for key, value in held.items() if not key.startswith("__")}
        found = [array for key, value in variables.items() for array in _flat(key, value, "")]
        said = {"channels": [(name, unit, values.size) for name, unit, values in found], "names": list(variables)}
    except MemoryError:
        said = {"broken": f"it needs more than {most / 2**30:.1f} GiB of memory"}
    except Exception as error:  # SciPy raises errors of many types
        said = {"broken": str(error) or type(error).__name__}
    text = json.dumps(said).encode()
    text += b" " * (-len(text) % 8)
    sys.stdout.buffer.write(len(text).to_bytes(8, "little") + text)
    for _, _, values in found:
        sys.stdout.buffer.write(np.ascontiguousarray(values, "<f8").data)


def _limit(more: int, seconds: int) -> None:
    try:
        import resource
    except ImportError:  # Windows
        return
    try:
        begun = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    except (OSError, ValueError):
        begun = 4 << 30
    for kind, most in ((resource.RLIMIT_AS, begun + more), (resource.RLIMIT_CPU, seconds)):
        hard = resource.getrlimit(kind)[1]
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(kind, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


def _flat(name: str, value: Any, unit: str) -> list[_Array]:
    """The channels within a variable."""
    if isinstance(value, Mapping):
        label, data = _text(value.get("Name", "")), value.get("Data")
        if label and isinstance(data, np.ndarray):
            return _flat(label, data, _text(value.get("Unit", "")))
        if isinstance(value.get("X"), Mapping) and "Y" in value:
            return _captured(name, value)
        unit = _text(value.get("unit", value.get("units", value.get("Unit", ""))))
        return [array for key, inner in value.items() for array in _flat(f"{name}.{key}", inner, unit)]
    if isinstance(value, (list, tuple)) or (isinstance(value, np.ndarray) and value.dtype == object):
        items = enumerate(_told_apart(list(np.ravel(np.asarray(value, dtype=object)))), start=1)
        return [array for number, inner in items for array in _flat(f"{name}[{number}]", inner, unit)]
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiuc" or value.ndim not in (1, 2):
        return []
    if max(value.shape, default=0) < 2:
        return []
    if value.dtype.kind == "c":
        return [*_flat(f"{name}.real", value.real, unit), *_flat(f"{name}.imag", value.imag, unit)]
    if value.ndim == 1:
        return [(name, unit, value.astype(float))]
    lines = value if value.shape[0] < value.shape[1] else value.T
    several = len(lines) > 1
    return [(f"{name}[{k}]" if several else name, unit, line.astype(float)) for k, line in enumerate(lines, start=1)]


def _captured(name: str, value: Mapping[str, Any]) -> list[_Array]:
    """The channels of a capture of dSPACE: X is the clock of the series in Y, also where it has no name."""
    clock = value["X"]
    if isinstance(clock.get("Data"), np.ndarray) and not _text(clock.get("Name", "")):
        clock = {**clock, "Name": "time", "Unit": _text(clock.get("Unit", "")) or "s"}
    parts = {**value, "X": clock}
    return [array for key, inner in parts.items() for array in _flat(f"{name}.{key}", inner, "")]


def _told_apart(items: Sequence[Any]) -> list[Any]:
    """Series of a list, those with one Name (dSPACE's "ADC") called by the end of their Path, too."""
    named = lambda item: _text(item.get("Name", "")) if isinstance(item, Mapping) else ""
    count = Counter(map(named, items))
    made: list[Any] = []
    for item in items:
        end = _text(item.get("Path", "")).rpartition("/")[2] if isinstance(item, Mapping) else ""
        made.append({**item, "Name": f"{end}/{named(item)}"} if end and count[named(item)] > 1 else item)
    return made


def _text(value: object) -> str:
    return value if isinstance(value, str) else ""


if __name__ == "__main__":
    main()
