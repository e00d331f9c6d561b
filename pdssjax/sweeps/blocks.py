"""Blocks of points: which are computed together, how devices share them, what is kept of each, whether all fit.

A block holds points that take about as long as each other.  A store is written by the process that runs the sweep,
never by its workers.  Each device of a machine takes an equal share of a block, and none waits for another.
"""

import abc
import dataclasses
import os
from collections.abc import Callable, Sequence
from typing import TypeVar

import jax
import numpy as np
from jax.sharding import Mesh, PartitionSpec
from jaxtyping import Array, Float, Int

from ..core import Document, InputError
from ..integration import FAILURES

SKIPPED, NOT_COMPUTED, INCOMPLETE, GRAZING = (len(FAILURES) + i for i in range(4))

POINT_FAILURES = (
    *FAILURES,
    "skipped: the numbers of its drive contradict each other",
    "its block of points could not be computed",
    "its cycle was measured, but the further metrics or derivatives could not be found: too many steps, or no finite "
    "number",
    "a reversal of its cycle grazes: its metrics are those of cycles integrated one after the other, and neither "
    "derivatives nor multiplier hold there",
)
"""Sentences on the failure of a point, by its number; 0 is none."""


LANES = 64
"""Points side by side on a CPU: measured, the fastest from 16 to 128."""

_PACE = ("drive.direction", "drive.frequency")
"""Neighbours in a block wait for the slowest of them, and these set the pace: first what has the fewest values."""


