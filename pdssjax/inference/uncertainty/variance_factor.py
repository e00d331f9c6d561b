"""By how much variances grow where residuals are larger than the noise given."""

import numpy as np
from jaxtyping import Bool, Float

from ..fit_statistics import degrees_taken
from ..least_squares import Fit, by_record
from ..problem import Problem
from ..stack_parameters import of_platform_alone


def variance_factor(problem: Problem, fit: Fit, after_stack: bool = False) -> float:
    """By how much the variances given grow with residuals that are larger; they never shrink.

    By the records whose noise is given: noise that is estimated is that of the residuals already.  With `after_stack`
    by those of them that do not show the platform alone, where that was not fitted to.
    """
    counted = np.array([record.noise is not None for record in problem.records])
    if after_stack:
        counted &= ~of_platform_alone(problem.records)
    squares = np.array([np.sum(part**2) for part in by_record(problem, fit)])
    sizes = np.array([record.time.size for record in problem.records])
    freedom = np.sum((sizes - degrees_taken(problem, fit, after_stack))[counted])
    factor = float(np.sum(squares[counted]) / max(freedom, 1.0))
    return max(1.0, factor) if np.isfinite(factor) else 1.0


def noise_freedom(
    problem: Problem, fit: Fit, factor: float, after_stack: bool = False
) -> tuple[Float[np.ndarray, " records"], Bool[np.ndarray, " records"]]:
    """From how many degrees of freedom the noise of each record is known, and which records share theirs.

    Where it was estimated these are the record's own.  Noise that is given is known, but where residuals exceed it
    (`factor` above 1) it is as large as those of all such records say.
    """
    given = np.array([record.noise is not None for record in problem.records])
    sizes = np.array([record.time.size for record in problem.records])
    left = sizes - degrees_taken(problem, fit, after_stack)
    counted = given & ~of_platform_alone(problem.records) if after_stack else given
    together = max(float(np.sum(left[counted])), 1.0) if factor > 1.0 else np.inf
    return np.where(given, together, np.maximum(left, 1.0)), given


def record_factors(problem: Problem, factor: float) -> Float[np.ndarray, " records"]:
    """The `factor` for records whose noise is given, 1 for the others."""
    return np.array([1.0 if record.noise is None else factor for record in problem.records])


def row_factors(problem: Problem, factor: float) -> Float[np.ndarray, " n"]:
    """The same for all residuals; what was measured apart has the error given, whatever the samples are off by."""
    sizes = [record.time.size for record in problem.records]
    return np.append(np.repeat(record_factors(problem, factor), sizes), np.ones(len(problem.residual.apart)))
