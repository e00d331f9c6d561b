"""A cycloidal sawtooth laid over samples of a voltage, by least squares.

Its slow flanks end without slope, so that, unlike a sawtooth's, they tell its voltage whatever the fast ones are.
"""

import math
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from .flank_timing import JUMP, timing_of
from .sharpened_flanks import SharpFlanks
from .voltage_flanks import Samples, VoltageFlanks, fast_flanks
from .waveform import AT_ZERO, Waveform

_LONGEST = 0.5
"""Part of a period that a fast flank may take."""

_BESIDE = 1.2
"""Sampling intervals beside a jump in which it may lie."""


def fit_cycloidal(time: Samples, volts: Samples, flanks: VoltageFlanks, interval: float) -> Waveform | None:
    """A sawtooth whose slow flanks are cycloids, `volts` [V] at `time` [s]; None where both flanks take about as long.

    Fast flanks are straight lines, or jumps where no sample lies on them.
    """
    fast = fast_flanks(flanks)
    if fast is None:
        return None
    ideal = fast.duration < JUMP * interval
    # Before its first fast flank a drive may have been at rest.
    turn = (time - fast.middles[0]) / fast.period
    kept = (turn > 0) & ~(ideal & (np.abs(turn - np.round(turn)) * fast.period < _BESIDE * interval))
    time, volts = time[kept], volts[kept]
    duration = 0.0 if ideal else fast.duration
    begin = float(fast.middles[0]) - 0.5 * duration
    first = np.array([0.0, flanks.extent, begin, fast.period, *([duration] * (not ideal))])
    if time.size < 4 * first.size or turn[-1] < 0.5:
        return None
    found, errors, left = _least_squares(time, volts, _levels(time, fast.fall), first, interval)
    level, voltage, start, period = (float(number) for number in found[:4])
    duration = 0.0 if ideal else float(found[4])
    if not (voltage > 0 and 0.0 <= duration < _LONGEST * period and abs(level) < AT_ZERO * voltage):
        return None
    _, of_voltage, of_start, of_period = (float(error) for error in errors[:4])
    of_duration = math.inf if ideal else float(errors[4])
    sharp = SharpFlanks(voltage, period, start, duration, of_start, of_duration, of_voltage)
    return Waveform(
        "cycloidal",
        {"voltage": voltage, "frequency": 1.0 / period} | ({} if ideal else {"fall_time": duration}),
        "forward" if fast.fall else "backward",
        start,
        "running",
        left / voltage,
        (f"fall_time: below {JUMP * interval:.3g} s",) if ideal else (),
        timing_of(None if ideal else sharp, 0.0, interval),
        of_voltage,
        of_period / period,
        level,
    )


def cycloid_at(time: Samples, found: Waveform) -> Samples:
    """The voltage [V] at `time` [s] of a cycloidal that was found and runs, counted from its level."""
    numbers = [0.0, found.numbers["voltage"], found.start, 1.0 / found.numbers["frequency"]]
    return _levels(time, found.direction == "forward")(np.array([*numbers, found.numbers.get("fall_time", 0.0)]))


def _levels(time: Samples, fall: bool) -> Callable[[np.ndarray], Samples]:
    """The voltage [V] at `time` [s] by its lowest level and its height [V], begin of a fast flank, period and, if
    any, the duration of that flank [s]."""

    def shown(numbers: np.ndarray) -> Samples:
        lowest, voltage, start, period, *lasts = numbers
        duration = lasts[0] if lasts else 0.0
        phase = np.mod(time - start, period)
        part = (phase - duration) / (period - duration)
        slow = part - np.sin(2.0 * np.pi * part) / (2.0 * np.pi)
        level = np.where(phase < duration, 1.0 - phase / (duration or 1.0), slow)
        return lowest + voltage * (level if fall else 1.0 - level)

    return shown


def _least_squares(
    time: Samples,
    volts: Samples,
    shown: Callable[[np.ndarray], Samples],
    first: Float[np.ndarray, " p"],
    interval: float,
) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"], float]:
    """Numbers, standard errors by what they leave, and its root mean square [V]."""
    from scipy.optimize import least_squares

    scale = np.array([first[1], first[1], interval, interval, interval])[: first.size]
    solved = least_squares(lambda numbers: shown(numbers) - volts, first, x_scale=scale, method="trf", max_nfev=40)
    left = math.sqrt(float(np.mean(solved.fun**2)))
    triangle = np.linalg.qr(solved.jac * scale, mode="r")
    inverse = np.linalg.pinv(triangle)
    return solved.x, left * scale * np.linalg.norm(inverse, axis=1), left
