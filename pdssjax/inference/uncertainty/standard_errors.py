"""Standard errors of a fit, by every method and loss: of white noise, enlarged where residuals exceed the noise given.

A fit in two steps has the first step's errors carried on (`two_steps`), and beside them the naive ones, which take the
first step for exact.  What peaks tell of a stack is a first step whose samples are their readings.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ..covariance import Covariance, least_squares_covariance
from ..least_squares import Fit, Method
from ..problem import Problem
from ..stack_first.peak_picking import PATHS, PickedStack
from ..stack_parameters import of_stack, stack_rows
from .parameter_errors import FittedPoint, fitted_point, influence_at, two_steps
from .robust_covariance import robust_covariance
from .students_t import effective_freedom
from .two_steps import TwoSteps
from .variance_factor import noise_freedom, row_factors, variance_factor


class StandardErrors(NamedTuple):
    """Of p free numbers, on the fit's scale."""

    known: Covariance
    """Enlarged by the `factor`."""
    naive: Float[np.ndarray, "p p"] | None
    """The covariance that takes the first of two steps for exact, enlarged as well; None of a joint fit."""
    with_told: Float[np.ndarray, " p"]
    """Covariance of each estimate with what was measured apart of it, which the estimate follows; no other counts."""
    factor: float
    """By which variances exceed those of the noise given; 1 under a robust loss, which takes the scatter from the
    residuals."""
    freedom: Float[np.ndarray, " p"]
    """Degrees of freedom of the noise that each standard error rests on; infinite where it is known."""


def standard_errors_of(method: Method, problem: Problem, fit: Fit, stack: PickedStack | None) -> StandardErrors:
    """The covariances of a `fit`; with a `stack` from peaks its own is that of the first step."""
    if problem.residual.loss.is_robust:
        return _robust(problem, fit)
    point, naive = fitted_point(method, problem, fit), None
    whole = least_squares_covariance(point.jacobian, problem.residual.transform.at_bound(fit.free))
    factor = variance_factor(problem, fit, after_stack=stack is not None)
    factors, unknown = row_factors(problem, factor), ~point.known
    if method == "joint":
        effect = influence_at(point)
    else:
        steps = two_steps(point) if stack is None else _after_peaks(point, stack)
        factors = np.append(factors, np.ones(len(steps.first) - factors.size))
        if stack is not None:
            unknown |= of_stack(problem) & ~problem.residual.transform.among(PATHS)
        effect = steps.influence()
        naive = _covariance(steps.apart().influence(), factors, unknown)
    known = whole._replace(matrix=_covariance(effect, factors, unknown))
    squares = factors[:, None] * effect**2
    shares = [np.sum(squares[rows], axis=0) for rows in problem.rows]
    noise = noise_freedom(problem, fit, factor, after_stack=stack is not None)
    freedom = effective_freedom(np.diag(known.matrix), shares, *noise)
    return StandardErrors(known, naive, _with_told(point, effect, stack), factor, freedom)


def _covariance(
    effect: Float[np.ndarray, "n p"], factors: Float[np.ndarray, " n"], unknown: Bool[np.ndarray, " p"]
) -> Float[np.ndarray, "p p"]:
    matrix = effect.T @ (factors[:, None] * effect)
    matrix[unknown] = np.nan
    matrix[:, unknown] = np.nan
    return matrix


def _after_peaks(point: FittedPoint, stack: PickedStack) -> TwoSteps:
    """The steps of a fit after `stack`, whose readings are further rows below the residuals."""
    paths, platform = point.problem.residual.transform.paths, stack_rows(point.problem)
    earlier = np.array([i for i, path in enumerate(paths) if path in PATHS and point.known[i]], int)
    later = np.flatnonzero(~of_stack(point.problem) & point.known)
    places = [PATHS.index(paths[i]) for i in earlier]
    readings = np.zeros((earlier.size, len(paths)))
    readings[:, earlier] = np.linalg.inv(np.linalg.cholesky(stack.covariance[np.ix_(places, places)]))
    walks = point.jacobian * ~platform[:, None]
    return TwoSteps(np.concatenate([0.0 * walks, readings]), np.concatenate([walks, 0.0 * readings]), earlier, later)


def _with_told(
    point: FittedPoint, effect: Float[np.ndarray, "n p"], stack: PickedStack | None
) -> Float[np.ndarray, " p"]:
    """The effect of a told number is that of its row, whose error is 1 over its Jacobian on this scale."""
    residual, out = point.problem.residual, np.zeros(effect.shape[1])
    for row, path in enumerate(residual.apart, point.problem.rows_apart.start):
        place = residual.transform.paths.index(path)
        if stack is not None and path in PATHS:
            out[place] = stack.covariance[PATHS.index(path), PATHS.index(path)]
        elif point.jacobian[row, place] != 0.0:
            out[place] = effect[row, place] / point.jacobian[row, place]
    return out


def _robust(problem: Problem, fit: Fit) -> StandardErrors:
    loss, held = problem.residual.loss, problem.residual.transform.at_bound(fit.free)
    roots, jacobian = np.asarray(fit.state.residual), np.asarray(fit.state.jacobian)
    samples, apart = slice(problem.rows_apart.start), jacobian[problem.rows_apart]
    known, bread = robust_covariance(roots[samples], jacobian[samples], held, loss, apart)
    given = np.sum((apart @ np.nan_to_num(bread)) ** 2, axis=0)
    left = max(samples.stop - known.identifiable.sum(), 1)
    variance = np.diag(known.matrix)
    freedom = effective_freedom(variance, [variance - given], [left], [False])
    return StandardErrors(known, None, np.diag(bread), 1.0, freedom)
