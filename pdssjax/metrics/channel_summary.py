"""What a channel of a file amounts to: how many samples, over what range, and whether it may be a clock."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass
class ChannelSummary:
    """One channel, told block by block; numbers are in its own `unit`."""

    number: int
    """In the file, from 1."""
    name: str
    unit: str
    """As the file says it; "" where it does not."""
    interval: float | None = None
    """Of the clock that the file keeps for it [s]; None where there is none."""
    samples: int = 0
    missing: int = 0
    """Samples that are no numbers."""
    low: float = math.inf
    """The least of its numbers."""
    high: float = -math.inf
    """The greatest of them."""
    increases: bool = True
    """Each sample is above the one before: it may be a clock."""
    first: float = math.nan
    last: float = math.nan

    def add(self, values: Float[np.ndarray, " samples"]) -> None:
        """The next samples."""
        numbers = values[np.isfinite(values)]
        self.samples += values.size
        self.missing += values.size - numbers.size
        if not numbers.size:
            return
        joined = numbers if math.isnan(self.last) else np.append(self.last, numbers)
        self.increases &= bool(np.all(np.diff(joined) > 0))
        self.first = float(numbers[0]) if math.isnan(self.first) else self.first
        self.last = float(numbers[-1])
        self.low, self.high = min(self.low, float(numbers.min())), max(self.high, float(numbers.max()))

    @property
    def step(self) -> float | None:
        """Mean step of a channel that may be a clock, in its `unit`; None of any other."""
        counted = self.samples - self.missing
        return (self.last - self.first) / (counted - 1) if self.increases and counted > 2 else None
