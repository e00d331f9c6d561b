"""When the fast flanks of a step or a sawtooth begin and how long they last, from the few samples that lie on them.

A voltage V and a start that come from a sawtooth's slow flanks alone are wrong by what is wrong in the fall time tf: by
V = s (T - tf), s the slope, and by tf.  One sample on each fast flank tells tf far below the sampling interval.  So the
voltage that is looked for is U = s T, to which a slow flank would come in a whole period.  The numbers of a sawtooth
here are U [V], the period T, the begin of a fast flank and its duration tf [s].

Which samples lie on a flank depends on where it is: several flanks may explain the same samples equally well, each
within nanoseconds.  So they are looked for from many starts, and the errors hold all that are found.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float

from .sensor_samples import scatter_between_corners
from .voltage_flanks import Samples

_FIRST_DURATIONS = (0.3, 0.8, 1.3, 1.8, 2.4)
"""Starts of the search for the duration of a fast flank, in sampling intervals."""

_RANDOM_STARTS = 60
"""Number of further random starts of the least squares."""

_CORNER_SHARE = 0.05
"""Fraction of a fast flank at either end where a sample does not count as on it."""

_LOCATED = 0.5
"""Standard error of start and duration, in sampling intervals, above which samples on a flank do not locate it."""

_LARGEST_MISFIT = 1.5
"""Largest rms residual of straight flanks, in standard deviations of the voltage's noise."""

_HUM = 5e-3
"""Largest residual of slow flanks that counts as noise, as a fraction of the voltage: hum matters far more to one
sample on a fast flank than to where that flank begins."""

_NEAR_FLANK = 0.25
"""Distance from a fast flank, as a fraction of the period, beyond which samples determine the slow flank."""

_AVERAGED_EXCESS = 12.0
"""Largest excess of chi-square of a minimum that is averaged with the best, each weighted by its likelihood."""

_ROUNDING_EXCESS = 9.0
"""Largest excess of chi-square of a frequency rounded to `_FREQUENCY_DIGITS`, as generators are set."""

_FREQUENCY_DIGITS = 3
"""Significant digits of a rounded frequency."""


class SharpFlanks(NamedTuple):
    """A step or a sawtooth with straight flanks, by least squares, with standard errors."""

    voltage: float
    """[V]"""
    period: float
    """Period of a sawtooth [s]; infinite for a step."""
    start: float
    """Begin of a fast flank [s]."""
    duration: float
    """Duration of a fast flank [s]."""
    start_error: float
    """[s]"""
    duration_error: float
    """[s]"""
    voltage_error: float
    """Standard error [V]; for a sawtooth, of the voltage to which its slow flank would come in a whole period."""


class _Fitted(NamedTuple):
    numbers: Float[np.ndarray, " p"]
    errors: Float[np.ndarray, " p"]
    least: float
    """Chi-square at the best minimum."""


Residuals: TypeAlias = Callable[[np.ndarray], Samples]
"""Residuals as a function of the numbers, in standard deviations of the noise."""


