"""How a least-squares run may end; only three of the ways are success, and a fourth may be."""

import enum


class Ending(enum.IntEnum):
    """How a run ended."""

    RUNNING = 0
    CONVERGED = 1
    """Projected gradient and predicted reduction are small."""
    WITHIN_ROUNDING = 2
    """Steps are rejected, or hardly gain anything, and the predicted reduction could not be seen in the data."""
    SLOW_STEPS = 3
    """Many accepted steps in a row hardly lowered the sum of squares, although the model predicts more."""
    STALLED = 4
    """No step lowers the sum of squares, although the gradient is small: the Jacobian is all but singular."""
    REJECTED = 5
    """No step lowers the sum of squares, although gradient and predicted reduction are not small."""
    DISCONTINUITY = 6
    """The residual has a jump where the run ended."""
    WRONG_DERIVATIVE = 7
    """The Jacobian disagrees with differences of the residual."""
    START_FAILED = 8
    """The start could not be evaluated."""
    SMALL_JUMP = 9
    """Converged but for a jump of the residual that is too small to matter; the predicted reduction is no larger."""
    KINK = 10
    """The residual's slope changes where the run ended; a minimum where the slopes on both sides say so (`kink`)."""


STOPPED = (Ending.SLOW_STEPS, Ending.STALLED, Ending.REJECTED)
"""Endings of runs whose steps led no further although the linear model promised more."""

SUCCESSES = (Ending.CONVERGED, Ending.WITHIN_ROUNDING, Ending.SMALL_JUMP)
