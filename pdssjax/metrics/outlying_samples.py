"""Samples that stand out of a record's residuals: glitches, which are neither noise nor misfit."""

import numpy as np
from jaxtyping import Float, Int

from .pure_error import split_by_phase

_LONGEST = 5
"""Samples in a row that may be a glitch; longer ones are misfit."""

_SIGMAS = 7.0
"""Robust standard deviations from which a sample stands out: of normal noise one in 4e11."""


def outliers(
    residual: Float[np.ndarray, " n"], time: Float[np.ndarray, " n"], frequency: float | None
) -> Int[np.ndarray, " k"]:
    """Indices of the samples of a `residual` at `time` [s] that stand out in runs of at most five.

    What repeats every cycle of a drive of that `frequency` [Hz] is misfit, and its median at each phase is taken off
    first; the scale is the median of absolute deviations, which glitches hardly move.  Of a record whose cycles do
    not repeat a misfit as short as a glitch cannot be told from one.
    """
    finite = np.isfinite(residual)
    if not finite.any():
        return np.zeros(0, int)
    left = residual - np.median(residual[finite])
    split = None if frequency is None else split_by_phase(residual, time, frequency)
    if split is not None:
        for phase in np.flatnonzero(split.sizes > 2):
            members = split.group == phase
            left[members] -= np.median(left[members])
    scale = 1.4826 * float(np.median(np.abs(left[finite])))
    if scale <= 0.0:
        return np.zeros(0, int)
    far = np.abs(np.nan_to_num(left)) > _SIGMAS * scale
    edges = np.flatnonzero(np.diff(np.concatenate([[False], far, [False]]).astype(int)))
    runs = [np.arange(begin, end) for begin, end in zip(edges[::2], edges[1::2], strict=True)]
    return np.concatenate([np.zeros(0, int), *(run for run in runs if run.size <= _LONGEST)])
