"""What tells of a fit in one number: chi-square per degree of freedom, and the criteria of Akaike and of Schwarz (BIC).

    AIC = -2 log L + 2 p,   BIC = -2 log L + p log n,   -2 log L = chi2 + sum log(2 pi s^2)

with p fitted numbers, the free offsets among them, n samples, and the noise s of each.
"""

import numpy as np

from ..study import Statistics
from .least_squares import Fit
from .problem import Problem


def reduced_chi2(fit: Fit, problem: Problem) -> float:
    """Chi-square per degree of freedom."""
    return fit.chi2 / degrees_of_freedom(fit, problem)


def degrees_of_freedom(fit: Fit, problem: Problem) -> int:
    """Samples less what is fitted, the free offsets counted; at least 1."""
    offsets = sum(record.offset is None for record in problem.records)
    return max(np.size(fit.state.residual) - fit.free.size - offsets, 1)


def statistics_of(problem: Problem, fit: Fit) -> Statistics:
    """All that a report says of a fit in one number each."""
    measured = int(np.size(fit.state.residual))
    free = fit.free.size + sum(record.offset is None for record in problem.records)
    sizes = np.array([record.time.size for record in problem.records])
    # Minus twice the log-likelihood: the noise counts, where it is estimated.
    deviance = fit.chi2 + 2.0 * np.sum(sizes * np.log(problem.noise)) + measured * np.log(2.0 * np.pi)
    return Statistics(
        chi2=fit.chi2,
        reduced_chi2=reduced_chi2(fit, problem),
        aic=float(deviance + 2.0 * free),
        bic=float(deviance + np.log(measured) * free),
        evaluations=fit.evaluations,
        iterations=fit.iterations,
        samples=int(sizes.sum()),
        free=free,
        noise_estimated=all(record.noise is None for record in problem.records),
        measured_apart=measured - int(sizes.sum()),
    )
