"""The step in which a sensor counts, seen in its samples."""

import math

import numpy as np
from jaxtyping import Float

from .sample_noise import scatter_floor


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


def rounding_of_counts(measured: Float[np.ndarray, " samples"]) -> float:
    """The standard deviation of what counting in steps rounds, in the samples' unit; 0 where no step is seen."""
    return (resolution_of(measured) or 0.0) / math.sqrt(12.0)


def counts_without_noise(measured: Float[np.ndarray, " samples"]) -> bool:
    """Whether samples are counted in steps that hide their noise: neighbours scatter less than rounding alone does."""
    return rounding_of_counts(measured) > scatter_floor(measured)
