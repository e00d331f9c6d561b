"""A sweep on the disk: a Zarr store of its blocks, so that it can be resumed after an interruption, and its results.

One process, with the lock of a file beside the store, writes a whole chunk for each block: first results, then their
digest, then the status.  Zarr writes a chunk to a temporary file and renames it, so that a chunk is whole or missing; a
block without status is computed again.  Zarr's chunks have no checksum against flipped bits, so that the digest covers
the job, the number of the block, its points and its results; a block that does not match is computed again.  The store
itself is also made beside its place and renamed.

The results are the dataset of the sweep or of the border, with figures.  They have a digest as well.
"""

import contextlib
import dataclasses
import hashlib
import importlib.metadata
import importlib.util
import json
import shutil
import tempfile
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float, Int, UInt8

from ..core import Document, InputError, InputWarning
from ..sweeps import AbstractBlockStore, BlockPlan, count_columns, differences, empty_results, extend_plan, job_text
from .file_lock import UNFINISHED, file_lock
from .record_results import write_numbers
from .results_folder import nearest_existing, staging_folder

if TYPE_CHECKING:
    import xarray

SWEEP_STORE = "points.zarr"
"""Name of the store, in the folder of a sweep's results."""

PENDING, DONE = 0, 1
"""Status of a block."""

_DIGEST = 32
"""Bytes of a block's digest."""

Group: TypeAlias = Any
"""A `zarr.Group`; zarr is an optional dependency, imported where it is used."""


class SweepStore(AbstractBlockStore):
    """The blocks of a sweep in a Zarr store at `place`."""

    def __init__(self, place: Path | str, resume: bool = False, overwrite: bool = False):
        """A store at `place`: `resume` continues it, `overwrite` replaces it; without them it must not exist."""
        self.place, self.resume, self.overwrite = Path(place), resume, overwrite
        self._group: Group = None
        self._lock = contextlib.ExitStack()
        check_zarr()

    def open(self, document: Document, plan: BlockPlan) -> tuple[BlockPlan, Sequence[int]]:
        if self.place.exists() and not (self.resume or self.overwrite):
            raise InputError(
                f"{self.place}: found a sweep already; expected --resume to go on with it, another folder, or "
                "--overwrite to begin anew."
            )
        check_room(document, plan, self.place)
        beside = self.place.with_name(f".{self.place.name}.lock")
        self._lock.enter_context(file_lock(beside, self.place, _unfinished_prefix(self.place)))
        if self.place.exists() and not self.resume:
            shutil.rmtree(self.place)
        try:
            if self.place.exists():
                plan = _plan_to_resume(self.place, _open_group(self.place), document, plan)
            else:
                _create(self.place, document, plan)
            self._group, self._plan, self._job = _open_group(self.place), plan, job_text(document)
            _check_arrays(self._group, count_columns(document), plan)
            _, damaged = self._read_verified()
            if damaged:
                reason = "found results that do not match their digest, or have none; they are computed again."
                warnings.warn(f"{self.place}: {_name_blocks(damaged)}: {reason}", InputWarning, 3)
            done = self._status() == DONE
            return plan, [number for number in range(plan.blocks) if number in damaged or not done[number]]
        except InputError:
            raise
        except (KeyError, TypeError, ValueError, RuntimeError) as error:
            raise InputError(
                f"{self.place}: found a damaged store of a sweep ({error}), expected one that pdssjax made; begin anew "
                "with --overwrite."
            ) from None

    def close(self) -> None:
        self._lock.close()

    def keep(self, number: int, found: Float[np.ndarray, "points columns"]) -> None:
        found = np.asarray(found, float)
        self._group["found"][self._plan.place(number)] = found
        self._group["digest"][number] = self._digest(number, found)
        self._group["status"][number] = DONE

    def _digest(self, number: int, found: Float[np.ndarray, "points columns"]) -> UInt8[np.ndarray, " bytes"]:
        """The digest of the results of block `number` and of its points."""
        points = self._plan.values[self._plan.place(number)]
        digest = hashlib.sha256(f"{number} {found.shape} {self._job}".encode())
        for part in (points, found):
            # The same on every machine, whatever the order of bytes in memory or in the store.
            digest.update(np.ascontiguousarray(part, "<f8").tobytes())
        return np.frombuffer(digest.digest(), np.uint8)

    def _read_verified(self) -> tuple[Float[np.ndarray, "points columns"], set[int]]:
        """All results that can be read, and the blocks with status `DONE` that do not match their digest."""
        place, rows = self._plan.place, self._read_array("found", len(self._plan.order), self._plan.lanes, np.nan)
        digests = self._read_array("digest", self._plan.blocks, 1, 0)
        done = np.flatnonzero(self._status() == DONE).tolist()
        return rows, {n for n in done if not np.array_equal(digests[n], self._digest(n, rows[place(n)]))}

    def _read_array(self, name: str, length: int, chunk: int, filler: float) -> np.ndarray:
        """The first `length` rows of an array, with the `filler` for chunks that cannot be read."""
        array = self._group[name]
        with contextlib.suppress(OSError, RuntimeError, ValueError):
            return np.asarray(array[:length])
        rows = np.full((length, *array.shape[1:]), filler, array.dtype)
        for begin in range(0, length, chunk):
            part = slice(begin, min(begin + chunk, length))
            with contextlib.suppress(OSError, RuntimeError, ValueError):
                rows[part] = array[part]
        return rows

    def read(self) -> Float[np.ndarray, "points columns"]:
        rows, damaged = self._read_verified()
        missing = self._status() != DONE
        missing[list(damaged)] = True
        rows[np.repeat(missing, self._plan.lanes)[: len(rows)]] = empty_results(1, rows.shape[1])
        if damaged:
            reason = "found results that do not match their digest; they are left out, go on with --resume."
            warnings.warn(f"{self.place}: {_name_blocks(damaged)}: {reason}", InputWarning, 3)
        return rows

    def _status(self) -> Int[np.ndarray, " blocks"]:
        # An interrupted extension leaves room at the end.
        return self._read_array("status", self._plan.blocks, 1, PENDING)


