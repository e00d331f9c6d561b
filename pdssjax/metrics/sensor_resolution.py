"""The step in which a sensor counts, seen in its samples."""

import numpy as np
from jaxtyping import Float


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
