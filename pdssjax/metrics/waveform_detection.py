"""Find the waveform of a drive from samples of its voltage: kind, voltage, frequency, flanks, and when it starts.

1.  Levels: the extremes; a voltage below zero is turned round.
2.  Flanks: passages from the lowest quarter to the highest and back, each with the moments at which it passes them.
3.  One flank only is a step.  Else the period follows from a line through the middles of the slower flanks.
4.  Sawtooth, triangle, trapezoid, sine and cycloidal are laid over the samples with the flanks' times
    (`waveform_fits.py`).  The one that leaves the least is taken, if it leaves less than `MOST_MISFIT` of the voltage.
5.  Else the same is tried of the voltage counted from the level at which it rests, or from its lowest.
6.  Else the samples themselves have to be the drive.
"""

import dataclasses
import itertools
import math
from typing import NamedTuple

import numpy as np

from .sensor_samples import flicker_of, scatter_between_corners
from .sharpened_flanks import widened
from .voltage_flanks import Samples, extremes_of, voltage_flanks
from .waveform_fits import AT_ZERO, FITS, LOCATED, Waveform, cycloid_at, fit_step

MOST_MISFIT = 0.015
"""Largest rms residual of a waveform beyond the noise, as a fraction of the voltage."""

_REST_SAMPLES = 4
"""Least number of samples of a rest."""

_LEVEL_ROUNDS = 4
"""Largest number of rounds that refine the level from which a voltage is counted."""

_LEVEL_TOLERANCE = 2e-5
"""Largest deviation of that level, as a fraction of the voltage."""

_HELD_SHARE = 0.03
"""Least duration of the first voltage, as a fraction of the record, for it to have been held before."""

_FLICKERS = 1.5
"""Least distance of a voltage from a level that it has left, in multiples of its flicker."""

_UNDER_WAY = 0.1
"""Least distance from a rest that the voltage has surely left, as a fraction of the voltage."""

_NEGLIGIBLE_BOUND = 1e-3
"""Largest relative bound (two standard errors) of the frequency that is not mentioned."""


def detect_waveform(time: Samples, volts: Samples) -> Waveform:
    """The waveform of `volts` [V] at increasing, even `time` [s]; `numbers` hold at least "voltage".

    **Raises:** `ValueError` where the voltage never changes.
    """
    low, high = float(np.min(volts)), float(np.max(volts))
    if high == low:
        raise ValueError(f"found {low:g} V in all {volts.size} samples, expected a voltage that changes")
    turned = -1.0 if abs(low) > abs(high) + AT_ZERO * (high - low) else 1.0
    found = _restore_sign(_detect(time, turned * volts), turned)
    if found.name != "sampled":
        return dataclasses.replace(found, counted_from=0.0)
    counted, (level, turned, samples) = found, _reference_level(time, volts, turned)
    # Noise widens the range of a voltage, and what is laid over it tells the level better.
    for _ in range(_LEVEL_ROUNDS):
        counted = _restore_sign(_detect(time, turned * (volts - level)), turned)
        if counted.name == "sampled":
            return found
        if counted.begins == "seen" or abs(counted.counted_from) < _LEVEL_TOLERANCE * (high - low):
            break
        level += turned * counted.counted_from
    if counted.name == "sawtooth" and counted.timing is not None:
        # Its slow flanks tell by that level when they begin.
        cycles = float(time[-1] - time[0]) * counted.numbers["frequency"]
        error = scatter_between_corners(volts) / math.sqrt(samples or max(cycles, 1.0))
        slope = abs(counted.numbers["voltage"]) * counted.numbers["frequency"]
        counted = dataclasses.replace(counted, timing=widened(counted.timing, error / slope))
    return dataclasses.replace(counted, counted_from=level)


def _restore_sign(found: Waveform, turned: float) -> Waveform:
    """`found` in a voltage that was `turned` round, where that is -1, as it was recorded."""
    back = {field: turned * number for field, number in found.numbers.items() if field in ("voltage", "bias")}
    return dataclasses.replace(found, numbers=found.numbers | back)


def _reference_level(time: Samples, volts: Samples, turned: float) -> tuple[float, float, int]:
    """The level [V] from which a voltage is counted, its direction from there (1 up, -1 down), and samples averaged.

    The level is that of a rest at an end of the voltage's range; without one the end of the range nearer to 0 V (the
    highest if `turned`), of 0 samples.
    """
    low, high = extremes_of(volts)
    rest = _rest(time, volts, high - low)
    if rest is not None:
        near = max(AT_ZERO * (high - low), _flicker(volts, high - low))
        for end, way in ((low, 1.0), (high, -1.0)):
            if abs(rest.level - end) < near:
                return rest.level, way, rest.samples
    return (low if turned > 0 else high), turned, 0