def _name_blocks(blocks: set[int]) -> str:
    """Blocks in words, such as "blocks 1, 2"."""
    first = ", ".join(map(str, sorted(blocks)[:8]))
    more = f" and {len(blocks) - 8} more" if len(blocks) > 8 else ""
    return f"block{'s' if len(blocks) > 1 else ''} {first}{more}"


def _unfinished_prefix(place: Path) -> str:
    """Beginning of the names of unfinished stores for `place`."""
    return f"{UNFINISHED}{place.name}-"


def check_zarr() -> None:
    """**Raises** `InputError` where Zarr is not installed, or writes in place."""
    try:
        version = importlib.metadata.version("zarr")
    except importlib.metadata.PackageNotFoundError:
        version = ""
    # From 3.1.6 on zarr writes by renaming.
    if tuple(int(part) for part in version.split(".")[:3] if part.isdigit()) < (3, 1, 6):
        installed = f"zarr {version}" if version else "no zarr"
        raise InputError(
            f"a sweep that can be resumed: found {installed}, expected 3.1.6 or later: \"pip install 'zarr>=3.1.6'\"."
        )


def bytes_needed(document: Document, plan: BlockPlan) -> int:
    """Upper bound of the size [bytes] of a plan's store on the disk."""
    rows = len(plan.order) * 8 * (count_columns(document) + plan.values.shape[1] + 1)
    # On most disks a file takes 4096 bytes at least.
    return rows + 4096 * (4 * plan.blocks + 20)


def check_room(document: Document, plan: BlockPlan, place: Path) -> None:
    """**Raises** `InputError` where the disk at `place` has no room for the store of `plan`."""
    free, needed = shutil.disk_usage(nearest_existing(place)).free, bytes_needed(document, plan)
    if needed > free:
        raise InputError(
            f"{place}: found {free / 1e6:.3g} MB free for {len(plan.order)} points, expected {needed / 1e6:.3g} MB."
        )


