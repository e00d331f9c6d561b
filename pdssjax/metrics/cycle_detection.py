"""Find the cycles of a sawtooth drive in a record of the motion.

1.  A straight line is subtracted, so that a net motion leaves a sawtooth; where none is clear, a curved trend.
2.  The frequency is where the record agrees best with an ideal sawtooth: first on the grid of a
    spectrum, whose amplitudes at f, 2f, 3f, ... are summed with the weights 1, 1/2, 1/3, ... that a
    sawtooth gives them (so that neither f/2 nor 2f can win), then in ever finer steps by least
    squares.  A slow drift has no harmonics and stays far from any sawtooth.
3.  Each slip is where the record moves fastest against the slow flank, near where the sawtooth drops.
4.  A straight line through the times of the slips gives start and frequency.
5.  Slow flanks that are too different from the others are left out: rest before the drive, a stop.
"""

import dataclasses

import numpy as np
from jaxtyping import Int

from ..core import InputError
from .per_cycle import FLANK, cycle_metrics
from .sensor_samples import Samples

HARMONICS = 12
"""Number of harmonics of the sawtooth that is compared with the record."""

LEAST_PER_CYCLE = 8
"""Fewest samples per cycle: a slow flank needs a slope and a scatter."""

TRENDS = (1, 5)
"""Degrees of the polynomial trends that are removed; the second only if the first leaves no clear sawtooth."""

CLEAR_FIT = 0.5
"""Least share of the variance that a clear sawtooth explains."""

LEAST_FIT = 0.2
"""Least share of the variance that a sawtooth explains where there are cycles at all."""


@dataclasses.dataclass(frozen=True)
class Cycles:
    """The complete cycles of a record, one after the other: each a slow flank and the slip at its end."""

    frequency: float
    """Frequency that was given, or else `slip_frequency` [Hz]."""
    slip_frequency: float
    """Frequency by a line through the times of the slips [Hz]."""
    slip_frequency_error: float
    """Standard error of `slip_frequency` [Hz]; infinite where fewer than two slips were located."""
    start: float
    """Begin of the first complete cycle, in the middle of a slip [s]."""
    count: int
    """Number of complete cycles."""
    rejected: int
    """Number of further cycles in the record that are incomplete or unlike the others."""
    falls: bool
    """Whether the slow flank falls, as of a backward drive."""
    fit: float
    """Share of the variance of the complete cycles about their trend that the best sawtooth explains."""


def find_cycles(time: Samples, values: Samples, frequency: float | None, where: str) -> Cycles:
    """The complete cycles in `values`, of any unit, at ascending `time` [s].

    **Arguments:** `frequency` [Hz], or None to find it.  The record may begin and end anywhere in a cycle.  A cycle
    is complete if the record holds what its metrics need: the fitted part of its slow flank, the slip, and the fitted
    part of the flank that follows.

    **Raises:** `InputError` that begins with `where` if there is no complete cycle, or if the record cannot show the
    given frequency.
    """
    extent, interval = float(time[-1] - time[0]), float(np.median(np.diff(time)))
    highest, lowest = 1.0 / (LEAST_PER_CYCLE * interval), 1.5 / extent
    if frequency is not None and not lowest <= frequency <= highest:
        raise InputError(
            f"{where}: found the frequency {frequency:g} Hz for samples {interval:.3g} s apart over {extent:.3g} s, "
            f"expected {lowest:.3g} Hz to {highest:.3g} Hz: {LEAST_PER_CYCLE} samples in a cycle and 1.5 cycles."
        )
    if lowest >= highest:
        raise InputError(f"{where}: found {len(time)} samples, expected more: {LEAST_PER_CYCLE} in each of two cycles.")
    fit, estimate, phase, sign = _best_sawtooth(time, values, frequency, lowest, highest)
    if fit < LEAST_FIT:
        wanted = "the drive's own frequency, or none" if frequency else "a record of several cycles"
        raise InputError(
            f"{where}: found no cycles: at {estimate:.4g} Hz, a sawtooth explains {100 * fit:.0f} % of the motion "
            f"about its trend, expected {wanted}."
        )
    start, slip_frequency, error = time[0] + phase / estimate, estimate, np.inf
    first, flanks, alike = 0.0, 0, np.zeros(0, int)
    for remaining in (2, 1, 0):
        # The first slip of a cycle with samples; the time of a slip is uncertain by a fiftieth of a cycle.
        before = np.floor((time[0] - start) * estimate + 0.02)
        first, flanks = start + before / estimate, int(np.ceil((time[-1] - start) * estimate - before - 0.02))
        alike = _similar_flanks(time, values, estimate, first, flanks)
        if len(alike) < 2:
            raise InputError(
                f"{where}: found {len(alike)} complete slow flanks at {estimate:.4g} Hz, "
                "expected two at least, of a record of several cycles."
            )
        if remaining:
            # The slips at both ends of every flank that is like the others.
            expected = first + np.append(alike, alike[-1] + 1) / estimate
            slips = _slips(time, values, estimate, expected, sign)
            slip_frequency, start, error = _line_of_slips(slips, expected, estimate, interval)
            estimate = frequency or slip_frequency
    count, start = len(alike) - 1, float(first + alike[0] / estimate)
    if frequency is None and count < 2:
        raise InputError(
            f"{where}: found one complete cycle at most, from which no frequency can be told, "
            "expected the drive's frequency or a longer record."
        )
    stroke = cycle_metrics(time, values, estimate, start, count).stroke
    falls = bool(np.median(np.asarray(stroke)) < 0)
    # The fit of the sawtooth is that to the complete cycles alone, without a rest before and after.
    used = (time >= start) & (time <= start + (count + 1) / estimate)
    fit, *_ = _best_sawtooth(time[used], values[used], estimate, estimate, estimate)
    return Cycles(estimate, slip_frequency, error, start, count, flanks - count, falls, fit)


