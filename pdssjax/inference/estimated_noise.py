"""The noise of records that a study does not give: estimated from what a fit leaves, which is fitted again with it."""

import numpy as np
from jaxtyping import Float

from .fit_statistics import degrees_taken
from .least_squares import Fit, FitMethod, Progress, by_record, summed
from .problem import Problem

_FEWEST, _MOST = 2, 10
"""Times that the noise is found and fitted with; a first guess from a few samples may be far too large."""

_SETTLED = 0.02
"""Relative change of the noise that is none."""


def with_noise(fit: Fit, problem: Problem, run: FitMethod, report: Progress) -> tuple[Fit, Problem]:
    """Estimates the noise of the records that do not give it, and fits again with that."""
    unknown = [record.noise is None for record in problem.records]
    for number in range(_MOST):
        if not any(unknown) or not np.isfinite(fit.chi2):
            break
        noise = np.where(unknown, _noise_left(problem, fit), problem.noise)
        if number >= _FEWEST and np.allclose(noise, problem.noise, rtol=_SETTLED, atol=0.0):
            break
        report("weighing the records by the noise found")
        problem = problem._replace(noise=noise)
        fit = summed(run(problem, problem.decode(fit.free), report), [fit])
    return fit, problem


def _noise_left(problem: Problem, fit: Fit) -> Float[np.ndarray, " records"]:
    """Standard deviation of each record's residuals, in its unit."""
    sizes = np.array([record.time.size for record in problem.records])
    scatter, parts = problem.residual.loss.scatter, by_record(problem, fit)
    pairs = zip(parts, sizes - degrees_taken(problem, fit), strict=True)
    return problem.noise * np.array([scatter(*pair) for pair in pairs])  # pyright: ignore[reportReturnType]
