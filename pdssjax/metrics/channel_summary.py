"""Summary of a channel of a file: number of samples, range, and whether it may be a clock."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

_UNEVEN = 0.1
"""Part of its mean step by which the steps of a clock may differ."""

_RISES = 0.1
"""Part of its range that a clock with too few digits goes on at once."""


@dataclass
class ChannelSummary:
    """Summary of one channel, built block by block; numbers are in its own `unit`."""

    number: int
    """In the file, from 1."""
    name: str
    unit: str
    """As the file says it; "" where it does not."""
    interval: float | None = None
    """Of the clock that the file keeps for it [s]; None where there is none."""
    symbol: bool = False
    """Its unit is but its name of one letter, which may be the symbol of something else."""
    samples: int = 0
    missing: int = 0
    """Samples that are no numbers."""
    low: float = math.inf
    """The least of its numbers."""
    high: float = -math.inf
    """The greatest of them."""
    increases: bool = True
    """Each sample is above the one before: it may be a clock."""
    repeats: bool = False
    """Some sample is the one before: a clock, where no sample is below, that has too few digits."""
    falls: bool = False
    """Some sample is below the one before."""
    shortest: float = math.inf
    """The least step from one sample to the next, where there are several."""
    longest: float = -math.inf
    """The greatest of them."""
    first: float = math.nan
    last: float = math.nan

    def add(self, values: Float[np.ndarray, " samples"]) -> None:
        """Add the next samples."""
        numbers = values[np.isfinite(values)]
        self.samples += values.size
        self.missing += values.size - numbers.size
        if not numbers.size:
            return
        joined = numbers if math.isnan(self.last) else np.append(self.last, numbers)
        steps = np.diff(joined)
        self.increases &= bool(np.all(steps > 0))
        self.repeats |= bool(np.any(steps == 0))
        self.falls |= bool(np.any(steps < 0))
        self.shortest = min(self.shortest, float(np.min(steps, initial=math.inf)))
        self.longest = max(self.longest, float(np.max(steps, initial=-math.inf)))
        self.first = float(numbers[0]) if math.isnan(self.first) else self.first
        self.last = float(numbers[-1])
        self.low, self.high = min(self.low, float(numbers.min())), max(self.high, float(numbers.max()))

    @property
    def step(self) -> float | None:
        """Mean step of a channel that may be a clock, in its `unit`; None of any other."""
        counted = self.samples - self.missing
        return (self.last - self.first) / (counted - 1) if self.increases and counted > 2 else None

    @property
    def uneven(self) -> bool:
        """Whether a channel that may be a clock has steps that differ by more than a tenth of their mean."""
        return self.step is not None and self.longest - self.shortest > _UNEVEN * self.step

    @property
    def coarse(self) -> bool:
        """Whether a channel would be a clock, had it more digits: it never falls, and shows few times twice."""
        rises = not self.falls and self.repeats and self.high > self.low
        return rises and self.longest < _RISES * (self.high - self.low)
