"""A first guess of the noise of samples, from the scatter of neighbours."""

import numpy as np
from jaxtyping import Float

_FAR = 3.0
"""Standard deviations from which a second difference counts as motion, not noise."""

_KEPT = 0.98658
"""Standard deviation of a normal variable cut off there."""


def scatter_floor(measured: Float[np.ndarray, " samples"]) -> float:
    """A first guess of the noise from the scatter of second differences, in the samples' unit.

    Robust against the fast motion of a slip, which fills few samples: what lies far out is
    left out again and again.  A smooth motion between samples hardly enters, and rounding
    no more than it does in the noise itself.
    """
    if measured.size < 8:
        return float(np.std(measured)) or 1e-9
    bends = np.abs(np.diff(measured, 2))
    spread = 1.4826 * float(np.median(bends))
    for _ in range(20):
        near = bends[bends <= _FAR * spread] if spread > 0 else bends
        spread = float(np.sqrt(np.mean(near**2))) / _KEPT
    return max(spread / np.sqrt(6.0), 1e-4 * float(np.std(measured)), 1e-12)


def resolution_of(measured: Float[np.ndarray, " samples"]) -> float | None:
    """The step in which samples are counted, in their unit; None where none is seen."""
    levels = np.unique(measured)
    if levels.size < 3:
        return None
    steps = np.diff(levels)
    step = float(np.min(steps[steps > 1e-9 * np.ptp(levels)]))
    counts = steps / step
    near = np.abs(counts - np.round(counts)) < 0.05 + 1e-6 * counts
    return float(np.sum(steps[near]) / np.sum(np.round(counts[near]))) if np.mean(near) > 0.98 else None
