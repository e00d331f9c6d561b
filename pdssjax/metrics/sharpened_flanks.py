"""When the fast flanks of a step or a sawtooth begin and how long they last, from the few samples that lie on them.

Slow flanks of slope s alone give a sawtooth's voltage V = s (T - tf) and start only up to the fall time tf.  One sample
on each fast flank determines tf far below the sampling interval.  The numbers of a sawtooth here are U = s T [V], which
a slow flank would reach in a whole period, the period T, and begin and duration tf of a fast flank [s].

Several flanks, each known within nanoseconds, may explain the same samples equally well.  So the search begins from
many starts, and the errors cover all minima found.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from .sensor_samples import scatter_between_corners
from .voltage_flanks import Samples

_FIRST_DURATIONS = (0.3, 0.8, 1.3, 1.8, 2.4)
"""Starts of the search for the duration of a fast flank, in sampling intervals."""

_RANDOM_STARTS = 60
"""Number of further random starts of the least squares."""

_MOST_STEPS = 60
"""Linearisations from each start at most; most starts take ten."""

_SMALLEST_GAIN = 1e-10
"""Gain of chi-square, as a fraction of it, below which a search has ended."""

_MOST_AT_ONCE = 200_000
"""Residuals of all starts that are evaluated together, which bounds the memory that long records take."""

_CORNER_SHARE = 0.05
"""Fraction of a fast flank at either end where a sample does not count as on it."""

_LOCATED = 0.5
"""Standard error of start and duration, in sampling intervals, above which samples on a flank do not locate it."""

_HUM = 5e-3
"""Largest residual of slow flanks that counts as noise, as a fraction of the voltage: hum matters far more to one
sample on a fast flank than to where that flank begins."""

_AVERAGED_EXCESS = 12.0
"""Largest excess of chi-square of a minimum that is averaged with the best, each weighted by its likelihood."""

_FREQUENCY_DIGITS = 3
"""Significant digits of a rounded frequency."""


class SharpFlanks(NamedTuple):
    """A step or a sawtooth with straight flanks [V, s], by least squares, with standard errors."""

    voltage: float
    period: float
    """Period of a sawtooth; infinite for a step."""
    start: float
    """Begin of a fast flank."""
    duration: float
    """Duration of a fast flank."""
    start_error: float
    duration_error: float
    voltage_error: float
    """Standard error [V]; for a sawtooth, of the voltage to which its slow flank would come in a whole period."""


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
    near = np.abs(turn) * period < min(2.0 * max(seen, interval) + 4.0 * interval, 0.25 * period)
    noise = max(scatter_between_corners(volts), 1e-6 * voltage)
    # The slow flanks are u = a + s t - c n, n the cycle; `triangle` is the root of the information on (a, s, c).
    design = np.stack([np.ones(time.size), time, -np.floor((time - start) / period)], axis=1)[~near]
    if np.linalg.matrix_rank(design) < 3:
        return None
    orthogonal, triangle = np.linalg.qr(design)
    line = np.linalg.solve(triangle, orthogonal.T @ volts[~near])
    left = float(np.linalg.norm(volts[~near] - design @ line)) / math.sqrt(max(len(design) - 3, 1))
    noise = max(noise, min(left, _HUM * voltage))
    triangle = triangle / noise

    def residuals(numbers: Float[np.ndarray, "starts 4"]) -> Float[np.ndarray, "starts n"]:
        of_samples = (levels_of(time[near], forward, numbers) - volts[near]) / noise
        return np.concatenate([of_samples, (line_of(numbers, forward) - line) @ triangle.T], axis=-1)

    def jacobian(numbers: Float[np.ndarray, "starts 4"]) -> Float[np.ndarray, "starts n 4"]:
        of_samples = slopes_of_levels(time[near], forward, numbers) / noise
        return np.concatenate([of_samples, triangle @ slopes_of_line(numbers, forward)], axis=-2)

    # Durations near the one that was seen, then random durations with random slow flanks.
    random = np.random.default_rng(0)
    durations = np.array([seen, *(share * interval for share in _FIRST_DURATIONS)])
    lines = line + np.linalg.solve(triangle, 1.5 * random.standard_normal((3, _RANDOM_STARTS))).T
    drawn = random.uniform(0.05, 1.2 * max(seen / interval, _FIRST_DURATIONS[-1]), _RANDOM_STARTS) * interval
    firsts = np.concatenate([_numbers_of(line, durations, forward), _numbers_of(lines, drawn, forward)])
    low = np.array([0.5 * voltage, 0.9 * period, -np.inf, 1e-3 * interval])
    high = np.array([2.0 * voltage, 1.1 * period, np.inf, 0.5 * period])
    numbers, errors, least = _least_squares(residuals, jacobian, firsts, low, high)
    # With the period that a generator may have been set to.
    low[1] = high[1] = 1.0 / float(f"{1.0 / numbers[1]:.{_FREQUENCY_DIGITS}g}")
    held, _, least_held = _least_squares(residuals, jacobian, firsts, low, high)
    if least_held < least + 9.0:  # within three standard deviations
        # Another period may explain the samples as well, with other flanks.
        numbers, errors, least = held, np.hypot(errors, held - numbers), least_held
    whole_rise, period, start, duration = map(float, numbers)
    voltage = whole_rise * (1.0 - duration / period)
    flanks = round((time[-1] - time[0]) / period)
    if not max(errors[2:]) < _LOCATED * interval or not _explains(least, int(near.sum()) - 4, noise, voltage):
        return None
    if _count_on_flank(np.mod(time - start, period) / duration) < max(1, flanks // 4):
        return None
    of_voltage, _, of_start, of_duration = map(float, errors)
    return SharpFlanks(voltage, period, start, duration, of_start, of_duration, of_voltage)


def sharpened_step(
    time: Samples, volts: Samples, about: tuple[float, float, float], interval: float
) -> SharpFlanks | None:
    """The least-squares step near `about`: voltage [V], begin and duration [s] of the rise; None as for a sawtooth."""
    voltage, start, rise = about
    noise = max(scatter_between_corners(volts), 1e-6 * abs(voltage))

    def residuals(numbers: Float[np.ndarray, "starts 3"]) -> Float[np.ndarray, "starts n"]:
        height, start, rise = np.moveaxis(numbers[..., None], -2, 0)
        return (height * np.clip((time - start) / rise, 0.0, 1.0) - volts) / noise

    def jacobian(numbers: Float[np.ndarray, "starts 3"]) -> Float[np.ndarray, "starts n 3"]:
        height, start, rise = np.moveaxis(numbers[..., None], -2, 0)
        risen = (time - start) / rise
        steepness = np.where((risen > 0.0) & (risen < 1.0), height / rise, 0.0)
        return np.stack([np.clip(risen, 0.0, 1.0), -steepness, -steepness * risen], axis=-1) / noise

    durations = (rise, *(share * interval for share in _FIRST_DURATIONS))
    middles = (start + 0.5 * rise + shift * interval for shift in (-0.3, 0.0, 0.3))
    firsts = np.array([[voltage, middle - 0.5 * long, long] for middle in middles for long in durations])
    low, high = np.array([0.5 * voltage, -np.inf, 1e-3 * interval]), np.array([2.0 * voltage, np.inf, np.inf])
    numbers, errors, least = _least_squares(residuals, jacobian, firsts, low, high)
    voltage, start, duration = map(float, numbers)
    if not _explains(least, time.size - 3, noise, voltage):
        return None
    if max(errors[1:]) > _LOCATED * interval or not _count_on_flank((time - start) / duration):
        return None
    of_voltage, of_start, of_duration = map(float, errors)
    return SharpFlanks(voltage, math.inf, start, duration, of_start, of_duration, of_voltage)


def _least_squares(
    residuals: Callable[[np.ndarray], np.ndarray],
    jacobian: Callable[[np.ndarray], np.ndarray],
    firsts: Float[np.ndarray, "starts p"],
    low: Float[np.ndarray, " p"],
    high: Float[np.ndarray, " p"],
) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"], float]:
    """Average all minima that explain the samples as well as the best one.

    **Arguments:** residuals in standard deviations of the noise, and their derivatives, of all starts at once.  Where
    a bound in `low` equals that in `high` the number is held.

    **Returns:** the numbers, their standard errors, which cover the spread of these minima, and the least chi-square.
    """
    rows = residuals(firsts[:1]).size
    groups = np.array_split(firsts, -(-rows * len(firsts) // _MOST_AT_ONCE))
    ends, costs = map(np.concatenate, zip(*(_descend(residuals, jacobian, g, low, high) for g in groups), strict=True))
    least, free = float(np.min(costs)), low < high
    minima: list[tuple[float, np.ndarray, np.ndarray]] = []
    for place in np.argsort(costs, kind="stable"):
        above, numbers = float(costs[place]) - least, ends[place]
        if above > _AVERAGED_EXCESS:
            break
        if not any(np.all(np.abs(numbers - other) <= errors) for _, other, errors in minima):
            minima.append((above, numbers, _errors(jacobian(ends[place : place + 1])[0], free)))
    above, numbers, errors = map(np.array, zip(*minima, strict=True))
    weights = np.exp(-0.5 * above)[:, None] / np.sum(np.exp(-0.5 * above))
    mean = np.sum(weights * numbers, axis=0)
    return mean, np.sqrt(np.sum(weights * (errors**2 + (numbers - mean) ** 2), axis=0)), least


def _descend(
    residuals: Callable[[np.ndarray], np.ndarray],
    jacobian: Callable[[np.ndarray], np.ndarray],
    numbers: Float[np.ndarray, "starts p"],
    low: Float[np.ndarray, " p"],
    high: Float[np.ndarray, " p"],
) -> tuple[Float[np.ndarray, "starts p"], Float[np.ndarray, " starts"]]:
    """The minimum below each start within the bounds, and its chi-square, by the method of Levenberg and Marquardt."""
    numbers = np.clip(numbers, low, high)
    left = residuals(numbers)
    cost, damping, open_ones = np.sum(left**2, axis=1), np.full(len(numbers), 1e-3), np.arange(len(numbers))
    for _ in range(_MOST_STEPS):
        here, slopes = numbers[open_ones], jacobian(numbers[open_ones])
        gradient = np.einsum("snp,sn->sp", slopes, left[open_ones])
        # A number at a bound that would leave it stays.
        stays = ((here <= low) & (gradient >= 0.0)) | ((here >= high) & (gradient <= 0.0))
        size = np.where(stays, 0.0, np.linalg.norm(slopes, axis=1))
        scale = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0.0)
        scaled = slopes * scale[:, None]
        normal = scaled.transpose(0, 2, 1) @ scaled + damping[open_ones, None, None] * np.eye(low.size)
        step = -scale * np.linalg.solve(normal, (scale * gradient)[..., None])[..., 0]
        tried = np.clip(here + step, low, high)
        left_there = residuals(tried)
        lower = np.sum(left_there**2, axis=1)
        gain = cost[open_ones] - lower
        better = open_ones[gain > 0.0]
        numbers[better], left[better], cost[better] = (new[gain > 0.0] for new in (tried, left_there, lower))
        damping[open_ones] = np.maximum(damping[open_ones] * np.where(gain > 0.0, 0.1, 10.0), 1e-9)
        ended = ((gain >= 0.0) & (gain <= _SMALLEST_GAIN * lower)) | (damping[open_ones] > 1e8)
        open_ones = open_ones[~ended]
        if not open_ones.size:
            break
    return numbers, cost


def _errors(jacobian: Float[np.ndarray, "n p"], free: Bool[np.ndarray, " p"]) -> Float[np.ndarray, " p"]:
    """Standard errors of the `free` numbers of a least-squares fit; infinite where they are not determined."""
    size = np.linalg.norm(jacobian[:, free], axis=0)
    triangle = np.linalg.qr(jacobian[:, free] / np.where(size > 0.0, size, 1.0), mode="r")
    errors = np.where(free, math.inf, 0.0)
    if np.min(np.abs(np.diag(triangle))) > 1e-10:
        errors[free] = np.linalg.norm(np.linalg.inv(triangle), axis=1) / size
    return errors


def _explains(least: float, freedom: int, noise: float, voltage: float) -> bool:
    """Whether straight flanks explain the samples to within their noise."""
    return math.sqrt(least / max(freedom, 1)) * noise < 1.5 * noise + 2e-4 * abs(voltage)


def _count_on_flank(passed: Samples) -> int:
    """Count the samples on a flank, given the fraction of the flank that has passed at each."""
    return int(np.count_nonzero((passed > _CORNER_SHARE) & (passed < 1.0 - _CORNER_SHARE)))


# The numbers of sawtooths, shape (..., 4): U, T, begin and duration of a fast flank.


def levels_of(time: Samples, forward: bool, numbers: Float[np.ndarray, "... 4"]) -> Float[np.ndarray, "... n"]:
    """Voltage of sawtooths: from the peak to 0 V within a duration, then back over the rest of a period.

    Not `forward`, the other way.
    """
    whole_rise, period, start, duration = np.moveaxis(numbers[..., None], -2, 0)
    passed = np.mod(time - start, period)
    fallen = np.where(passed < duration, passed / duration, (period - passed) / (period - duration))
    return whole_rise * (1.0 - duration / period) * (1.0 - fallen if forward else fallen)


def slopes_of_levels(time: Samples, forward: bool, numbers: Float[np.ndarray, "... 4"]) -> Float[np.ndarray, "... n 4"]:
    """The derivatives of `levels_of` by the numbers, beside its corners."""
    whole_rise, period, start, duration = np.moveaxis(numbers[..., None], -2, 0)
    cycle = np.floor((time - start) / period)
    passed, slow = time - start - cycle * period, period - duration
    fast, left = passed < duration, (period - passed) / slow
    by_passed = np.where(fast, 1.0 / duration, -1.0 / slow)
    by_period = np.where(fast, 0.0, (1.0 - left) / slow) - cycle * by_passed
    by_duration = np.where(fast, -passed / duration**2, left / slow)
    fallen = np.where(fast, passed / duration, left)
    level, sign = (1.0 - fallen, -1.0) if forward else (fallen, 1.0)
    share = slow / period
    peak = sign * whole_rise * share
    of_period = level * whole_rise * duration / period**2 + peak * by_period
    of_duration = peak * by_duration - level * whole_rise / period
    return np.stack([level * share, of_period, -peak * by_passed, of_duration], axis=-1)


def line_of(numbers: Float[np.ndarray, "... 4"], forward: bool) -> Float[np.ndarray, "... 3"]:
    """Coefficients (a, s, c) of the slow flanks u = a + s t - c n, n the number of the cycle."""
    whole_rise, period, start, duration = np.moveaxis(numbers, -1, 0)
    if forward:
        return np.stack([-whole_rise * (start + duration) / period, whole_rise / period, whole_rise], axis=-1)
    return np.stack([whole_rise * (1.0 + start / period), -whole_rise / period, -whole_rise], axis=-1)


def slopes_of_line(numbers: Float[np.ndarray, "... 4"], forward: bool) -> Float[np.ndarray, "... 3 4"]:
    """The derivatives of `line_of`."""
    whole_rise, period, start, duration = np.moveaxis(numbers, -1, 0)
    one, zero, slope = np.ones_like(period), np.zeros_like(period), whole_rise / period
    late = (start + duration if forward else start) / period
    foot = [late if forward else 1.0 + late, -slope * late, slope, slope if forward else zero]
    rows = np.array([foot, [1.0 / period, -slope / period, zero, zero], [one, zero, zero, zero]])
    signs = [-1.0, 1.0, 1.0] if forward else [1.0, -1.0, -1.0]
    return np.array(signs)[:, None] * np.moveaxis(rows, (0, 1), (-2, -1))


def _numbers_of(
    line: Float[np.ndarray, "... 3"], duration: Float[np.ndarray, " k"], forward: bool
) -> Float[np.ndarray, "k 4"]:
    """Numbers of the sawtooths with slow flanks on a `line` and fast flanks of a `duration` [s]."""
    a, slope, drop = np.moveaxis(line, -1, 0)
    period, whole_rise = drop / slope, np.abs(drop)
    start = -a / slope - duration if forward else period * (a / whole_rise - 1.0)
    return np.stack(np.broadcast_arrays(whole_rise, period, start, duration), axis=-1)


JUMP = 1.6
"""Sampling intervals up to which a flank cannot be told from a jump."""

_SURE = 5.0
"""Half width, in standard errors, of the range of a number of a flank that least squares has located."""


class Timing(NamedTuple):
    """Range of the duration of fast flanks and of the drive's start, by the samples of the voltage [s]."""

    shortest: float
    longest: float
    within: float
    """Largest error of the drive's start, to either side."""
    errors: tuple[float, float] | None = None
    """Standard errors of duration and start, if samples on flanks locate them; None if only bounds are known."""


def timing_of(sharp: SharpFlanks | None, seen: float, interval: float) -> Timing:
    """Timing of located fast flanks; else of those `seen` [s] long between two levels, 0 where no sample is."""
    if sharp is None and seen:
        # With few samples between the two levels the duration is overestimated.
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
