"""Blocks of points that are computed together: their plan, their results in a store, and their shares of the devices.

The points of a block take about as long as each other.  A store is written by the process that runs the sweep,
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
"""Points side by side on a CPU: measurements from 16 to 128 found this the fastest."""

_PACE = ("drive.direction", "drive.frequency")
"""Paths that set the time of a point, the one with the fewest values first: a block waits for its slowest point."""


@dataclasses.dataclass(frozen=True, eq=False)
class BlockPlan:
    """The points in the order in which they are computed, in blocks of one size."""

    values: Float[np.ndarray, "points paths"]
    """The numbers [SI] of all points, in the order of the blocks."""
    order: Int[np.ndarray, " points"]
    """Index of each of them in the set of points."""
    lanes: int = LANES
    """Points in a block; the last may have fewer."""

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return -(-len(self.order) // self.lanes)

    def place(self, number: int) -> slice:
        """Rows of the plan that are the points of block `number`."""
        return slice(number * self.lanes, min((number + 1) * self.lanes, len(self.order)))

    def block(self, number: int) -> Float[np.ndarray, "lanes paths"]:
        """The numbers [SI] of a block's points, filled up with the last of them."""
        values = self.values[self.place(number)]
        return np.concatenate([values, np.repeat(values[-1:], self.lanes - len(values), axis=0)])


def extend_plan(plan: BlockPlan, stored: Float[np.ndarray, "stored paths"]) -> BlockPlan | None:
    """The points of `plan`, those that are `stored` first and in their order; None where `plan` lacks one of them.

    The blocks of a store stay what they were, but for the last, which new points fill up.
    """
    if stored.shape[1] != plan.values.shape[1]:
        return None
    indices = {row.tobytes(): index for index, row in enumerate(plan.values)}
    known = np.array([indices.get(row.tobytes(), -1) for row in stored], int)
    if np.any(known < 0) or np.unique(known).size != known.size:
        return None
    chosen = np.concatenate([known, np.setdiff1d(np.arange(len(plan.values)), known)])
    return dataclasses.replace(plan, values=plan.values[chosen], order=plan.order[chosen])


def plan_blocks(paths: tuple[str, ...], values: Float[np.ndarray, "points paths"], lanes: int) -> BlockPlan:
    """Plan blocks of points that take similar time; the same points give the same plan."""
    pace = [values[:, paths.index(path)] for path in reversed(_PACE) if path in paths]
    order = np.lexsort(pace) if pace else np.arange(len(values))
    return BlockPlan(values[order], order, lanes)


class AbstractBlockStore(abc.ABC):
    """Keeps the results block by block, so that an interrupted sweep can go on."""

    @abc.abstractmethod
    def open(self, document: Document, plan: BlockPlan) -> tuple[BlockPlan, Sequence[int]]:
        """Prepare for the points of `plan`; return the plan to compute, and the numbers of its blocks still to compute.

        The plan returned has the same points, in other blocks where the store holds some of them in other blocks.

        **Raises:** `InputError` that says what differs where the store holds another sweep, or that another process
        uses the store.
        """

    @abc.abstractmethod
    def keep(self, number: int, found: Float[np.ndarray, "points columns"]) -> None:
        """Keep the results at the points of block `number`, one row each: the metrics in SI, then the failure."""

    def close(self) -> None:
        """Release what `open` acquired, such as a lock; the results stay."""
        return None

    @abc.abstractmethod
    def read(self) -> Float[np.ndarray, "points columns"]:
        """All results [SI], in the plan's order; NaN and `NOT_COMPUTED` where a block failed or is missing."""


class MemoryStore(AbstractBlockStore):
    """Keeps the blocks in memory, for this process alone."""

    def open(self, document: Document, plan: BlockPlan) -> tuple[BlockPlan, Sequence[int]]:
        self._plan, self._found = plan, empty_results(len(plan.order), count_columns(document))
        return plan, range(plan.blocks)

    def keep(self, number: int, found: Float[np.ndarray, "points columns"]) -> None:
        self._found[self._plan.place(number)] = found

    def read(self) -> Float[np.ndarray, "points columns"]:
        return self._found


def count_columns(document: Document) -> int:
    """Number of results of the job `document` at a point: its metrics, then the failure."""
    return len(document["metrics"]) + 1


def empty_results(points: int, columns: int) -> Float[np.ndarray, "points columns"]:
    """Results of points that were not computed."""
    results = np.full((points, columns), np.nan)
    results[:, -1] = NOT_COMPUTED
    return results


_COPIES = 4
"""Copies of all points and results held at once: in the order of the axes, in that of the blocks, labelled."""

_MEMORY_SHARE = 0.5
"""Part of the machine's memory that they may take."""


def check_memory(points: int, paths: int, columns: int) -> None:
    """**Raises** `InputError` for more points than this machine can hold, with `columns` numbers found at each.

    Nothing is refused where the system does not tell its memory.
    """
    try:
        memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return
    needed = 8 * _COPIES * points * (paths + columns)
    if needed > _MEMORY_SHARE * memory:
        raise InputError(
            f"sweep: found {points:.4g} points, which take {1e-9 * needed:.3g} GB of memory, expected at most "
            f"{1e-9 * _MEMORY_SHARE * memory:.3g} GB, half of this machine's: ask for fewer, or for one part after the "
            "other."
        )


_DEVICE_LANES = 4096
"""Points side by side on a device other than a CPU: it has as many lanes, and launches dominate the cost of a step."""

Result = TypeVar("Result")
"""A pytree of arrays, one row a point."""


def map_over_devices(
    compute: Callable[[Float[Array, "points paths"]], Result], points: Float[Array, "points paths"]
) -> Result:
    """`compute(points)`, where each device of this machine computes an equal share of the points.

    **Arguments:** `compute` treats points alike, in any number; the number of `points` is a multiple of
    `round_up_to_devices(1)`.
    """
    devices = np.array(jax.local_devices())
    if devices.size == 1:
        return compute(points)
    share = PartitionSpec("points")
    mesh = Mesh(devices, ("points",))
    # Loops end after different numbers of turns on the devices, which JAX's check of replicated values refuses.
    return jax.shard_map(compute, mesh=mesh, in_specs=share, out_specs=share, check_vma=False)(points)


def round_up_to_devices(points: int) -> int:
    """The smallest multiple of the number of this machine's devices that is not less than `points`."""
    devices = jax.local_device_count()
    return -(-points // devices) * devices


def default_lanes() -> int:
    """Points of a block, as many as suit the devices of this machine."""
    devices = jax.local_devices()
    return len(devices) * (LANES if devices[0].platform == "cpu" else _DEVICE_LANES)


def default_workers() -> int:
    """Threads that keep this machine busy: one a core, or two with several devices or accelerators.

    With two, one thread prepares a block while the devices compute another.
    """
    devices = jax.local_devices()
    return 2 if len(devices) > 1 or devices[0].platform != "cpu" else os.cpu_count() or 1
