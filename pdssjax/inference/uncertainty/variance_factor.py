"""By how much variances grow where residuals are larger than the noise given."""

import numpy as np

from ...study import Statistics
from ..least_squares import Fit
from ..problem import Problem
from ..stack_parameters import of_platform_alone, of_stack, stack_rows

NORMAL_95 = 1.959964
"""Half width of a 95 % interval in standard errors."""


def variance_factor(statistics: Statistics) -> float:
    """By how much variances grow with residuals that are larger than the noise given; they never shrink."""
    return max(1.0, statistics.reduced_chi2) if statistics.reduced_chi2 < np.inf else 1.0


def second_step_factor(problem: Problem, fit: Fit) -> float:
    """The variance factor by the records that do not show the platform alone, where that was not fitted to."""
    used = ~of_platform_alone(problem.records)
    samples = ~stack_rows(problem)
    offsets = sum(record.offset is None for record, use in zip(problem.records, used, strict=True) if use)
    fitted = int(np.sum(~of_stack(problem)))
    chi2 = float(np.sum(np.asarray(fit.state.residual)[samples] ** 2))
    factor = chi2 / max(int(samples.sum()) - fitted - offsets, 1)
    return max(1.0, factor) if np.isfinite(factor) else 1.0