@dataclasses.dataclass(frozen=True, eq=False)
class BlockPlan:
    """The points in the order in which they are computed, in blocks of one size."""

    values: Float[np.ndarray, "points paths"]
    """The numbers [SI] of all points, in the order of the blocks."""
    order: Int[np.ndarray, " points"]
    """Which point of the set each of them is."""
    lanes: int = LANES
    """Points in a block; the last may have fewer."""

    @property
    def blocks(self) -> int:
        """How many there are."""
        return -(-len(self.order) // self.lanes)

    def place(self, number: int) -> slice:
        """Where the points of block `number` stand in the plan."""
        return slice(number * self.lanes, min((number + 1) * self.lanes, len(self.order)))

    def block(self, number: int) -> Float[np.ndarray, "lanes paths"]:
        """The numbers [SI] of a block's points, filled up with the last of them."""
        values = self.values[self.place(number)]
        return np.concatenate([values, np.repeat(values[-1:], self.lanes - len(values), axis=0)])


def extended(plan: BlockPlan, held: Float[np.ndarray, "held paths"]) -> BlockPlan | None:
    """The points of `plan` with those that are `held` first, as they stand; None where it has not all of them.

    Blocks of points that are held are then what they were, but for the last, which new points fill up.
    """
    if held.shape[1] != plan.values.shape[1]:
        return None
    where = {row.tobytes(): place for place, row in enumerate(plan.values)}
    known = np.array([where.get(row.tobytes(), -1) for row in held], int)
    if np.any(known < 0) or np.unique(known).size != known.size:
        return None
    new = np.setdiff1d(np.arange(len(plan.values)), known)
    places = np.concatenate([known, new])
    return dataclasses.replace(plan, values=plan.values[places], order=plan.order[places])


def plan_blocks(paths: tuple[str, ...], values: Float[np.ndarray, "points paths"], lanes: int) -> BlockPlan:
    """Points of like pace together; the same for the same points."""
    pace = [values[:, paths.index(path)] for path in reversed(_PACE) if path in paths]
    order = np.lexsort(pace) if pace else np.arange(len(values))
    return BlockPlan(values[order], order, lanes)


class AbstractBlockStore(abc.ABC):
    """Keeps what was found, block by block, so that it is there when a sweep is interrupted."""

    @abc.abstractmethod
    def open(self, document: Document, plan: BlockPlan) -> tuple[BlockPlan, Sequence[int]]:
        """Prepare for the points of `plan` and return which blocks are still to be computed, and of which plan.

        That is another one of the same points where the store holds a part of them in other blocks.

        **Raises:** `InputError` where it holds another sweep, and says what differs, or where another process has it.
        """

    @abc.abstractmethod
    def keep(self, number: int, found: Float[np.ndarray, "points columns"]) -> None:
        """Keep what was found at the points of block `number`, one row each: the metrics in SI, then the failure."""

    def close(self) -> None:
        """Give back what `open` has taken, such as a lock; what is kept stays."""
        return None

    @abc.abstractmethod
    def read(self) -> Float[np.ndarray, "points columns"]:
        """All that was found [SI], in the plan's order; NaN and `NOT_COMPUTED` where a block failed or is missing."""


class MemoryStore(AbstractBlockStore):
    """Keeps the blocks in memory, for this process alone."""

    def open(self, document: Document, plan: BlockPlan) -> tuple[BlockPlan, Sequence[int]]:
        self._plan, self._found = plan, blank(len(plan.order), columns_of(document))
        return plan, range(plan.blocks)

    def keep(self, number: int, found: Float[np.ndarray, "points columns"]) -> None:
        self._found[self._plan.place(number)] = found

    def read(self) -> Float[np.ndarray, "points columns"]:
        return self._found


def columns_of(document: Document) -> int:
    """Columns of what the job `document` finds at a point: its metrics, then the failure."""
    return len(document["metrics"]) + 1


def blank(points: int, columns: int) -> Float[np.ndarray, "points columns"]:
    """Results of points that were not computed."""
    found = np.full((points, columns), np.nan)
    found[:, -1] = NOT_COMPUTED
    return found


_COPIES = 4
"""Copies of all points and results held at once: in the order of the axes, in that of the blocks, labelled."""

_SHARE = 0.5
"""Part of the machine's memory that they may take."""


def check_memory(points: int, paths: int, columns: int) -> None:
    """**Raises** `InputError` for more points than this machine can hold, with `columns` numbers found at each.

    Where the machine does not tell how much memory it has nothing is refused.
    """
    try:
        there = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return
    needed = 8 * _COPIES * points * (paths + columns)
    if needed > _SHARE * there:
        raise InputError(
            f"sweep: found {points:.4g} points, which take {1e-9 * needed:.3g} GB of memory, expected at most "
            f"{1e-9 * _SHARE * there:.3g} GB, half of what this machine has: ask for fewer, or for one part after "
            "the other."
        )


_ACCELERATED = 4096
"""Points side by side on a device other than a CPU: it has as many lanes, and a step costs it its launches."""

Found = TypeVar("Found")
"""A pytree of arrays, one row a point."""


def shared_out(look: Callable[[Float[Array, "points paths"]], Found], points: Float[Array, "points paths"]) -> Found:
    """What `look` finds at `points`, each device of this machine looking at its share of them.

    **Arguments:** `look` treats points alike, in any number; there are a multiple of `whole_shares(1)` of them.
    """
    devices = np.array(jax.local_devices())
    if devices.size == 1:
        return look(points)
    share = PartitionSpec("points")
    # Loops end at another turn on each device, which what JAX knows of replicated values does not allow for.
    return jax.shard_map(look, mesh=Mesh(devices, ("points",)), in_specs=share, out_specs=share, check_vma=False)(
        points
    )


def whole_shares(points: int) -> int:
    """The least number of points, at least so many, that the devices of this machine can share equally."""
    devices = jax.local_device_count()
    return -(-points // devices) * devices


def lanes_here() -> int:
    """Points of a block that suits the devices of this machine."""
    devices = jax.local_devices()
    return len(devices) * (LANES if devices[0].platform == "cpu" else _ACCELERATED)


def default_workers() -> int:
    """Threads that keep this machine busy: one a core, or two where there are several devices or other than CPUs.

    One then prepares a block while the devices compute another.
    """
    devices = jax.local_devices()
    return 2 if len(devices) > 1 or devices[0].platform != "cpu" else os.cpu_count() or 1
