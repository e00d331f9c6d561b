"""The rises and falls of a voltage: when they come, how long they take, and their period."""

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from ..core import equal_by_value
from .sensor_samples import Samples


@equal_by_value
@dataclasses.dataclass(frozen=True)
class VoltageFlanks:
    """Passages of a voltage between the lowest and the highest quarter of its range."""

    rises: Samples
    """Times of the middles of rises [s]."""
    falls: Samples
    rise: float
    """Median duration of a rise over the whole range, taken as straight [s]; NaN without any."""
    fall: float
    extent: float
    """Range of the voltage, noise included, to which durations of flanks refer [V]."""


def extremes_of(volts: Samples) -> tuple[float, float]:
    """Lowest and highest voltage [V], a few samples in a thousand left out."""
    low, high = np.percentile(volts, [0.2, 99.8])
    return float(low), float(high)


def voltage_flanks(time: Samples, volts: Samples, low: float, high: float) -> VoltageFlanks:
    """The passages of a voltage between its extremes [V]."""
    level = (volts - low) / ((high - low) or 1.0)
    side = np.where(level > 0.75, 1, np.where(level < 0.25, 0, -1))
    known = np.flatnonzero(side >= 0)
    passes = np.flatnonzero(np.diff(side[known]) != 0)
    middles: dict[int, list[float]] = {0: [], 1: []}
    lengths: dict[int, list[float]] = {0: [], 1: []}
    for index in passes:
        first, last = known[index], known[index + 1]
        way = int(level[last] > level[first])
        middle, length = _passage(time[first : last + 1], level[first : last + 1])
        middles[way].append(middle)
        lengths[way].append(length)
    usual = lambda values: float(np.median(values)) if values else math.nan
    return VoltageFlanks(np.array(middles[1]), np.array(middles[0]), usual(lengths[1]), usual(lengths[0]), high - low)


def _passage(time: Samples, level: Samples) -> tuple[float, float]:
    """Middle of a passage from one quarter to the other, and the duration of one over the whole range [s]."""
    if time.size < 5:
        ordered = np.maximum.accumulate(level if level[-1] > level[0] else 1.0 - level)
        early, middle, late = (float(np.interp(share, ordered, time)) for share in (0.25, 0.5, 0.75))
        return middle, 2.0 * (late - early)
    inner = slice(1, -1)
    slope, at_middle = np.polyfit(time[inner] - time.mean(), level[inner], 1)
    return float(time.mean() + (0.5 - at_middle) / slope), float(abs(1.0 / slope))


def period_of(flanks: VoltageFlanks) -> float | None:
    """Period [s] by a line through the middles of the slower flanks; None where they are too few or uneven."""
    slower, other = flanks.rises, flanks.falls
    if not flanks.rise > flanks.fall:
        slower, other = other, slower
    middles = slower if len(slower) >= 2 else other
    if len(middles) < 2:
        return None
    steps = np.diff(middles)
    if len(steps) > 1 and np.ptp(steps) > 0.1 * np.median(steps):
        return None
    return float(np.polyfit(np.arange(len(middles)), middles, 1)[0])


class FastFlanks(NamedTuple):
    """Fast flanks of a voltage whose cycles are a slow and a fast flank."""

    fall: bool
    """Whether the fast flanks fall, as for a walk forward."""
    duration: float
    """Duration of a fast flank [s]."""
    middles: Samples
    """[s]"""
    period: float
    """Period by the fast flanks, where there are two [s]."""


def fast_flanks(flanks: VoltageFlanks) -> FastFlanks | None:
    """The fast flanks of a voltage; None where both flanks take about as long, or tell no period."""
    period = period_of(flanks)
    if period is None or not min(flanks.rise, flanks.fall) < 0.3 * max(flanks.rise, flanks.fall):
        return None
    fall = flanks.fall < flanks.rise
    middles = flanks.falls if fall else flanks.rises
    if len(middles) >= 2:
        period = float(np.polyfit(np.arange(len(middles)), middles, 1)[0])
    return FastFlanks(fall, flanks.fall if fall else flanks.rise, middles, period)


def frequency_of(time: Samples, volts: Samples) -> float | None:
    """Cycles a second of a voltage of any shape [Hz], by its flanks; None where they do not repeat."""
    elapsed = time - time[0]
    period = period_of(voltage_flanks(elapsed, volts, *extremes_of(volts)))
    return 1.0 / period if period is not None and period > 0 else None
