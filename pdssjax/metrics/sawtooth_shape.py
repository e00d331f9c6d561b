"""A sawtooth of straight flanks by its four numbers: samples, the line of its slow flanks, and the derivatives of both.

The numbers are U, to which a slow flank would come in a whole period [V], the period, the begin of a fast flank and its
duration [s].
"""

import numpy as np
from jaxtyping import Float

from .voltage_flanks import Samples


def levels_of(time: Samples, forward: bool, whole_rise: float, period: float, start: float, duration: float) -> Samples:
    """Peak to 0 V within `duration` and back, towards `whole_rise` [V], over the rest of a period; not `forward`: the
    other way."""
    passed = np.mod(time - start, period)
    fallen = np.where(passed < duration, passed / duration, (period - passed) / (period - duration))
    return peak_of(whole_rise, period, duration) * (1.0 - fallen if forward else fallen)


def slopes_of_levels(
    time: Samples, forward: bool, whole_rise: float, period: float, start: float, duration: float
) -> Float[np.ndarray, "n 4"]:
    """The derivatives of `levels_of` by the numbers, beside its corners."""
    cycle = np.floor((time - start) / period)
    passed, slow = time - start - cycle * period, period - duration
    fast, left = passed < duration, (period - passed) / slow
    by_passed = np.where(fast, 1.0 / duration, -1.0 / slow)
    by_period = np.where(fast, 0.0, (1.0 - left) / slow) - cycle * by_passed
    by_duration = np.where(fast, -passed / duration**2, left / slow)
    by_flank = np.stack([np.zeros(time.size), by_period, -by_passed, by_duration], axis=1)
    fallen = np.where(fast, passed / duration, left)
    level, sign = (1.0 - fallen, -1.0) if forward else (fallen, 1.0)
    peak = _slopes_of_peak(whole_rise, period, duration)
    return level[:, None] * peak + sign * peak_of(whole_rise, period, duration) * by_flank


def line_of(numbers: Float[np.ndarray, "4"], forward: bool) -> Float[np.ndarray, "3"]:
    """(a, s, c) of its slow flanks u = a + s t - c n, n the number of the cycle."""
    whole_rise, period, start, duration = numbers
    slope = whole_rise / period
    foot = slope * (start + duration)
    peak = peak_of(whole_rise, period, duration)
    return np.array([-foot, slope, whole_rise] if forward else [peak + foot, -slope, -whole_rise])


def slopes_of_line(numbers: Float[np.ndarray, "4"], forward: bool) -> Float[np.ndarray, "3 4"]:
    """The derivatives of `line_of`."""
    whole_rise, period, start, duration = numbers
    slope, late = whole_rise / period, (start + duration) / period
    foot = np.array([late, -slope * late, slope, slope])
    of_slope, drop = np.array([1.0 / period, -slope / period, 0.0, 0.0]), np.array([1.0, 0.0, 0.0, 0.0])
    peak = _slopes_of_peak(whole_rise, period, duration)
    return np.stack([-foot, of_slope, drop] if forward else [peak + foot, -of_slope, -drop])


def peak_of(whole_rise: float, period: float, duration: float) -> float:
    """Of a sawtooth whose slow flank would come to `whole_rise` [V] in a period [s]."""
    return whole_rise * (1.0 - duration / period)


def _slopes_of_peak(whole_rise: float, period: float, duration: float) -> Float[np.ndarray, "4"]:
    """Its derivatives by whole rise, period, start and duration."""
    return np.array([1.0 - duration / period, whole_rise * duration / period**2, 0.0, -whole_rise / period])
