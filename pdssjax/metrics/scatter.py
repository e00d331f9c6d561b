"""A first guess of the noise of samples, from the scatter of neighbours."""

import numpy as np
from jaxtyping import Float

from .neighbours import neighbour_scatter


def scatter_floor(measured: Float[np.ndarray, " samples"]) -> float:
    """A first guess of the noise from the scatter of second differences, in the samples' unit; above zero."""
    scatter = neighbour_scatter(measured)
    if measured.size < 8:
        return scatter or 1e-9
    return max(scatter, 1e-4 * float(np.std(measured)), 1e-12)


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
