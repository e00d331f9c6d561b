"""What the samples of a voltage leave open of its fast flanks: how long they last, and when they begin."""

import math
from typing import NamedTuple

from .sharpened_flanks import SharpFlanks

JUMP = 1.6
"""Sampling intervals up to which a flank cannot be told from a jump."""

_SURE = 5.0
"""Standard errors within which what least squares tell of a flank is taken to lie."""


class Timing(NamedTuple):
    """What the samples of a voltage leave open of its fast flanks."""

    shortest: float
    """Duration that such a flank may have [s]."""
    longest: float
    """The same."""
    within: float
    """By so much the drive may start earlier or later [s]."""
    errors: tuple[float, float] | None = None
    """Standard errors of duration and start [s] where samples on flanks locate them; None where only bounds are known.
    """


def timing_of(sharp: SharpFlanks | None, seen: float, interval: float) -> Timing:
    """Of fast flanks that were located, or else seen between two levels to last so long, 0 where no sample shows it."""
    if sharp is None and seen:
        # Two levels with few samples between tell too long a flank.
        return Timing(max(0.5 * seen - interval, 0.0), 1.5 * seen + interval, 0.5 * seen + interval)
    if sharp is None:
        return Timing(0.0, JUMP * interval, 2.0 * interval)
    about, within = _SURE * sharp.duration_error, _SURE * sharp.start_error
    errors = sharp.duration_error, sharp.start_error
    return Timing(max(sharp.duration - about, 0.0), sharp.duration + about, within, errors)


def widened(timing: Timing, error: float) -> Timing:
    """`timing` where what the flanks are told by has an `error` of its own, as a time [s]."""
    shortest, longest, within, errors = timing
    about = _SURE * error
    both = None if errors is None else (math.hypot(errors[0], error), math.hypot(errors[1], error))
    return Timing(max(shortest - about, 0.0), longest + about, within + about, both)
