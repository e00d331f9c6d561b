"""What of a record's residuals repeats every cycle, and what does not: misfit and noise, told apart.

Residuals at equal phase are repeated measurements, whatever the model; what scatters among them is the
measurement's own noise ("pure error"), and what their means scatter beyond it is the model's misfit (R. A. Fisher's
test of lack of fit; N. R. Draper and H. Smith, Applied Regression Analysis, Wiley 1998, chapter 2).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from .noise_at_times import noise_at

_OFF_GRID = 0.02
"""Samples by which a cycle may differ from a whole number of them, over the record, to have equal phases."""


class LackOfFit(NamedTuple):
    """What repeats in a record's residuals, and what does not."""

    noise: float
    """Standard deviation of what does not repeat, in the record's unit: the noise, whatever the model."""
    misfit: float
    """Root mean square of what repeats beyond what noise leaves of it, in the record's unit; 0 where it is none."""
    sigmas: float
    """How far the mean squares between and within phases are from alike, in standard deviations of chance."""


class CycleSplit(NamedTuple):
    """Residuals as their mean over the cycles at each phase, and the rest.

    Of n samples and as many phases as a cycle has sample intervals.
    """

    group: Int[np.ndarray, " n"]
    """The phase that each sample belongs to; -1 where the residual is not finite."""
    sizes: Int[np.ndarray, " phases"]
    """Samples at each phase."""
    mean: Float[np.ndarray, " phases"]
    """Mean residual at each phase; 0 where there is no sample."""
    rest: Float[np.ndarray, " n"]
    """Residual less its phase's mean, enlarged by sqrt(m/(m - 1)) for the mean of m; NaN where a phase came once."""

    def phases(self) -> Float[np.ndarray, " phases"]:
        """Where in the cycle each phase lies, from 0 to 1."""
        return (np.arange(self.sizes.size) + 0.5) / self.sizes.size


def split_by_phase(
    residual: Float[np.ndarray, " n"], time: Float[np.ndarray, " n"], frequency: float
) -> CycleSplit | None:
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
    group = np.mod(np.round(phase), round(count)).astype(int) if exact else np.floor(phase).astype(int)
    sizes = np.bincount(group)
    if np.sum(sizes > 1) < 8:
        return None
    mean = np.bincount(group, values) / np.maximum(sizes, 1)
    repeated = sizes[group] > 1
    enlarged = np.sqrt(sizes[group] / np.maximum(sizes[group] - 1, 1))
    everywhere, rest = np.full(residual.shape, -1), np.full(residual.shape, np.nan)
    everywhere[finite] = group
    rest[finite] = np.where(repeated, (values - mean[group]) * enlarged, np.nan)
    return CycleSplit(everywhere, sizes, mean, rest)


def lack_of_fit(residual: Float[np.ndarray, " n"], time: Float[np.ndarray, " n"], frequency: float) -> LackOfFit | None:
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
    independent = _independent(split, time)
    sigmas = _sigmas(between, within, (phases - 1) * independent, (samples - phases) * independent)
    return LackOfFit(float(np.sqrt(within)), float(np.sqrt(misfit)), sigmas)


def _independent(split: CycleSplit, time: Float[np.ndarray, " n"]) -> float:
    """Independent samples of the noise a sample, by those of a cycle."""
    freedom = float(np.sum(np.isfinite(split.rest)))
    noise = noise_at(time, split.rest, freedom, split.sizes.size // 2)
    return noise.independent(time[: split.sizes.size])


def _sigmas(between: float, within: float, above: float, below: float) -> float:
    """How unlikely a ratio of mean squares is, as a normal deviate (E. Paulson, Ann. Math. Statist. 13, 1942)."""
    if within <= 0.0:
        return float("inf") if between > 0.0 else 0.0
    root = (between / within) ** (1.0 / 3.0)
    a, b = 2.0 / (9.0 * above), 2.0 / (9.0 * below)
    return float(((1.0 - b) * root - (1.0 - a)) / np.sqrt(b * root**2 + a))
