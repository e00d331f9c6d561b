"""Where the blocks of a sweep are kept: the contract, and the one that keeps them in memory.

A store is written by the process that runs the sweep, never by its workers.
"""

import abc
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ..core import Document
from .block_plan import BlockPlan
from .point_status import NOT_COMPUTED


class AbstractBlockStore(abc.ABC):
    """Keeps what was found, block by block, so that it is there when a sweep is interrupted."""

    @abc.abstractmethod
    def open(self, document: Document, plan: BlockPlan) -> tuple[BlockPlan, Sequence[int]]:
        """Makes ready for the points of `plan` and says which blocks are still to be computed, and of which plan.

        That is another one of the same points where the store holds a part of them in other blocks.

        **Raises:** `InputError` where it holds another sweep, and says what differs, or where another process has it.
        """

    @abc.abstractmethod
    def keep(self, number: int, found: Float[np.ndarray, "points columns"]) -> None:
        """Keeps what was found at the points of block `number`, one row each: the metrics in SI, then the failure."""

    @abc.abstractmethod
    def fail(self, number: int, reason: str) -> None:
        """Notes that block `number` could not be computed, and why."""

    def close(self) -> None:
        """Gives back what `open` has taken, such as a lock; what is kept stays."""
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

    def fail(self, number: int, reason: str) -> None:
        self._found[self._plan.place(number)] = blank(1, self._found.shape[1])

    def read(self) -> Float[np.ndarray, "points columns"]:
        return self._found


def columns_of(document: Document) -> int:
    """Columns of what the job `document` finds at a point: its metrics, then the failure."""
    return len(document["metrics"]) + 1


def blank(points: int, columns: int) -> Float[np.ndarray, "points columns"]:
    """What is found at points that were not computed."""
    found = np.full((points, columns), np.nan)
    found[:, -1] = NOT_COMPUTED
    return found
