"""Which points are computed together: blocks of points that take about as long as each other."""

import dataclasses

import numpy as np
from jaxtyping import Float, Int

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


def plan_blocks(paths: tuple[str, ...], values: Float[np.ndarray, "points paths"], lanes: int = LANES) -> BlockPlan:
    """Points of like pace together; the same for the same points."""
    pace = [values[:, paths.index(path)] for path in reversed(_PACE) if path in paths]
    order = np.lexsort(pace) if pace else np.arange(len(values))
    return BlockPlan(values[order], order, lanes)