def _create(place: Path, document: Document, plan: BlockPlan) -> None:
    """Make an empty store beside its place, and rename it."""
    import zarr

    place.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=_unfinished_prefix(place), dir=place.parent) as folder:
        unfinished = Path(folder) / place.name
        group = zarr.create_group(
            unfinished, attributes={"job": document, "lanes": plan.lanes, "points": len(plan.order)}
        )
        for name, array in _arrays(count_columns(document), plan).items():
            stored = group.create_array(name, **array._asdict())
            if name in ("values", "order"):
                stored[:] = getattr(plan, name)
        unfinished.rename(place)


class _Array(NamedTuple):
    """An array of the store: its shape, chunks and type, by Zarr's names."""

    shape: tuple[int, ...]
    chunks: tuple[int, ...]
    dtype: str
    fill_value: float
    dimension_names: tuple[str, ...]


def _arrays(columns: int, plan: BlockPlan) -> dict[str, _Array]:
    """The arrays of a store by name."""
    points, paths = plan.values.shape
    whole = max(points, 1), max(paths, 1)
    return {
        "found": _Array((points, columns), (plan.lanes, columns), "float64", np.nan, ("point", "column")),
        "status": _Array((plan.blocks,), (1,), "uint8", PENDING, ("block",)),
        "digest": _Array((plan.blocks, _DIGEST), (1, _DIGEST), "uint8", 0, ("block", "byte")),
        "values": _Array((points, paths), whole, "float64", np.nan, ("point", "path")),
        "order": _Array((points,), whole[:1], "int64", 0, ("point",)),
    }


def _check_arrays(group: Group, columns: int, plan: BlockPlan) -> None:
    """**Raises** `ValueError` where the arrays of a store cannot hold the blocks of `plan`.

    They may be longer, since an interrupted extension leaves room at the end.
    """
    for name, expected in _arrays(columns, plan).items():
        array = group[name]
        # Chunks of one block can be lost and computed again without the others.
        chunks = array.chunks if name in ("values", "order") else expected.chunks
        same = (str(array.dtype), array.chunks, array.shape[1:]) == (expected.dtype, chunks, expected.shape[1:])
        if not same or array.shape[0] < expected.shape[0]:
            stored = f"{array.dtype} of shape {array.shape} in chunks of {array.chunks}"
            raise ValueError(f"{name}: {stored} in place of {expected.dtype} of shape {expected.shape}")


def _open_group(place: Path) -> Group:
    import zarr

    try:
        group = zarr.open_group(place, mode="r+")
        job: object = group.attrs["job"]
    except (OSError, ValueError, KeyError) as error:
        raise InputError(f"{place}: found no store of a sweep ({error}), expected one that pdssjax made.") from None
    if not isinstance(job, dict):
        raise InputError(f"{place}: found no job in the store, expected one that pdssjax made.")
    return group