def _similar_flanks(
    time: Samples, values: Samples, frequency: float, first: float, count: int
) -> Int[np.ndarray, " flanks"]:
    """Numbers, below `count`, of the slow flanks in the longest run that are complete and alike."""
    slow = first + np.arange(count) / frequency
    edge = 1e-9 / frequency + 0.5 * np.median(np.diff(time))
    whole = (slow + FLANK[0] / frequency >= time[0] - edge) & (slow + FLANK[1] / frequency <= time[-1] + edge)
    # One more cycle, so that the last flank has a stroke, too, though no net step.
    stroke = np.asarray(cycle_metrics(time, values, frequency, first, count + 1).stroke)[:count]
    size = np.where(whole & np.isfinite(stroke), np.abs(stroke), 0.0)
    longest, least = np.zeros(0, int), 0.02 * size.max(initial=0.0)
    # From the largest on: a motion before the drive began, or after it ended, may be larger, but occurs once.
    while len(longest) < 2 and size.max(initial=0.0) > least:
        large = size > 0.5 * size.max()
        usual = np.median(stroke[large])
        alike = np.flatnonzero((size > 0) & (np.abs(stroke - usual) <= 0.5 * abs(usual)))
        longest = max(np.split(alike, np.flatnonzero(np.diff(alike) > 1) + 1), key=len)
        size = np.where(large, 0.0, size)
    return longest


def _best_sawtooth(
    time: Samples, values: Samples, frequency: float | None, lowest: float, highest: float
) -> tuple[float, float, float, float]:
    """Fit, frequency, phase and sign of the sawtooth that explains the most of the motion about its trend."""
    candidates = []
    for degree in TRENDS:
        powers = np.polynomial.legendre.legvander(2 * (time - time[0]) / (time[-1] - time[0]) - 1, degree)
        detrended = values - powers @ np.linalg.lstsq(powers, values, rcond=None)[0]
        f = frequency
        if f is None:
            coarse = _coarse_frequency(time, detrended, lowest, highest)
            f = _finer_frequency(time, detrended, coarse, lowest, highest)
        # Of two or three cycles a curved trend would explain too much.
        if degree == 1 or f * (time[-1] - time[0]) > degree:
            fit, phase, sign = _sawtooth(time, detrended, f)
            candidates.append((fit, f, phase, sign))
        if candidates[0][0] > CLEAR_FIT:
            break
    return max(candidates)


def _coarse_frequency(time: Samples, detrended: Samples, lowest: float, highest: float) -> float:
    """The frequency of the greatest sum of amplitudes, weighted as a sawtooth has them."""
    interval = np.median(np.diff(time))
    even = np.arange(time[0], time[-1] + 0.5 * interval, interval)
    tapered = np.interp(even, time, detrended) * np.hanning(len(even))
    padded = 8 * len(even)
    amplitude = np.abs(np.fft.rfft(tapered, padded))
    bins = np.arange(max(1, int(lowest * padded * interval)), int(highest * padded * interval) + 1)
    score = np.zeros(len(bins))
    for harmonic in range(1, HARMONICS + 1):
        at = harmonic * bins
        score += np.where(at < len(amplitude), amplitude[np.minimum(at, len(amplitude) - 1)], 0.0) / harmonic
    return float(bins[np.argmax(score)] / (padded * interval))


