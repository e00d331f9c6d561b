"""What a sweep will take, from a few of its blocks: seconds, before it is run."""

import dataclasses
import time

import numpy as np

from .device_mesh import default_workers
from .execution import computed_block
from .sweeping import PlannedSweep

_TIMED = (0.1, 0.3, 0.5, 0.7, 0.9)
"""Where in the plan the blocks are that are timed: its ends differ, since like points stand together."""


@dataclasses.dataclass(frozen=True)
class Forecast:
    """What a sweep is made of, and how long it takes."""

    points: int
    skipped: int
    """Points whose drive contradicts itself; they are not computed."""
    blocks: int
    lanes: int
    """Points in a block."""
    workers: int
    compile_seconds: float
    """What the first block took beyond another [s]."""
    block_seconds: float
    """A block in the mean, alone on a core [s]."""

    @property
    def seconds(self) -> float:
        """Of the whole sweep [s], if every worker has a core of its own."""
        rounds = -(-self.blocks // self.workers)
        return self.compile_seconds + rounds * self.block_seconds


def forecast(planned: PlannedSweep, workers: int | None = None) -> Forecast:
    """Times a few blocks of a `planned` sweep, and what compiles them, for `workers`, one a core by default."""
    plan, workers = planned.plan, workers or default_workers()
    numbers = sorted({int(part * plan.blocks) for part in _TIMED}) if plan.blocks else []
    seconds = [_seconds(planned, number) for number in [*numbers[:1], *numbers]]
    first, others = (seconds[0], seconds[1:]) if seconds else (0.0, [0.0])
    mean = float(np.mean(others))
    skipped = len(planned.points) - len(plan.order)
    return Forecast(len(planned.points), skipped, plan.blocks, plan.lanes, workers, max(first - mean, 0.0), mean)


def _seconds(planned: PlannedSweep, number: int) -> float:
    begun = time.perf_counter()
    computed_block(planned.function, planned.plan.block(number))
    return time.perf_counter() - begun
