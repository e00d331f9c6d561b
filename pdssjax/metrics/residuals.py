"""Parts of the residuals of a record: misfit that repeats every cycle, noise, glitches, late slips.

Residuals at equal phase are repeated measurements, whatever the model; what scatters among them is the
measurement's own noise ("pure error"), and what their means scatter beyond it is the model's misfit (R. A. Fisher's
test of lack of fit; N. R. Draper and H. Smith, Applied Regression Analysis, Wiley 1998, chapter 2).

A motion x that comes later by d leaves - x' d.  In the slips x' is some hundred times that of the slow flanks, so a
line of the residuals there against x' has the slope - d, whatever the level at which they lie.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from .coloured_noise import Noise, fit_noise
from .sensor_samples import Samples, resolution_of


def rmse(measured: Samples, predicted: Samples) -> float:
    """Root mean square of the residuals, in the unit of the data."""
    return float(np.sqrt(np.mean((measured - predicted) ** 2)))


def error_index(measured: Samples, predicted: Samples) -> float:
    """The thesis's error index (4.14), sqrt(sum (measured - predicted)^2 / (n - 1)), in the unit of the data."""
    return float(np.sqrt(np.sum((measured - predicted) ** 2) / (len(measured) - 1)))


def r_squared(measured: Samples, predicted: Samples) -> float:
    """Share of the measured variance that the prediction explains."""
    return float(1.0 - np.mean((measured - predicted) ** 2) / np.var(measured))


_OFF_GRID = 0.02
"""Largest drift of the phase over a record, in samples, for samples of all cycles to share their phases."""


class LackOfFit(NamedTuple):
    """Test of lack of fit: the repeating part of a record's residuals against the rest."""

    noise: float
    """Standard deviation of what does not repeat, in the record's unit: the noise, whatever the model."""
    misfit: float
    """Root mean square of what repeats beyond what noise leaves of it, in the record's unit; 0 where it is none."""
    sigmas: float
    """Difference of the mean squares between and within phases, as a normal deviate."""


class CycleSplit(NamedTuple):
    """Residuals as their mean over the cycles at each phase, and the rest.

    Of n samples and as many phases as a cycle has sample intervals.
    """

    group: Int[np.ndarray, " n"]
    """Index of the phase of each sample; -1 where the residual is not finite."""
    sizes: Int[np.ndarray, " phases"]
    """Samples at each phase."""
    mean: Float[np.ndarray, " phases"]
    """Mean residual at each phase; 0 where there is no sample."""
    rest: Samples
    """Residual less its phase's mean, enlarged by sqrt(m/(m - 1)) for the mean of m; NaN where a phase came once."""

    def phases(self) -> Float[np.ndarray, " phases"]:
        """Where in the cycle each phase lies, from 0 to 1."""
        return (np.arange(self.sizes.size) + 0.5) / self.sizes.size


def split_by_phase(residual: Samples, time: Samples, frequency: float) -> CycleSplit | None:
    """The `residual` of a record, sampled at `time` [s], split by the phase of a drive of so many cycles a second [Hz].

    Samples are grouped by phase: exactly where a cycle holds a whole number of sample intervals, else into bins as
    wide as one interval, within which a steep misfit counts as noise.

    **Returns:** None where fewer than one and a half cycles, or than eight phases with two samples or more, were
    recorded.
    """
    finite = np.isfinite(residual)
    values, clock = residual[finite], time[finite]
    if values.size < 16 or np.ptp(clock) * frequency < 1.5:
        return None
    count = 1.0 / (frequency * float(np.median(np.diff(clock))))
    cycles = np.ptp(clock) * frequency
    exact = abs(count - round(count)) * cycles < _OFF_GRID
    phase = np.mod(clock * frequency, 1.0) * (round(count) if exact else count)
    if exact:  # on the grid of the first sample: halfway between two phases rounding would mix neighbours
        group = np.mod(np.round(phase - (phase[0] - np.round(phase[0]))), round(count)).astype(int)
    else:
        group = np.floor(phase).astype(int)
    sizes = np.bincount(group)
    if np.sum(sizes > 1) < 8:
        return None
    mean = np.bincount(group, values) / np.maximum(sizes, 1)
    repeated = sizes[group] > 1
    enlarged = np.sqrt(sizes[group] / np.maximum(sizes[group] - 1, 1))
    groups, rest = np.full(residual.shape, -1), np.full(residual.shape, np.nan)
    groups[finite] = group
    rest[finite] = np.where(repeated, (values - mean[group]) * enlarged, np.nan)
    return CycleSplit(groups, sizes, mean, rest)