def _detect(time: Samples, volts: Samples) -> Waveform:
    low, high = extremes_of(volts)
    low = min(low, float(volts[0]))  # a step may begin with the second sample
    interval = float(np.median(np.diff(time)))
    # On a clock that counts from 1970 a line through the samples would be lost in rounding.
    first = float(time[0])
    elapsed = time - first
    flanks = voltage_flanks(elapsed, volts, low, high)
    rest = _rest(time, volts, high - low)
    rests = rest.end if rest is not None and abs(rest.level) <= AT_ZERO * (high - low) else None
    counts = len(flanks.rises), len(flanks.falls)
    if counts == (1, 0):
        step = fit_step(elapsed, volts, flanks, interval, -first)
        if step.misfit < MOST_MISFIT and abs(low) < AT_ZERO * high:
            return dataclasses.replace(step, start=step.start + first)
    limit = MOST_MISFIT + 2.0 * scatter_between_corners(volts) / (high - low)
    if max(counts) >= 2 and min(counts) >= 1:
        candidates = [fit(elapsed, volts, flanks, interval) for fit in FITS]
        fitting = [c for c in candidates if c is not None and c.misfit < limit]
        if fitting:
            # A trapezoid with a short plateau is a sawtooth, too: the simpler one is taken.
            best = min(c.misfit for c in fitting)
            simplest = next(c for c in fitting if c.misfit < 2.0 * best + 2e-3)
            if rests is not None and _runs_low(simplest, elapsed, volts, rests - first):
                rests = None
            located = (1.5 if simplest.uncertain else LOCATED) * interval
            located = located if simplest.timing is None else min(located, simplest.timing.within)
            within = 2.0 * simplest.frequency_error
            bound = () if within < _NEGLIGIBLE_BOUND else (f"frequency: within {100 * within:.2g} %",)
            found = dataclasses.replace(simplest, uncertain=simplest.uncertain + bound, start=simplest.start + first)
            return with_drive_start(found, time, rests, 1.5 * interval, located)
    start = float(time[0]) if rests is None else _before_onset(time, volts, rests)
    # The first stair of a staircase is no voltage that was held before.
    held = rest is not None and rest.end - time[0] > _HELD_SHARE * (time[-1] - time[0])
    begins = "seen" if rests is not None else "held" if held else "running"
    return Waveform("sampled", {"voltage": float(np.max(np.abs(volts)))}, "", start, begins, 0.0)


def _runs_low(found: Waveform, elapsed: Samples, volts: Samples, until: float) -> bool:
    """Whether an apparent rest `until` a time [s] is the low part of a cycle of a running drive."""
    if found.name == "trapezoid":
        low_for = (1.0 - found.numbers["width"]) / found.numbers["frequency"]
        return until - elapsed[0] <= 1.05 * low_for
    if found.name == "cycloidal":
        quiet = elapsed < until
        runs = volts[quiet] - cycloid_at(elapsed[quiet], found)
        return bool(runs @ runs < volts[quiet] @ volts[quiet])
    return False


def _before_onset(time: Samples, volts: Samples, leaves: float) -> float:
    """A time in the rest [s] before the onset of a voltage that visibly leaves the rest at `leaves`.

    A smooth onset begins long before it is visible.  An onset like t^n that is visible at 0.2 % of the voltage reaches
    10 % after 50^(1/n) times as long, more than twice up to n = 5: it began less than the time between the two earlier.
    Half of the rest stays in front of the onset, since it shows the zero of a velocity sensor.
    """
    far = np.abs(volts) >= _UNDER_WAY * np.max(np.abs(volts))
    reached = float(time[np.argmax(far & (time >= leaves))])
    return max(0.5 * (float(time[0]) + leaves), 2.0 * leaves - reached)


class _Rest(NamedTuple):
    """A voltage that does not change from the first sample on."""

    end: float
    """Time at which the voltage leaves the rest [s]."""
    level: float
    """[V]"""
    samples: int
    """Number of samples of which `level` is the mean."""


def _flicker(volts: Samples, extent: float) -> float:
    """How far samples of a level may be from it by their flicker, in the unit of the voltage."""
    return min(_FLICKERS * flicker_of(volts), _UNDER_WAY * extent)


