"""Keeps a sweep on disk while it runs: a Zarr store, so that what was done outlives an interruption.

One process writes it, a whole chunk a block: first what was found, then the block's status.  Zarr writes a chunk to
a temporary file and renames it, so that a chunk is there whole or not at all; a block whose status is not there is
computed again.  The store is made beside its place and renamed, too.
"""

import contextlib
import dataclasses
import importlib.metadata
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Float, Int

from ..core import Document, InputError
from ..sweeps import AbstractBlockStore, BlockPlan, blank, columns_of, differences, extended

SWEEP_STORE = "points.zarr"
"""Of the store, in the folder of a sweep's results."""

PENDING, DONE, FAILED = 0, 1, 2
"""Status of a block."""

_REASON = 200
"""Bytes kept of why a block failed."""

_NEEDED = (3, 1, 6)
"""The version of Zarr from which on it writes by renaming."""

_FILE = 4096
"""Bytes that a file takes at least on most disks."""

Group: TypeAlias = Any
"""A `zarr.Group`; zarr is loaded where it is used, and need not be installed."""


class SweepStore(AbstractBlockStore):
    """The blocks of a sweep in a Zarr store at `place`."""

    def __init__(self, place: Path | str, resume: bool = False, overwrite: bool = False):
        """With `resume` it goes on with a store that is there, with `overwrite` it replaces it; else there is none."""
        self.place, self.resume, self.overwrite = Path(place), resume, overwrite
        self._group: Group = None
        check_zarr()

    def open(self, document: Document, plan: BlockPlan) -> tuple[BlockPlan, Sequence[int]]:
        if self.place.exists() and not (self.resume or self.overwrite):
            raise InputError(
                f"{self.place}: found a sweep already; expected --resume to go on with it, another folder, or "
                "--overwrite to begin anew."
            )
        check_room(document, plan, self.place)
        if self.place.exists() and not self.resume:
            shutil.rmtree(self.place)
        with _reading(self.place):
            if self.place.exists():
                plan = _resumed(self.place, _opened(self.place), document, plan)
            else:
                _create(self.place, document, plan)
            self._group, self._plan = _opened(self.place), plan
            return plan, [number for number, status in enumerate(self._status()) if not self._kept(number, status)]

    def _kept(self, number: int, status: int) -> bool:
        """Whether a block is done and can be read: what was damaged or lost on the disk is computed again."""
        if status != DONE:
            return False
        try:
            rows = np.asarray(self._group["found"][self._plan.place(number)])
        except (OSError, RuntimeError, ValueError):
            return False
        # Of every point something is known, if only why there is no more.
        return bool(np.isfinite(rows).any(axis=1).all())

    def keep(self, number: int, found: Float[np.ndarray, "points columns"]) -> None:
        self._group["found"][self._plan.place(number)] = found
        self._group["status"][number] = DONE

    def fail(self, number: int, reason: str) -> None:
        told = np.zeros(_REASON, np.uint8)
        text = reason.encode()[:_REASON]
        told[: len(text)] = np.frombuffer(text, np.uint8)
        self._group["reason"][number] = told
        self._group["status"][number] = FAILED

    def read(self) -> Float[np.ndarray, "points columns"]:
        rows = np.asarray(self._group["found"][: len(self._plan.order)])
        missing = np.repeat(self._status() != DONE, self._plan.lanes)[: len(rows)]
        rows[missing] = blank(1, rows.shape[1])
        return rows

    def _status(self) -> Int[np.ndarray, " blocks"]:
        # An extension that was interrupted leaves room at the end.
        return np.asarray(self._group["status"][: self._plan.blocks])

    def reasons(self) -> dict[int, str]:
        """Why blocks failed, by their number."""
        failed = np.flatnonzero(self._status() == FAILED)
        text = lambda row: bytes(row).rstrip(b"\0").decode(errors="replace")
        return {int(number): text(self._group["reason"][number]) for number in failed}


@contextlib.contextmanager
def _reading(place: Path) -> Iterator[None]:
    """Within it whatever a damaged store at `place` raises becomes one line, an `InputError`."""
    try:
        yield
    except InputError:
        raise
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise InputError(
            f"{place}: found a damaged store of a sweep ({error}), expected one that pdssjax made; begin anew with "
            "--overwrite."
        ) from None


