"""Summary of a channel of a file: number of samples, range, and whether it may be a clock."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass
class ChannelSummary:
    """Summary of one channel, built block by block; numbers are in its own `unit`."""

    number: int
    """Position in the file, from 1."""
    name: str
    unit: str
    """Unit as the file gives it; "" where it gives none."""
    interval: float | None = None
    """Sampling interval that the file gives for the channel [s]; None where there is none."""
    symbol: bool = False
    """The unit was taken from a name of one letter, which may be the symbol of something else."""
    samples: int = 0
    missing: int = 0
    """Number of samples that are no finite numbers."""
    low: float = math.inf
    """Smallest value."""
    high: float = -math.inf
    """Largest value."""
    increases: bool = True
    """Whether each sample is above the one before, as of a clock."""
    repeats: bool = False
    """Whether a sample equals the one before, as of a clock with too few digits."""
    falls: bool = False
    """Whether a sample is below the one before."""
    shortest: float = math.inf
    """Smallest step from one sample to the next; infinite for fewer than two samples."""
    longest: float = -math.inf
    """Largest step from one sample to the next."""
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
        """Mean step of a channel that may be a clock, in its `unit`; None for others."""
        counted = self.samples - self.missing
        return (self.last - self.first) / (counted - 1) if self.increases and counted > 2 else None

    @property
    def uneven(self) -> bool:
        """Whether a channel that may be a clock has steps that differ by more than a tenth of their mean."""
        return self.step is not None and self.longest - self.shortest > 0.1 * self.step

    @property
    def coarse(self) -> bool:
        """Whether a channel may be a clock with too few digits: it never falls, and its steps are small."""
        rises = not self.falls and self.repeats and self.high > self.low
        return rises and self.longest < 0.1 * (self.high - self.low)