def lack_of_fit(residual: Samples, time: Samples, frequency: float) -> LackOfFit | None:
    """What repeats in the `residual` of a record, sampled at `time` [s], of a drive of so many cycles a second [Hz].

    Where neighbouring samples of the noise are alike, as many fewer of them count as independent.

    **Returns:** None where `split_by_phase` has none.
    """
    split = split_by_phase(residual, time, frequency)
    if split is None:
        return None
    group, values = split.group[split.group >= 0], residual[split.group >= 0]
    repeated = split.sizes[group] > 1
    phases, samples = int(np.sum(split.sizes > 1)), int(np.sum(repeated))
    within = float(np.sum((values - split.mean[group])[repeated] ** 2)) / (samples - phases)
    centre = np.mean(values[repeated])
    between = float(np.sum((split.mean[group] - centre)[repeated] ** 2)) / (phases - 1)
    misfit = max(between - within, 0.0) * (phases - 1) / samples
    # Fraction of independent samples, by the noise of a cycle.
    noise = fit_noise(time, split.rest, float(np.sum(np.isfinite(split.rest))), split.sizes.size // 2)
    independent = noise.independent_share(time[: split.sizes.size])
    sigmas = _normal_deviate(between, within, (phases - 1) * independent, (samples - phases) * independent)
    return LackOfFit(float(np.sqrt(within)), float(np.sqrt(misfit)), sigmas)


def _normal_deviate(between: float, within: float, above: float, below: float) -> float:
    """Express a ratio of mean squares as a normal deviate (E. Paulson, Ann. Math. Statist. 13, 1942)."""
    if within <= 0.0:
        return float("inf") if between > 0.0 else 0.0
    root = (between / within) ** (1.0 / 3.0)
    a, b = 2.0 / (9.0 * above), 2.0 / (9.0 * below)
    return float(((1.0 - b) * root - (1.0 - a)) / np.sqrt(b * root**2 + a))


class ResidualSplit(NamedTuple):
    """Residuals of n samples, split into what repeats every cycle and the rest."""

    cycles: CycleSplit | None
    """The mean over the cycles at each phase; None where the record does not repeat."""
    rest: Samples
    """What does not repeat, enlarged for the means taken out; all of it where the record does not repeat."""
    noise: Noise
    """Model of the noise in `rest`."""
    freedom: float
    """Degrees of freedom of `rest`."""


def split_residuals(
    residual: Samples, time: Samples, frequency: float | None, freedom: float = float("inf")
) -> ResidualSplit:
    """Split the `residual` of a record at `time` [s] into what repeats every cycle and the rest; NaN is left out.

    **Arguments:** cycles of the drive a second [Hz], None where it does not repeat; the `freedom` that a fit leaves of
    the samples, where nothing repeats: variances grow by what it has taken out.
    """
    cycles = None if frequency is None else split_by_phase(residual, time, frequency)
    if cycles is None:
        samples = float(np.sum(np.isfinite(residual)))
        freedom = min(freedom, samples)
        return ResidualSplit(None, residual, fit_noise(time, residual, freedom, residual.size), freedom)
    # Enlarged by m/(m - 1) already: each of the rest counts.
    samples = float(np.sum(np.isfinite(cycles.rest)))
    noise = fit_noise(time, cycles.rest, samples, cycles.sizes.size // 2)
    return ResidualSplit(cycles, cycles.rest, noise, samples)


_LONGEST_GLITCH = 5
"""Most samples in a row that count as a glitch; longer runs are misfit."""


def outliers(measured: Samples, predicted: Samples, time: Samples, frequency: float | None) -> Int[np.ndarray, " k"]:
    """Indices of the samples `measured` at `time` [s] that stand out of the residuals in runs of at most five.

    Residuals that repeat every cycle of a drive of that `frequency` [Hz] are misfit: their median at each phase is
    subtracted first.  The scale is the median of absolute deviations, which glitches hardly move, or of the changes
    from one cycle to the next, since the middle one of three cycles does not deviate from the median.  Two kinds of
    short residuals are no outliers: those of a slip `predicted` a few samples too early or too late, which a shift in
    time explains, and those below the step of a sensor that counts in steps.
    """
    residual = measured - predicted
    finite = np.isfinite(residual)
    if not finite.any():
        return np.zeros(0, int)
    left = residual - np.median(residual[finite])
    split = None if frequency is None else split_by_phase(residual, time, frequency)
    changes = [np.zeros(0)]
    if split is not None:
        ordered = np.argsort(split.group, kind="stable")  # first what is not finite
        ends = np.sum(split.group < 0) + np.cumsum(split.sizes)
        for size in np.unique(split.sizes[split.sizes > 2]):
            members = ordered[(ends[split.sizes == size] - size)[:, None] + np.arange(size)]
            changes.append(np.diff(left[members], axis=1).ravel())
            left[members] -= np.median(left[members], axis=1, keepdims=True)
    # 1.4826 is the ratio of the standard deviation of normal noise to its median absolute value.
    scale = 1.4826 * max(_median_size(left[finite]), _median_size(np.concatenate(changes)) / np.sqrt(2.0))
    if scale <= 0.0:
        return np.zeros(0, int)
    # Seven sigmas: one sample in 4e11 of normal noise lies as far out.
    far = np.abs(np.nan_to_num(left)) > max(7.0 * scale, resolution_of(measured[finite]) or 0.0)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], far, [False]]).astype(int)))
    places, glitches = np.arange(left.size), [np.zeros(0, int)]
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        height = float(np.max(np.abs(left[begin:end])))
        # The samples beside a glitch fit: next to a smooth misfit they do not.
        beside = left[[i for i in (begin - 1, end) if 0 <= i < left.size]]
        if end - begin > _LONGEST_GLITCH or not np.nanmax(np.abs(beside), initial=0.0) < 0.2 * height:
            continue
        # A shifted prediction that explains the run and two samples on either side leaves little; of a glitch in a
        # steep motion it leaves a half.
        around = places[max(begin - 2, 0) : end + 2]
        shifts = np.arange(-_LONGEST_GLITCH, _LONGEST_GLITCH + 0.5, 0.5)
        moved = np.array([np.interp(around + shift, places, predicted) for shift in shifts])
        remaining = np.nanmax(np.abs(left[around] + predicted[around] - moved), axis=1)
        if not np.min(remaining) < 0.4 * height:
            glitches.append(places[begin:end])
    return np.concatenate(glitches)