def check_zarr() -> None:
    """**Raises** `InputError` where Zarr is not installed, or writes in place."""
    try:
        found = importlib.metadata.version("zarr")
    except importlib.metadata.PackageNotFoundError:
        found = ""
    version = tuple(int(part) for part in found.split(".")[:3] if part.isdigit())
    if version < _NEEDED:
        needed = ".".join(map(str, _NEEDED))
        told = f"zarr {found}" if found else "no zarr"
        raise InputError(
            f"a sweep that can be resumed: found {told}, expected {needed} or later: \"pip install 'zarr>={needed}'\"."
        )


def bytes_needed(document: Document, plan: BlockPlan) -> int:
    """How much room [bytes] the store of a plan takes on the disk, at most."""
    rows = len(plan.order) * 8 * (columns_of(document) + plan.values.shape[1] + 1)
    return rows + 3 * _FILE * plan.blocks + 16 * _FILE


def check_room(document: Document, plan: BlockPlan, place: Path) -> None:
    """**Raises** `InputError` where the disk at `place` has no room for the store of `plan`."""
    ground = next(folder for folder in (place, *place.absolute().parents) if folder.exists())
    free, needed = shutil.disk_usage(ground).free, bytes_needed(document, plan)
    if needed > free:
        raise InputError(
            f"{place}: found {free / 1e6:.3g} MB free for {len(plan.order)} points, expected {needed / 1e6:.3g} MB."
        )


def _create(place: Path, document: Document, plan: BlockPlan) -> None:
    """An empty store, made beside its place and renamed."""
    import zarr

    place.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".unfinished-", dir=place.parent) as folder:
        made = Path(folder) / place.name
        group = zarr.create_group(made, attributes={"job": document, "lanes": plan.lanes, "points": len(plan.order)})
        array = lambda name, shape, chunks, dtype, fill, names: group.create_array(
            name, shape=shape, chunks=chunks, dtype=dtype, fill_value=fill, dimension_names=names
        )
        points, columns = len(plan.order), columns_of(document)
        array("found", (points, columns), (plan.lanes, columns), "float64", np.nan, ("point", "column"))
        array("status", (plan.blocks,), (1,), "uint8", PENDING, ("block",))
        array("reason", (plan.blocks, _REASON), (1, _REASON), "uint8", 0, ("block", "byte"))
        whole = max(points, 1), max(plan.values.shape[1], 1)
        array("values", plan.values.shape, whole, "float64", np.nan, ("point", "path"))[:] = plan.values
        array("order", (points,), whole[:1], "int64", 0, ("point",))[:] = plan.order
        made.rename(place)


def _opened(place: Path) -> Group:
    import zarr

    try:
        group = zarr.open_group(place, mode="r+")
        job: object = group.attrs["job"]
    except (OSError, ValueError, KeyError) as error:
        raise InputError(f"{place}: found no store of a sweep ({error}), expected one that pdssjax made.") from None
    if not isinstance(job, dict):
        raise InputError(f"{place}: found no job in the store, expected one that pdssjax made.")
    return group


def _resumed(place: Path, group: Group, document: Document, plan: BlockPlan) -> BlockPlan:
    """The plan of the store, which is `plan` or has the same points in other blocks; new points are made room for.

    **Raises:** `InputError` that says what differs where the store is that of another sweep.
    """
    other = differences(document, group.attrs["job"])
    points = group.attrs["points"]
    # Begun on a machine with other devices, it goes on in the blocks that it has.
    plan = dataclasses.replace(plan, lanes=group.attrs["lanes"])
    whole = None if other else extended(plan, np.asarray(group["values"][:points]))
    if whole is None:
        other = other or [f"{points} points, not all of them among these {len(plan.order)}"]
        more = f", and {len(other) - 3} more" if len(other) > 3 else ""
        raise InputError(
            f"{place}: found the store of another sweep ({'; '.join(other[:3])}{more}); expected that of this one, "
            "another folder, or --overwrite."
        )
    if len(whole.order) > points:
        _extend(group, whole, points)
    return whole


def _extend(group: Group, plan: BlockPlan, points: int) -> None:
    """Makes room for the points of `plan` beyond the first `points`; how many there are is said last."""
    if points % plan.lanes:
        # New points fill this block up.
        group["status"][points // plan.lanes] = PENDING
    for name, length in {"found": len(plan.order), "values": len(plan.order), "order": len(plan.order)}.items():
        group[name].resize((length, *group[name].shape[1:]))
    for name in ("status", "reason"):
        group[name].resize((plan.blocks, *group[name].shape[1:]))
    group["values"][points:] = plan.values[points:]
    group["order"][:] = plan.order
    group.attrs["points"] = len(plan.order)
