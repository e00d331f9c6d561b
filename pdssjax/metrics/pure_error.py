"""Lack of fit of a record that repeats: residuals that are alike at the same phase of every cycle are no noise.

Residuals at equal phase are repeated measurements, whatever the model; what scatters among them is the
measurement's own noise ("pure error"), and what their means scatter beyond it is the model's misfit (R. A. Fisher's
test of lack of fit; N. R. Draper and H. Smith, Applied Regression Analysis, Wiley 1998, chapter 2).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

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


def lack_of_fit(residual: Float[np.ndarray, " n"], time: Float[np.ndarray, " n"], frequency: float) -> LackOfFit | None:
    """What repeats in the `residual` of a record, sampled at `time` [s], of a drive of so many cycles a second [Hz].

    Samples are grouped by phase: exactly where a cycle holds a whole number of sample intervals, else into bins as
    wide as one interval, within which a steep misfit counts as noise.

    **Returns:** None where fewer than two cycles, or than eight phases with two samples or more, were recorded.
    """
    finite = np.isfinite(residual)
    residual, time = residual[finite], time[finite]
    if residual.size < 16 or np.ptp(time) * frequency < 1.5:
        return None
    count = 1.0 / (frequency * float(np.median(np.diff(time))))
    cycles = np.ptp(time) * frequency
    exact = abs(count - round(count)) * cycles < _OFF_GRID
    phase = np.mod(time * frequency, 1.0) * (round(count) if exact else count)
    group = np.mod(np.round(phase), round(count)).astype(int) if exact else np.floor(phase).astype(int)
    sizes = np.bincount(group)
    means = np.bincount(group, residual) / np.maximum(sizes, 1)
    repeated = sizes[group] > 1
    phases, samples = int(np.sum(sizes > 1)), int(np.sum(repeated))
    if phases < 8 or samples <= phases:
        return None
    within = np.sum((residual - means[group])[repeated] ** 2) / (samples - phases)
    centre = np.mean(residual[repeated])
    between = np.sum((means[group] - centre)[repeated] ** 2) / (phases - 1)
    misfit = max(between - within, 0.0) * (phases - 1) / samples
    return LackOfFit(
        float(np.sqrt(within)), float(np.sqrt(misfit)), _sigmas(between, within, phases - 1, samples - phases)
    )


def _sigmas(between: float, within: float, above: int, below: int) -> float:
    """How unlikely a ratio of mean squares is, as a normal deviate (E. Paulson, Ann. Math. Statist. 13, 1942)."""
    if within <= 0.0:
        return float("inf") if between > 0.0 else 0.0
    root = (between / within) ** (1.0 / 3.0)
    a, b = 2.0 / (9.0 * above), 2.0 / (9.0 * below)
    return float(((1.0 - b) * root - (1.0 - a)) / np.sqrt(b * root**2 + a))
