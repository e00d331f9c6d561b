"""The range of a slider: its ends, whether it goes by equal ratios, and where on it a number lies."""

import math
from typing import NamedTuple

from ..core import Quantity

POSITIONS = 1000
"""Steps of a slider from one end to the other; an arrow key moves it by one."""

DECADES = 10.0
"""Factor either way that a slider of a positive number covers, where nothing bounds it."""

_SPANS = {"s": 2e-3, "N": 1.0, "rad": 0.1, "m": 1e-5, "V": 100.0}
"""What a slider covers of a number that is zero, by its unit."""


class SliderRange(NamedTuple):
    """From the left end of a slider to the right, in SI."""

    low: float
    high: float
    logarithmic: bool

    def position(self, number: float) -> int:
        """Where `number` [SI] lies, 0 to `POSITIONS`; the nearest end for one outside."""
        low, high, at = (math.log(x) if self.logarithmic else x for x in (self.low, self.high, self._within(number)))
        return round(POSITIONS * (at - low) / (high - low))

    def number(self, position: int) -> float:
        """The number [SI] at a `position`, rounded to what a step can tell."""
        part = position / POSITIONS
        if self.logarithmic:
            return self._within(float(f"{self.low * (self.high / self.low) ** part:.4g}"))
        step = (self.high - self.low) / POSITIONS
        return round((self.low + part * (self.high - self.low)) / step) * step if step else self.low

    def widened(self, number: float, quantity: Quantity) -> "SliderRange":
        """The range with `number` [SI] inside it, well away from its ends where it was not, but legal."""
        if self.low <= number <= self.high:
            return self
        ends = (
            (number / 3.0, number * 3.0) if self.logarithmic else (number - abs(number) / 2, number + abs(number) / 2)
        )
        legal = max(ends[0], quantity.low), min(ends[1], max(number, _below(quantity.high)))
        return self._replace(low=min(self.low, legal[0]), high=max(self.high, legal[1]))

    def _within(self, number: float) -> float:
        return min(max(number, self.low), self.high)


def slider_range(quantity: Quantity, number: float, low: float | None = None, high: float | None = None) -> SliderRange:
    """The range of a slider that starts at `number` [SI]; its bounds `low` and `high` are those of a study, if any.

    Positive quantities go by equal ratios, a factor `DECADES` either way where nothing bounds them; others linearly,
    to twice the number.
    """
    if quantity.positive:
        ends = (number / DECADES if low is None else low), (number * DECADES if high is None else high)
        lowest = ends[0] if ends[0] > 0 else number / DECADES**2
        return SliderRange(lowest, min(ends[1], max(number, _below(quantity.high))), True)
    span = 2.0 * abs(number) or _SPANS.get(quantity.unit, 1.0)
    begin = (0.0 if number > 0 else -span) if low is None else low
    end = (0.0 if number < 0 else span) if high is None else high
    return SliderRange(max(begin, quantity.low), min(end, _below(quantity.high)), False)


def _below(high: float) -> float:
    """The largest legal number under an end that is not legal itself."""
    return high * (1.0 - 1e-6) if math.isfinite(high) else high
