"""Samples that stand out of a record's residuals: glitches, which are neither noise nor misfit."""

import numpy as np
from jaxtyping import Float, Int

from .pure_error import split_by_phase
from .sensor_resolution import resolution_of

_LONGEST = 5
"""Samples in a row that may be a glitch; longer ones are misfit."""

_SIGMAS = 7.0
"""Robust standard deviations from which a sample stands out: of normal noise one in 4e11."""

_TO_DEVIATION = 1.4826
"""Standard deviation of normal noise over the median of its sizes."""

_BESIDE = 0.2
"""Share of a glitch by which the samples on either side of it may be off."""

_SHIFTED = 0.4
"""Share of a residual left by a shift in time that explains it; in a steep motion one of a glitch leaves a half."""

_AROUND = 2
"""Samples on either side that a shift must not throw off."""


def outliers(
    measured: Float[np.ndarray, " n"],
    predicted: Float[np.ndarray, " n"],
    time: Float[np.ndarray, " n"],
    frequency: float | None,
) -> Int[np.ndarray, " k"]:
    """Indices of the samples `measured` at `time` [s] that stand out of the residuals in runs of at most five.

    What repeats every cycle of a drive of that `frequency` [Hz] is misfit, and its median at each phase is taken off
    first; the scale is the median of absolute deviations, which glitches hardly move, or of the changes from one cycle
    to the next: of three cycles one is the median itself, and deviates by nothing.  A slip `predicted` a few
    samples too early or too late leaves residuals as short, and is none: a shift in time explains it.  Nor is what
    a sensor that counts in steps leaves: less than a step.
    """
    residual = measured - predicted
    finite = np.isfinite(residual)
    if not finite.any():
        return np.zeros(0, int)
    left = residual - np.median(residual[finite])
    split = None if frequency is None else split_by_phase(residual, time, frequency)
    changes = [np.zeros(0)]
    if split is not None:
        for phase in np.flatnonzero(split.sizes > 2):
            members = split.group == phase
            changes.append(np.diff(left[members]))
            left[members] -= np.median(left[members])
    scale = _TO_DEVIATION * max(_middle(left[finite]), _middle(np.concatenate(changes)) / np.sqrt(2.0))
    if scale <= 0.0:
        return np.zeros(0, int)
    far = np.abs(np.nan_to_num(left)) > max(_SIGMAS * scale, resolution_of(measured[finite]) or 0.0)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], far, [False]]).astype(int)))
    runs = [np.arange(begin, end) for begin, end in zip(edges[::2], edges[1::2], strict=True)]
    short = [run for run in runs if run.size <= _LONGEST]
    glitches = [run for run in short if _is_alone(left, run) and not _is_shifted(left, predicted, run)]
    return np.concatenate([np.zeros(0, int), *glitches])


def _middle(deviations: Float[np.ndarray, " k"]) -> float:
    """Median of the sizes."""
    return float(np.median(np.abs(deviations))) if deviations.size else 0.0


def _is_alone(left: Float[np.ndarray, " n"], run: Int[np.ndarray, " k"]) -> bool:
    """The samples on either side are hardly off: a smooth misfit leaves them off, too."""
    beside = left[[i for i in (int(run[0]) - 1, int(run[-1]) + 1) if 0 <= i < left.size]]
    return float(np.nanmax(np.abs(beside), initial=0.0)) < _BESIDE * float(np.max(np.abs(left[run])))


def _is_shifted(left: Float[np.ndarray, " n"], predicted: Float[np.ndarray, " n"], run: Int[np.ndarray, " k"]) -> bool:
    """The prediction some samples earlier or later would leave little there, and of the samples around."""
    places = np.arange(left.size)
    around = places[max(run[0] - _AROUND, 0) : run[-1] + _AROUND + 1]
    sizes = [
        np.nanmax(np.abs(left[around] + predicted[around] - np.interp(around + shift, places, predicted)))
        for shift in np.arange(-_LONGEST, _LONGEST + 0.5, 0.5)
    ]
    return min(sizes) < _SHIFTED * float(np.max(np.abs(left[run])))