def _rest(time: Samples, volts: Samples, extent: float) -> _Rest | None:
    """The rest at the begin of a voltage; None without one."""
    near = max(AT_ZERO * extent, _flicker(volts, extent))
    away = np.flatnonzero(np.abs(volts - np.median(volts[:3])) > near)
    far = int(away[0]) if away.size else volts.size
    if far < _REST_SAMPLES:
        return None
    # Hum is no motion: neighbours do not show it, but all samples of the rest do.
    level = float(np.median(volts[:far]))
    spread = 1.4826 * float(np.median(np.abs(volts[:far] - level)))
    noise = max(5.0 * scatter_between_corners(volts), 3.0 * spread, 2e-3 * extent)
    leaves = int(np.flatnonzero(np.abs(volts[:far] - level) <= noise)[-1]) + 1
    if leaves < _REST_SAMPLES:
        return None
    quiet = volts[:leaves]
    # A slow flank that has just begun is no rest: it has the slope that it goes on with.
    ahead = float(np.max(np.abs(volts[leaves : 2 * leaves] - volts[leaves - 1]), initial=0.0))
    drift = float(np.mean(quiet[leaves // 2 :]) - np.mean(quiet[: leaves // 2])) * 2.0
    if abs(drift) > 0.3 * ahead and ahead > 0:
        return None
    # The last samples may be on their way already, within the noise.
    surely = quiet[: max(round(0.85 * leaves), _REST_SAMPLES - 1)]
    return _Rest(float(time[leaves - 1]), float(np.mean(surely)), surely.size)


def with_drive_start(
    found: Waveform, time: Samples, leaves_rest: float | None, tolerance: float, located: float = math.inf
) -> Waveform:
    """Replace a waveform's `start`, which is that of some cycle, by the start of the drive.

    **Arguments:** `leaves_rest` is the time at which the voltage leaves a rest at 0 V [s], None without such a rest.
    Without one the clock counts from the drive's start if a cycle begins within `tolerance` [s] of the clock's zero;
    within `located` [s] the start is that zero.
    """
    period = 1.0 / found.numbers["frequency"]
    if leaves_rest is not None:
        cycles = round((leaves_rest - found.start) / period)
        return dataclasses.replace(found, start=found.start + cycles * period, begins="seen")
    # A clock that counts from the drive's start shows a cycle that begins at 0.
    phase = found.start / period
    if time[0] >= -tolerance and abs(phase - round(phase)) * period <= tolerance:
        beside = found.start - round(phase) * period
        return dataclasses.replace(found, start=0.0 if abs(beside) <= located else beside, begins="clock")
    before = math.floor((float(time[0]) - found.start) / period + 1e-6)
    return dataclasses.replace(found, start=found.start + before * period)


_FLANK_FRACTIONS = (0.1, 0.5, 0.9)
"""Fractions of a flank between which its first and its second half are timed."""

_FLANK_SAMPLES = 3
"""Fewest samples between the first and the last of `_FLANK_FRACTIONS`: with fewer a corner looks like a bend."""


def rounding_of(time: Samples, volts: Samples, waveform: Waveform) -> float:
    """How much longer a fast flank takes for its second half than for its first one, by the median of all flanks.

    1 of a straight line, ln 5 / ln 1.8 = 2.7 behind an amplifier of first order; NaN of other waveforms and of flanks
    with too few samples.

    **Arguments:** `volts` [V] at `time` [s], and the step or sawtooth found in them.
    """
    if waveform.name not in ("step", "sawtooth"):
        return math.nan
    level = (volts - waveform.counted_from) / waveform.numbers["voltage"]
    passed = 1.0 - level if waveform.direction == "forward" else level
    outside = np.flatnonzero((passed <= _FLANK_FRACTIONS[0]) | (passed >= _FLANK_FRACTIONS[-1]))
    ratios = []
    for first, last in itertools.pairwise(outside):
        if passed[first] > _FLANK_FRACTIONS[0] or passed[last] < _FLANK_FRACTIONS[-1] or last - first <= _FLANK_SAMPLES:
            continue
        flank = slice(first, last + 1)
        begin, middle, end = np.interp(_FLANK_FRACTIONS, np.maximum.accumulate(passed[flank]), time[flank])
        ratios.append((end - middle) / (middle - begin))
    return float(np.median(ratios)) if ratios else math.nan