def sharpened_sawtooth(
    time: Samples, volts: Samples, forward: bool, about: tuple[float, float, float], seen: float, interval: float
) -> SharpFlanks | None:
    """The periodic sawtooth of least squares near `about`, all flanks straight, the fast ones included.

    **Arguments:** `volts` [V] at `time` [s], `interval` [s] apart; `about` holds voltage [V], period and begin of a
    fast flank [s], `seen` is its duration as two levels tell it.  **Returns:** None where too few samples
    lie on fast flanks, where several flanks explain them that differ by more than half an interval, or where straight
    flanks do not explain the voltage within its noise.  Where the samples allow it, a frequency of three digits is
    taken.
    """
    voltage, period, start = about
    turn = np.mod((time - start) / period + 0.5, 1.0) - 0.5
    near = np.abs(turn) * period < min(2.0 * max(seen, interval) + 4.0 * interval, _NEAR_FLANK * period)
    noise = max(scatter_between_corners(volts), 1e-6 * voltage)
    slow = _slow_flanks(time[~near], volts[~near], start, period, noise, _HUM * voltage)
    if slow is None:
        return None
    line, triangle, noise = slow

    def residuals(numbers: np.ndarray) -> Samples:
        shown = levels_of(time[near], forward, *numbers)
        return np.append((shown - volts[near]) / noise, triangle @ (line_of(numbers, forward) - line))

    def jacobian(numbers: np.ndarray) -> Float[np.ndarray, "n 4"]:
        of_samples = slopes_of_levels(time[near], forward, *numbers) / noise
        return np.concatenate([of_samples, triangle @ slopes_of_line(numbers, forward)])

    firsts = _starts(line, triangle, forward, seen, interval)
    low = np.array([0.5 * voltage, 0.9 * period, -np.inf, 1e-3 * interval])
    high = np.array([2.0 * voltage, 1.1 * period, np.inf, 0.5 * period])
    scale = np.array([voltage, period / time.size, interval, interval])
    found = _least_squares(residuals, firsts, low, high, scale, jacobian)
    # With the period that a generator may have been set to.
    period = 1.0 / float(f"{1.0 / found.numbers[1]:.{_FREQUENCY_DIGITS}g}")
    whole = lambda numbers: np.insert(numbers, 1, period)
    others = [np.delete(values, 1, axis=-1) for values in (firsts, low, high, scale)]
    by_others = lambda numbers: np.delete(jacobian(whole(numbers)), 1, axis=1)
    held = _least_squares(lambda numbers: residuals(whole(numbers)), *others, jacobian=by_others)
    if held.least < found.least + _ROUNDING_EXCESS:
        numbers = whole(held.numbers)
        # Another period may explain the samples as well, with other flanks.
        found = _Fitted(numbers, np.hypot(found.errors, numbers - found.numbers), held.least)
    whole_rise, period, start, duration = (float(number) for number in found.numbers)
    voltage = peak_of(whole_rise, period, duration)
    flanks = round((time[-1] - time[0]) / period)
    told = max(found.errors[2:]) < _LOCATED * interval and _explains(found, int(np.count_nonzero(near)), noise, voltage)
    if not told or _count_on_flank(np.mod(time - start, period) / duration) < max(1, flanks // 4):
        return None
    of_voltage, _, of_start, of_duration = (float(error) for error in found.errors)
    return SharpFlanks(voltage, period, start, duration, of_start, of_duration, of_voltage)


def sharpened_step(
    time: Samples, volts: Samples, about: tuple[float, float, float], interval: float
) -> SharpFlanks | None:
    """The step of least squares near `about`, which holds voltage [V], begin and duration [s] of the rise."""
    voltage, start, rise = about
    middle = start + 0.5 * rise
    durations = (rise, *(share * interval for share in _FIRST_DURATIONS))
    shifts = (-0.3, 0.0, 0.3)
    firsts = [[voltage, middle - 0.5 * long + shift * interval, long] for long in durations for shift in shifts]
    low, high = np.array([0.5 * voltage, -np.inf, 1e-3 * interval]), np.array([2.0 * voltage, np.inf, np.inf])
    noise = max(scatter_between_corners(volts), 1e-6 * abs(voltage))
    shape = lambda numbers: numbers[0] * np.clip((time - numbers[1]) / numbers[2], 0.0, 1.0)
    scale = np.array([voltage, interval, interval])
    found = _least_squares(lambda numbers: (shape(numbers) - volts) / noise, np.array(firsts), low, high, scale)
    voltage, start, duration = (float(number) for number in found.numbers)
    if not _explains(found, time.size, noise, voltage):
        return None
    if max(found.errors[1:]) > _LOCATED * interval or not _count_on_flank((time - start) / duration):
        return None
    of_voltage, of_start, of_duration = (float(error) for error in found.errors)
    return SharpFlanks(voltage, math.inf, start, duration, of_start, of_duration, of_voltage)


def _slow_flanks(
    time: Samples, volts: Samples, start: float, period: float, noise: float, hum: float
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 3"], float] | None:
    """Fit slow flanks u = a + s t - c n, n the cycle: (a, s, c), the root of their information, and the noise.

    The `noise` [V] grows to what they leave, up to the `hum` [V] that neighbouring samples do not show.  None where
    they do not tell them.
    """
    design = np.stack([np.ones(time.size), time, -np.floor((time - start) / period)], axis=1)
    if np.linalg.matrix_rank(design) < 3:
        return None
    orthogonal, triangle = np.linalg.qr(design)
    line = np.linalg.solve(triangle, orthogonal.T @ volts)
    left = float(np.linalg.norm(volts - design @ line)) / math.sqrt(max(volts.size - 3, 1))
    noise = max(noise, min(left, hum))
    return line, triangle / noise, noise


def _numbers_of(line: np.ndarray, duration: float, forward: bool) -> list[float]:
    """Numbers of the sawtooth with slow flanks on a `line` and fast flanks of a `duration` [s]."""
    a, slope, drop = line
    period = drop / slope
    whole_rise = abs(drop)
    peak = peak_of(whole_rise, period, duration)
    return [whole_rise, period, (-a / slope if forward else (peak - a) / slope) - duration, duration]


def _starts(
    line: Float[np.ndarray, "3"], triangle: Float[np.ndarray, "3 3"], forward: bool, seen: float, interval: float
) -> Float[np.ndarray, "starts 4"]:
    """Starts of the least squares: durations near the one `seen` [s], and random durations and slow flanks."""
    random = np.random.default_rng(0)
    durations = [seen, *(share * interval for share in _FIRST_DURATIONS)]
    lines = line + np.linalg.solve(triangle, 1.5 * random.standard_normal((3, _RANDOM_STARTS))).T
    drawn = random.uniform(0.05, 1.2 * max(seen / interval, _FIRST_DURATIONS[-1]), _RANDOM_STARTS) * interval
    pairs = [*((line, duration) for duration in durations), *zip(lines, drawn, strict=True)]
    return np.array([_numbers_of(slow, duration, forward) for slow, duration in pairs])


def _least_squares(
    residuals: Residuals,
    firsts: Float[np.ndarray, "starts p"],
    low: Float[np.ndarray, " p"],
    high: Float[np.ndarray, " p"],
    scale: Float[np.ndarray, " p"],
    jacobian: Callable[[np.ndarray], Float[np.ndarray, "n p"]] | None = None,
) -> _Fitted:
    """Average all minima that explain the samples as well as the best one; the errors cover their spread."""
    from scipy.optimize import least_squares

    # Of SciPy's methods with bounds the one that does less beside the residuals, which are few.
    settings: dict[str, Any] = {"bounds": (low, high), "x_scale": scale, "max_nfev": 60, "method": "dogbox"}
    settings |= {} if jacobian is None else {"jac": jacobian}
    solve = lambda first: least_squares(residuals, first, **settings)
    ends = [solve(np.clip(first, low, high)) for first in firsts]
    ends.sort(key=lambda end: end.cost)
    least = 2.0 * ends[0].cost
    minima: list[tuple[float, np.ndarray, np.ndarray]] = []
    for end in ends:
        above, errors = 2.0 * end.cost - least, _errors(end.jac)
        if above > _AVERAGED_EXCESS:
            break
        if not any(np.all(np.abs(end.x - other) <= errors) for _, other, errors in minima):
            minima.append((above, end.x, errors))
    weights = np.exp([-0.5 * above for above, *_ in minima])
    weights /= weights.sum()
    numbers = np.sum([w * x for w, (_, x, _) in zip(weights, minima, strict=True)], axis=0)
    squares = [w * (errors**2 + (x - numbers) ** 2) for w, (_, x, errors) in zip(weights, minima, strict=True)]
    return _Fitted(numbers, np.sqrt(np.sum(squares, axis=0)), least)


def _explains(found: _Fitted, samples: int, noise: float, voltage: float) -> bool:
    """Whether straight flanks explain the samples to within their noise."""
    left = math.sqrt(found.least / max(samples - found.numbers.size, 1))
    return left * noise < _LARGEST_MISFIT * noise + 2e-4 * abs(voltage)


def _count_on_flank(passed: Samples) -> int:
    """Count the samples on a flank, given the fraction of the flank that has passed at each."""
    return int(np.count_nonzero((passed > _CORNER_SHARE) & (passed < 1.0 - _CORNER_SHARE)))


def _errors(jacobian: Float[np.ndarray, "n p"]) -> Float[np.ndarray, " p"]:
    """Standard errors of the numbers of a least-squares fit; infinite where they are not determined."""
    size = np.linalg.norm(jacobian, axis=0)
    if np.any(size == 0.0):
        return np.full(size.size, math.inf)
    triangle = np.asarray(np.linalg.qr(jacobian / size, mode="r"))
    if np.min(np.abs(np.diag(triangle))) < 1e-10:
        return np.full(size.size, math.inf)
    return np.linalg.norm(np.linalg.inv(triangle), axis=1) / size


def levels_of(time: Samples, forward: bool, whole_rise: float, period: float, start: float, duration: float) -> Samples:
    """Voltage of a sawtooth: from its peak to 0 V within `duration` [s], then back over the rest of a period.

    Not `forward`, the other way.  The slow flank would reach `whole_rise` [V] in a whole period.
    """
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
    """Coefficients (a, s, c) of the slow flanks u = a + s t - c n, n the number of the cycle."""
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
    """Peak [V] of a sawtooth whose slow flank would reach `whole_rise` [V] in a whole period [s]."""
    return whole_rise * (1.0 - duration / period)


def _slopes_of_peak(whole_rise: float, period: float, duration: float) -> Float[np.ndarray, "4"]:
    """The derivatives of `peak_of` by whole rise, period, start and duration."""
    return np.array([1.0 - duration / period, whole_rise * duration / period**2, 0.0, -whole_rise / period])


JUMP = 1.6
"""Sampling intervals up to which a flank cannot be told from a jump."""

_SURE = 5.0
"""Standard errors within which what least squares tell of a flank is taken to lie."""


class Timing(NamedTuple):
    """Range of the duration of fast flanks and of the drive's start, by the samples of the voltage."""

    shortest: float
    """Duration that such a flank may have [s]."""
    longest: float
    """The same."""
    within: float
    """Time by which the drive may start earlier or later [s]."""
    errors: tuple[float, float] | None = None
    """Standard errors of duration and start [s] where samples on flanks locate them; None where only bounds are known.
    """


def timing_of(sharp: SharpFlanks | None, seen: float, interval: float) -> Timing:
    """Timing of located fast flanks; else of those `seen` [s] long between two levels, 0 where no sample is."""
    if sharp is None and seen:
        # Two levels with few samples between tell too long a flank.
        return Timing(max(0.5 * seen - interval, 0.0), 1.5 * seen + interval, 0.5 * seen + interval)
    if sharp is None:
        return Timing(0.0, JUMP * interval, 2.0 * interval)
    about, within = _SURE * sharp.duration_error, _SURE * sharp.start_error
    errors = sharp.duration_error, sharp.start_error
    return Timing(max(sharp.duration - about, 0.0), sharp.duration + about, within, errors)


def widened(timing: Timing, error: float) -> Timing:
    """Widen a `timing` by an additional `error` [s] of the flanks."""
    shortest, longest, within, errors = timing
    about = _SURE * error
    both = None if errors is None else (math.hypot(errors[0], error), math.hypot(errors[1], error))
    return Timing(max(shortest - about, 0.0), longest + about, within + about, both)