def _plan_to_resume(place: Path, group: Group, document: Document, plan: BlockPlan) -> BlockPlan:
    """The plan of the store with the points of `plan`, maybe in other blocks; makes room for new points."""
    differing = differences(document, group.attrs["job"])
    points = int(group.attrs["points"])
    # The store keeps the size of its blocks on a machine with other devices.
    plan = dataclasses.replace(plan, lanes=group["found"].chunks[0])
    extended = None if differing else extend_plan(plan, np.asarray(group["values"][:points]))
    if extended is None:
        differing = differing or [f"{points} points, not all of them among these {len(plan.order)}"]
        more = f", and {len(differing) - 3} more" if len(differing) > 3 else ""
        raise InputError(
            f"{place}: found the store of another sweep ({'; '.join(differing[:3])}{more}); expected that of this one, "
            "another folder, or --overwrite."
        )
    if len(extended.order) > points:
        if points % extended.lanes:
            # New points fill up this block.
            group["status"][points // extended.lanes] = PENDING
        for name, array in _arrays(group["found"].shape[1], extended).items():
            group[name].resize(array.shape)
        group["values"][points:] = extended.values[points:]
        group["order"][:] = extended.order
        group.attrs["points"] = len(extended.order)  # last: an interrupted extension leaves room at the end
    return extended


def write_sweep(data: "xarray.Dataset", folder: Path, store: str) -> None:
    """Put a sweep's `xarray.Dataset` into `folder` as sweep.nc or sweep.zarr, with its map and `parameters.json`.

    A sweep of both directions also has `directions.png`.  A single point has no map, and a point of each direction no
    `directions.png`.
    """
    from ..report.figures import directions_figure, save_figure, sweep_figure
    from ..sweeps import ALONG

    with staging_folder(folder) as staging:
        _write_dataset(data, staging, "sweep", store)
        if data.sizes:
            save_figure(sweep_figure(data), staging / "sweep.png")
        if data.sizes.get(ALONG) == 2 and len(data.sizes) > 1:
            save_figure(directions_figure(data), staging / "directions.png")


def write_border(data: "xarray.Dataset", folder: Path, store: str) -> None:
    """Put a border of `find_border` into `folder` as border.nc or border.zarr, with figure and `parameters.json`."""
    from ..report.figures import border_figure, save_figure

    with staging_folder(folder) as staging:
        _write_dataset(data, staging, "border", store)
        save_figure(border_figure(data), staging / "border.png")


def _write_dataset(data: "xarray.Dataset", staging: Path, name: str, store: str) -> None:
    write_numbers(json.loads(data.attrs["parameters"]), staging)
    data = data.assign_attrs({_CHECKSUM: _checksum(data)})
    if store == "zarr":
        # Only format 2 specifies consolidated metadata, without which readers warn.
        data.to_zarr(staging / f"{name}.zarr", zarr_format=2, consolidated=True)
    else:
        data.to_netcdf(staging / f"{name}.nc", engine="scipy")


_CHECKSUM = "digest"
"""The attribute with the digest of a dataset: neither format has checksums against flipped bits."""


def _checksum(data: "xarray.Dataset") -> str:
    """The digest of all numbers, names and attributes of `data`, the same before writing and after reading."""
    digest = hashlib.sha256(_canonical_text({name: value for name, value in data.attrs.items() if name != _CHECKSUM}))
    for name in sorted(map(str, data.variables)):
        variable = data[name]
        values = np.asarray(variable.values)
        digest.update(_canonical_text([name, variable.dims, variable.attrs]))
        # Formats change the types of integers, and NaN has many bit patterns.
        if values.dtype.kind in "iufb":
            numbers = values.astype("<f8")
            digest.update(np.where(np.isnan(numbers), np.nan, numbers).tobytes())
        else:
            digest.update(_canonical_text(values.astype(str)))
    return digest.hexdigest()


def _canonical_text(value: object) -> bytes:
    """A value as text that depends on numbers, not on their types."""
    as_number = lambda entry: np.asarray(entry).tolist() if hasattr(entry, "dtype") else str(entry)
    numbers = lambda entry: float(entry) if isinstance(entry, int | float | np.number) else entry
    if isinstance(value, dict):
        value = {name: numbers(entry) for name, entry in value.items()}
    return json.dumps(value, sort_keys=True, default=as_number).encode()


def check_store(store: str) -> None:
    """**Raises** `InputError` for a format of `write_sweep` whose library is not installed."""
    if store == "zarr" and importlib.util.find_spec("zarr") is None:
        raise InputError('option --store: found zarr, which is not installed; expected netcdf, or "pip install zarr".')


def read_sweep(folder: Path) -> "xarray.Dataset":
    """The dataset that `write_sweep` put into `folder`, in memory.

    **Raises:** `InputError` where there is none, one that cannot be read, or one that was changed since.
    """
    import xarray

    engines = {"sweep.nc": "scipy", "sweep.zarr": "zarr"}
    names = [name for name in engines if (folder / name).exists()]
    if not names:
        raise InputError(f"{folder}: found no {' or '.join(engines)}, expected the results of pdssjax sweep.")
    try:
        with xarray.open_dataset(folder / names[0], engine=engines[names[0]]) as opened:
            data = opened.load()
    except Exception as error:  # libraries raise errors of many types
        raise InputError(f"{folder / names[0]}: cannot be read ({error}), expected a sweep.") from None
    # Sweeps of older versions have no digest.
    if data.attrs.get(_CHECKSUM, "") not in ("", _checksum(data)):
        raise InputError(
            f"{folder / names[0]}: found numbers that do not match their digest, expected the file as pdssjax sweep "
            "wrote it; the sweep's command with --resume writes it again."
        )
    return data
