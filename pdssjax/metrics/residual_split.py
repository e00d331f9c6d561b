"""The residuals of a record as misfit and noise: what repeats every cycle, the rest, and the colour of the rest."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .noise_at_times import Noise, noise_at
from .pure_error import CycleSplit, split_by_phase


class ResidualSplit(NamedTuple):
    """Of n samples."""

    cycles: CycleSplit | None
    """The mean over the cycles at each phase; None where the record does not repeat."""
    rest: Float[np.ndarray, " n"]
    """What does not repeat, enlarged for the means taken out; all of it where the record does not repeat."""
    noise: Noise
    """What `rest` is a sample of."""
    freedom: float
    """Its degrees of freedom."""


def split_residuals(
    residual: Float[np.ndarray, " n"],
    time: Float[np.ndarray, " n"],
    frequency: float | None,
    freedom: float = float("inf"),
) -> ResidualSplit:
    """The `residual` of a record, sampled at `time` [s], split; NaN is left out.

    **Arguments:** cycles of the drive a second [Hz], None where it does not repeat; the `freedom` that a fit leaves of
    the samples, where nothing repeats: variances grow by what it has taken out.
    """
    cycles = None if frequency is None else split_by_phase(residual, time, frequency)
    if cycles is None:
        samples = float(np.sum(np.isfinite(residual)))
        freedom = min(freedom, samples)
        return ResidualSplit(None, residual, noise_at(time, residual, freedom, residual.size), freedom)
    # Enlarged by m/(m - 1) already: each of the rest counts.
    samples = float(np.sum(np.isfinite(cycles.rest)))
    noise = noise_at(time, cycles.rest, samples, cycles.sizes.size // 2)
    return ResidualSplit(cycles, cycles.rest, noise, samples)
