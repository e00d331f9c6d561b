"""How much later than predicted the slips of a walk come, by what is left of the motion where it is fastest.

A motion x that comes later by d leaves - x' d.  In the slips x' is some hundred times that of the slow flanks, so a
line of the residuals there against x' has the slope - d, whatever the level at which they lie.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

_SLIPPING = 0.2
"""Part of the largest rate from which on a motion slips."""

_FASTER = 5.0
"""Times the usual rate that it is, at least."""

_LEAST = 6
"""Samples in slips."""


class SlipDelay(NamedTuple):
    """Of all slips of a record together."""

    delay: float
    """By how much later than predicted they come [s]."""
    standard_error: float
    """[s]"""
    explains: float
    """Share of the sum of squares that is left in the slips, about its mean, that this delay explains [1]."""


def slip_delay(
    time: Float[np.ndarray, " n"], predicted: Float[np.ndarray, " n"], residual: Float[np.ndarray, " n"]
) -> SlipDelay | None:
    """By how much later slips come than `predicted` [m] at `time` [s], by the `residual` (measured less predicted).

    None where no part of the motion is much faster than the rest, or too few samples lie in it.  NaN is left out.
    """
    rate = np.gradient(predicted, time)
    fast, usual = float(np.max(np.abs(rate))), float(np.median(np.abs(rate)))
    slips = (np.abs(rate) > max(_SLIPPING * fast, _FASTER * usual)) & np.isfinite(residual)
    if np.count_nonzero(slips) < _LEAST:
        return None
    moves, left = rate[slips] - np.mean(rate[slips]), residual[slips] - np.mean(residual[slips])
    size = float(moves @ moves)
    if size == 0.0 or not np.any(left):
        return None
    delay = -float(moves @ left) / size
    unexplained = left + delay * moves
    error = float(np.sqrt(unexplained @ unexplained / (left.size - 2) / size))
    return SlipDelay(delay, error, 1.0 - float(unexplained @ unexplained) / float(left @ left))
