"""The carry of a Levenberg-Marquardt run, from one iteration to the next."""

from typing import Any, NamedTuple, TypeAlias

from jaxtyping import Array, Float

from ...core import Count, Truth

Auxiliary: TypeAlias = Any
"""What the function gives besides the residuals, a pytree; of a fit the offsets of the records."""


class LMState(NamedTuple):
    """Of p parameters and n samples."""

    residual: Float[Array, " n"]
    jacobian: Float[Array, "n p"]
    aux: Auxiliary
    aux_jacobian: Auxiliary
    """Of the function's auxiliary output, which costs nothing extra."""
    upper: Float[Array, "p p"]
    """Triangle R of the Jacobian's QR factorisation."""
    projected: Float[Array, " p"]
    """Q' times the residual."""
    size: Float[Array, " p"]
    """Largest norm seen of each column."""
    radius: Float[Array, ""]
    """Of the trust region, in columns of unit norm."""
    proposed_step: Float[Array, " p"]
    """The linear model's best step within the bounds, undamped."""
    predicted_reduction: Float[Array, ""]
    """Decrease of the sum of squares that the linear model predicts for it; never negative."""
    cosine: Float[Array, ""]
    """Largest cosine between the residual and a column that is free to move."""
    rounding: Float[Array, ""]
    """What the rounding of parameters and residual makes of the sum of squares."""
    unevaluated: Truth
    """Nothing has been evaluated yet: the first step takes the start as it is."""
    accepted: Truth
    iterations: Count
    """Linearisations after the first."""
    evaluations: Count
    """Of the function, without those for Jacobians."""
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
    """What the Jacobian leaves of each difference, as a norm; infinite where it could not be taken."""
    jump: Float[Array, ""]
    """Largest jump found by these differences, as a sum of squares (`derivative_check.jump_of`); 0 without any."""
    across: Float[Array, "2 p"]
    """A point on either side of the kink, where the run ended on one."""
