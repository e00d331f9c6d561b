"""Statistics of a fit: chi-square per degree of freedom, and the criteria of Akaike (AIC) and Schwarz (BIC).

    AIC = -2 log L + 2 p,   BIC = -2 log L + p log n,   -2 log L = chi2 + 2 sum log(s Z)

with p fitted numbers, the free offsets among them, n samples and what was measured apart, and the noise s of each
sample.  Z makes the loss a likelihood: sqrt(2 pi) for squares.
"""

import numpy as np
from jaxtyping import Float

from ..study import Statistics
from .covariance import NO_INFORMATION
from .least_squares import Fit
from .problem import Problem
from .stack_parameters import of_platform_alone, of_stack, stack_rows


def reduced_chi2(fit: Fit, problem: Problem) -> float:
    """Chi-square per degree of freedom."""
    return fit.chi2 / degrees_of_freedom(fit, problem)


def degrees_of_freedom(fit: Fit, problem: Problem) -> int:
    """Samples less what is fitted, the free offsets counted; at least 1."""
    offsets = sum(record.offset is None for record in problem.records)
    return max(np.size(fit.state.residual) - fit.free.size - offsets, 1)


def degrees_taken(problem: Problem, fit: Fit, after_stack: bool = False) -> Float[np.ndarray, " records"]:
    """Degrees of freedom that the fit takes from each record: its information on the parameters, and a free offset.

    A few precise samples may tell nearly all, and then are followed nearly exactly.  With `after_stack` of the second
    of two steps: what is fitted after the stack, to what does not show the platform alone.
    """
    used, fitted = np.ones(len(problem.records), bool), np.ones(fit.free.size, bool)
    jacobian = np.asarray(fit.state.jacobian)
    if after_stack:
        used, fitted = ~of_platform_alone(problem.records), ~of_stack(problem)
        jacobian = jacobian * ~stack_rows(problem)[:, None]
    sizes = np.array([record.time.size for record in problem.records], float) * used
    offsets = np.array([record.offset is None for record in problem.records]) & used
    norms, count = np.linalg.norm(jacobian, axis=0), int(np.sum(fitted))
    kept = fitted & ~problem.residual.transform.at_bound(fit.free) & (norms > 0)
    if not kept.any() or not np.isfinite(norms).all():
        return count * sizes / max(sizes.sum(), 1.0) + offsets
    basis, singular, _ = np.linalg.svd(jacobian[:, kept] / norms[kept], full_matrices=False)
    leverage = np.sum(basis[:, singular > NO_INFORMATION * singular[0]] ** 2, axis=1)
    # Those at bounds and those without information count, too, as they do in all.
    told = leverage * count / np.sum(leverage)
    return np.array([np.sum(told[rows]) for rows in problem.rows]) + offsets


def statistics_of(problem: Problem, fit: Fit) -> Statistics:
    """The statistics of a fit for its report."""
    measured = int(np.size(fit.state.residual))
    free = fit.free.size + sum(record.offset is None for record in problem.records)
    sizes = np.array([record.time.size for record in problem.records])
    # Minus twice the log-likelihood: the noise counts, where it is estimated.
    deviance = fit.chi2 + 2.0 * np.sum(sizes * (np.log(problem.noise) + problem.residual.loss.log_volume()))
    # But for a constant: the errors of what was measured apart.
    deviance += (measured - sizes.sum()) * np.log(2.0 * np.pi)
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
