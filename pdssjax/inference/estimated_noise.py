"""The noise of records that a study does not give: estimated from what a fit leaves, which is fitted again with it."""

import numpy as np
from jaxtyping import Float

from .least_squares import Fit, FitMethod, Progress, by_record, summed
from .problem import Problem


def with_noise(fit: Fit, problem: Problem, run: FitMethod, report: Progress) -> tuple[Fit, Problem]:
    """Estimates the noise of the records that do not give it, and fits again with that."""
    unknown = [record.noise is None for record in problem.records]
    for _ in range(2):
        if not any(unknown) or not np.isfinite(fit.chi2):
            break
        report("weighing the records by the noise found")
        problem = problem._replace(noise=np.where(unknown, _noise_left(problem, fit), problem.noise))
        fit = summed(run(problem, problem.decode(fit.free), report), [fit])
    return fit, problem


def _noise_left(problem: Problem, fit: Fit) -> Float[np.ndarray, " records"]:
    """Standard deviation of each record's residuals, in its unit, degrees of freedom shared by samples."""
    sizes = np.array([record.time.size for record in problem.records])
    degrees_taken = fit.free.size * sizes / sizes.sum() + [record.offset is None for record in problem.records]
    scatter, parts = problem.residual.loss.scatter, by_record(problem, fit)
    return problem.noise * [scatter(*pair) for pair in zip(parts, sizes - degrees_taken, strict=True)]