def _median_size(deviations: Float[np.ndarray, " k"]) -> float:
    """Median of the absolute values; 0 of none."""
    return float(np.median(np.abs(deviations))) if deviations.size else 0.0


class SlipDelay(NamedTuple):
    """Delay of all slips of a record together."""

    delay: float
    """Measured less predicted time of the slips [s]."""
    standard_error: float
    """[s]"""
    explained_share: float
    """Share of the residuals' sum of squares within slips, about their mean, that the delay explains [1]."""


def slip_delay(time: Samples, predicted: Samples, residual: Samples) -> SlipDelay | None:
    """Delay of the slips against `predicted` [m] at `time` [s], by the `residual` (measured less predicted).

    None where no part of the motion is much faster than the rest, or too few samples lie in it.  NaN is left out.
    """
    rate = np.gradient(predicted, time)
    fast, usual = float(np.max(np.abs(rate))), float(np.median(np.abs(rate)))
    slips = (np.abs(rate) > max(0.2 * fast, 5.0 * usual)) & np.isfinite(residual)
    if np.count_nonzero(slips) < 6:
        return None
    moves, left = rate[slips] - np.mean(rate[slips]), residual[slips] - np.mean(residual[slips])
    size = float(moves @ moves)
    if size == 0.0 or not np.any(left):
        return None
    delay = -float(moves @ left) / size
    unexplained = left + delay * moves
    error = float(np.sqrt(unexplained @ unexplained / (left.size - 2) / size))
    return SlipDelay(delay, error, 1.0 - float(unexplained @ unexplained) / float(left @ left))