def _finer_frequency(time: Samples, detrended: Samples, about: float, lowest: float, highest: float) -> float:
    """The best fit of a sawtooth near `about`, or near simple multiples of it."""
    # Fifty samples a cycle are enough here.
    thin = max(1, int(1.0 / (50 * about * np.median(np.diff(time)))))
    time, detrended = time[::thin], detrended[::thin]
    step = 1.0 / (time[-1] - time[0])
    tried = [f for f in (about / 3, about / 2, about, 2 * about, 3 * about) if lowest <= f <= highest]
    trials = np.concatenate([f + 0.5 * step * np.linspace(-1, 1, 11) for f in tried])
    width = 0.1 * step
    for _ in range(3):
        trials = trials[(trials >= lowest) & (trials <= highest)]
        about = max(trials, key=lambda f: _sawtooth(time, detrended, f)[0])
        trials = about + width * np.linspace(-1, 1, 9)
        width /= 4
    return float(about)


def _sawtooth(time: Samples, detrended: Samples, frequency: float) -> tuple[float, float, float]:
    """The sawtooth that fits best: its share of the variance, the phase of its first drop, its sign.

    A sawtooth that rises by 1 in a period and drops at phase p is
    -(1/pi) sum sin(2 pi h (f t - p)) / h, summed over the harmonics h.
    """
    turn = np.exp(-2j * np.pi * frequency * (time - time[0]))
    power, coefficient = np.ones_like(turn), []
    for _ in range(HARMONICS):
        power = power * turn
        coefficient.append(power @ detrended)
    harmonic = np.arange(1, HARMONICS + 1)
    phase = np.arange(256) / 256
    wave = np.exp(2j * np.pi * np.outer(phase, harmonic))
    overlap = (wave @ (np.array(coefficient) / harmonic)).imag
    best = int(np.argmax(np.abs(overlap)))
    norm = 0.5 * len(time) * np.sum(1.0 / harmonic**2)
    return float(overlap[best] ** 2 / norm / (detrended @ detrended)), float(phase[best]), float(np.sign(overlap[best]))


def _slips(time: Samples, values: Samples, frequency: float, expected: Samples, sign: float) -> np.ndarray:
    """Times [s] near each `expected` slip at which the record moves fastest against the slow flank.

    NaN where there are no samples, or hardly such a motion: when a drive starts its first flank begins without a slip.
    """
    span = max(1, round(0.01 / frequency / np.median(np.diff(time))))
    middle, change = 0.5 * (time[span:] + time[:-span]), -sign * (values[span:] - values[:-span])
    found, sizes = np.full(len(expected), np.nan), np.full(len(expected), np.nan)
    for index, moment in enumerate(expected):
        near = np.flatnonzero(np.abs(middle - moment) <= 0.15 / frequency)
        # A slip at the record's edge is cut off, and another motion would be mistaken for the slip.
        if len(near) and abs(moment - time[0]) * frequency > 0.02 and abs(moment - time[-1]) * frequency > 0.02:
            # Several spans hold the same jump; its time is their mean.
            most = near[np.argmax(change[near])]
            beside = slice(max(most - span, 0), most + span + 1)
            weight = np.maximum(change[beside] - 0.5 * change[most], 0.0)
            if change[most] > 0:
                found[index], sizes[index] = weight @ middle[beside] / weight.sum(), change[most]
    if np.isfinite(sizes).any():
        found[sizes < 0.3 * np.nanmedian(sizes)] = np.nan
    return found


def _line_of_slips(slips: Samples, expected: Samples, frequency: float, interval: float) -> tuple[float, float, float]:
    """Frequency, first slip and standard error of the frequency, by a line through the times of the slips."""
    number = np.round((expected - expected[0]) * frequency)
    late = slips - expected
    usual = float(np.nanmedian(late)) if np.isfinite(late).any() else 0.0
    # A motion far from the usual place of a slip is none.
    keep = np.isfinite(late) & (np.abs(late - usual) <= 0.05 / frequency)
    if keep.sum() < 2:
        return frequency, float(expected[0] + usual), np.inf
    about = number[keep] - number[keep].mean()
    square = about @ about
    period = float(about @ slips[keep] / square)
    middle = slips[keep].mean()
    # A slip lies between two samples: its time has at least the error of a uniform distribution over an interval.
    scatter = np.sum((slips[keep] - middle - period * about) ** 2) / max(keep.sum() - 2, 1)
    error = np.sqrt(max(scatter, interval**2 / 12) / square) / period**2
    return 1.0 / period, float(middle - period * number[keep].mean()), float(error)
