"""How a least-squares run may end, and the carry of a Levenberg-Marquardt run from one iteration to the next."""

import enum
from typing import Any, NamedTuple, TypeAlias

from jaxtyping import Array, Float

from ...core import Count, Truth


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

Vector: TypeAlias = Float[Array, " p"]
"""One number for each of p parameters."""

Auxiliary: TypeAlias = Any
"""Auxiliary output of the function beside the residuals, a pytree; in a fit the offsets of the records."""


class LMState(NamedTuple):
    """State of a Levenberg-Marquardt run with p parameters and n samples."""

    residual: Float[Array, " n"]
    jacobian: Float[Array, "n p"]
    aux: Auxiliary
    aux_jacobian: Auxiliary
    """The Jacobian of the function's auxiliary output, which costs nothing extra."""
    upper: Float[Array, "p p"]
    """Triangle R of the Jacobian's QR factorisation."""
    projected: Vector
    """Q' times the residual."""
    size: Vector
    """Largest norm seen of each column."""
    radius: Float[Array, ""]
    """Radius of the trust region, in columns of unit norm."""
    proposed_step: Vector
    """The linear model's best step within the bounds, undamped."""
    predicted_reduction: Float[Array, ""]
    """Decrease of the sum of squares that the linear model predicts for it; never negative."""
    cosine: Float[Array, ""]
    """Largest cosine between the residual and a column that is free to move."""
    rounding: Float[Array, ""]
    """Rounding error of the sum of squares, from that of parameters and residual."""
    unevaluated: Truth
    """Nothing has been evaluated yet: the first step takes the start as it is."""
    accepted: Truth
    iterations: Count
    """Linearisations after the first."""
    evaluations: Count
    """Evaluations of the function, without those for Jacobians."""
    rejected: Count
    """Proposed steps rejected in a row."""
    slow_steps: Count
    """Accepted steps in a row that hardly lowered the sum of squares."""
    curved: Truth
    """The last step found less than the linear model predicted, or was bent itself."""
    ending: Count
    """An `Ending`; RUNNING until the run is over."""
    checked: Count
    """Differences compared with the Jacobian so far."""
    discrepancies: Float[Array, "directions sizes"]
    """Discrepancy of each difference from the Jacobian, as a norm; infinite where it could not be taken."""
    jump: Float[Array, ""]
    """Largest jump found by these differences, as a sum of squares (`derivative_check.jump_of`); 0 without any."""
    across: Float[Array, "2 p"]
    """A point on either side of the kink, where the run ended on one."""
