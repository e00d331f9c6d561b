"""The errors of every parameter by all error models."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ...core import member, members
from ...study import Estimate, FittedParameter, ParameterError, cycles_a_second
from ..covariance import least_squares_covariance
from ..fit_statistics import degrees_taken
from ..least_squares import Fit, Method, Progress, evaluated
from ..parameter_transform import ParameterTransform
from ..poor_fit import leaves_unresolved
from ..problem import Problem
from ..stack_parameters import of_platform_alone, of_stack, stack_rows
from .error_advice import EVIDENT, advise
from .error_models.base import AbstractErrorModel, RecordErrors, total_of
from .influence import curvature_of, influence_of, principal_directions
from .linear_intervals import linear_intervals
from .students_t import effective_freedom
from .two_steps import TwoSteps
from .variance_factor import noise_freedom, record_factors, variance_factor


class FittedPoint(NamedTuple):
    """Where a fit ended, of p parameters and n samples."""

    method: Method
    problem: Problem
    fit: Fit
    residual: Float[np.ndarray, " n"]
    jacobian: Float[np.ndarray, "n p"]
    fitted: Bool[np.ndarray, " p"]
    """The parameters that the records move: not held at a bound."""
    known: Bool[np.ndarray, " p"]
    """Those of them that the records determine."""
    outlying: Bool[np.ndarray, " n"] | None = None
    """Which samples stand out, as the records of the estimate have it; None where no error model asks."""


class _ByModel(NamedTuple):
    """What an error model says of p parameters, on the fit's scale."""

    matrix: Float[np.ndarray, "p p"]
    """Their covariance, NaN where not known."""
    freedom: Float[np.ndarray, " p"]
    """Degrees of freedom of the noise that it rests on."""
    evidence: list[float]
    """Of each record."""


def all_error_models() -> list[AbstractErrorModel]:
    """All of them, from the strictest assumption to the weakest."""
    found = [
        member("inference.uncertainty.error_models", name)() for name in members("inference.uncertainty.error_models")
    ]
    return sorted(found, key=lambda model: model.rank)


def with_error_models(estimate: Estimate, problem: Problem, fit: Fit, report: Progress) -> Estimate:
    """An `estimate` of a `fit` with the errors of its parameters by all error models, and which of them to believe.

    As it is where the fit could not start, or no parameter has an error.
    """
    point = fitted_point(estimate.method, problem, fit)
    if not point.known.any() or not np.isfinite(point.residual).all() or not np.isfinite(point.jacobian).all():
        return estimate
    point = point._replace(outlying=_outlying(estimate, problem, point.residual.size))
    factor = variance_factor(problem, fit)
    found = _covariances(point, all_error_models(), factor, None)
    evidence = {name: told.evidence for name, told in found.items()}
    if any(most >= EVIDENT for shares in evidence.values() for most in shares):
        # Residuals that are not white do not average out in the second derivative of chi-square.
        found |= _covariances(point, all_error_models()[1:], factor, _curvatures(point, report))
    free = problem.residual.transform
    parameters = _with_errors(estimate.parameters, found, free, fit.free)
    slopes = np.abs(free.slope(fit.free))
    fitted = [record for record in estimate.records if record.role == "fit"]
    # Rounding follows the motion as a misfit does, and is none.
    misfits = zip(fitted, evidence["with-misfit"], strict=True)
    evidence["with-misfit"] = [0.0 if leaves_unresolved(record) else most for record, most in misfits]
    advice = advise(parameters, evidence, [record.name for record in problem.records])
    if advice is not None and not estimate.converged:
        advice = advice._replace(
            reason=f"The fit did not converge: its errors are those of no optimum. {advice.reason}"
        )
    return dataclasses.replace(
        estimate,
        parameters=parameters,
        error_advice=advice,
        covariances={name: told.matrix * np.outer(slopes, slopes) for name, told in found.items()},
    )


def fitted_point(method: Method, problem: Problem, fit: Fit) -> FittedPoint:
    """What error models need of where a fit ended."""
    jacobian, free = np.asarray(fit.state.jacobian), problem.residual.transform
    held = free.at_bound(fit.free)
    known = np.zeros(held.size, bool)
    if np.isfinite(jacobian).all():
        known = least_squares_covariance(jacobian, held).identifiable
    fitted = ~held & (np.linalg.norm(jacobian, axis=0) > 0)
    return FittedPoint(method, problem, fit, np.asarray(fit.state.residual), jacobian, fitted, known)


def _outlying(estimate: Estimate, problem: Problem, count: int) -> Bool[np.ndarray, " n"]:
    """Which of `count` residuals belong to samples that stand out, as the records of the `estimate` have it."""
    out = np.zeros(count, bool)
    fitted = [record for record in estimate.records if record.role == "fit"]
    for record, rows in zip(fitted, problem.rows, strict=True):
        out[rows][record.outliers] = True
    return out


def _record_errors(point: FittedPoint, factor: float, effect: Float[np.ndarray, "n p"]) -> list[RecordErrors]:
    """Every fitted record as error models take it; the `factor` is that of variances whose noise is given."""
    problem, taken = point.problem, degrees_taken(point.problem, point.fit)
    known_from, pooled = noise_freedom(problem, point.fit, factor)
    return [
        RecordErrors(
            point.residual[rows],
            point.jacobian[rows],
            effect[rows],
            record.time,
            cycles_a_second(record),
            float(of_record),
            max(record.time.size - float(degrees), 1.0),
            float(degrees_known),
            bool(is_pooled),
            None if point.outlying is None else point.outlying[rows],
        )
        for record, rows, of_record, degrees, degrees_known, is_pooled in zip(
            problem.records, problem.rows, record_factors(problem, factor), taken, known_from, pooled, strict=True
        )
    ]


def _covariances(
    point: FittedPoint,
    models: Sequence[AbstractErrorModel],
    factor: float,
    curvatures: Sequence[Float[np.ndarray, "p k"]] | None,
) -> dict[str, "_ByModel"]:
    """By name of the model."""
    effect = influence_at(point, curvatures)
    records, out = _record_errors(point, factor, effect), {}
    # What was measured apart has errors of its own, whatever those of the samples.
    apart = effect[point.problem.rows_apart]
    for model in models:
        shares = model.shares(records)
        matrix = total_of(shares) + apart.T @ apart
        matrix[~point.known] = np.nan
        matrix[:, ~point.known] = np.nan
        variances = [np.diag(share.covariance) for share in shares]
        freedom, pooled = [share.freedom for share in shares], [share.pooled for share in shares]
        known_from = effective_freedom(np.diag(matrix), variances, freedom, pooled)
        out[model.name] = _ByModel(matrix, known_from, [share.evidence for share in shares])
    return out


def influence_at(
    point: FittedPoint, curvatures: Sequence[Float[np.ndarray, "p k"]] | None = None
) -> Float[np.ndarray, "n p"]:
    """The effect of each residual on each parameter, on the fit's scale; zero of parameters that are not known.

    **Arguments:** `curvatures` of each record's residuals along the principal directions; None: none.
    """
    if point.method == "sequential":
        alone = of_platform_alone(point.problem.records)
        steps = None if curvatures is None else (_total(curvatures, alone), _total(curvatures, ~alone))
        return two_steps(point).influence(steps)
    out, kept = np.zeros(point.jacobian.shape), point.fitted
    total = None if curvatures is None else _total(curvatures, np.ones(len(curvatures), bool))[kept]
    out[:, kept] = influence_of(point.jacobian[:, kept], total)
    return out * point.known


def two_steps(point: FittedPoint) -> TwoSteps:
    """Those of a sequential fit."""
    first, stack = stack_rows(point.problem)[:, None], of_stack(point.problem)
    earlier, later = np.flatnonzero(stack & point.known), np.flatnonzero(~stack & point.known)
    return TwoSteps(point.jacobian * first, point.jacobian * ~first, earlier, later)


def _total(
    matrices: Sequence[Float[np.ndarray, "p k"]], used: Bool[np.ndarray, " records"]
) -> Float[np.ndarray, "p k"]:
    return sum((m for m, use in zip(matrices, used, strict=True) if use), np.zeros_like(matrices[0]))


def _curvatures(point: FittedPoint, report: Progress) -> list[Float[np.ndarray, "p k"]]:
    """Of each record: the sum of its residuals times their second derivatives, along the principal directions."""
    report("second derivatives, for errors where the model does not explain all")
    if point.method == "sequential":
        directions = two_steps(point).directions()
    else:
        spread = principal_directions(point.jacobian[:, point.fitted])
        directions = np.zeros((point.fitted.size, spread.shape[1]))
        directions[point.fitted] = spread

    def jacobian_at(free: Float[np.ndarray, " p"]) -> Float[np.ndarray, "n p"]:
        return np.asarray(evaluated(point.problem, free, lambda message: None).state.jacobian)

    rows, bounds = point.problem.rows, point.problem.bounds
    return curvature_of(jacobian_at, point.fit.free, point.residual, point.jacobian, directions, rows, bounds)


def _with_errors(
    parameters: Mapping[str, FittedParameter],
    found: Mapping[str, _ByModel],
    free: ParameterTransform,
    at: Float[np.ndarray, " p"],
) -> dict[str, FittedParameter]:
    """The `parameters` that have a standard error with those `found` by the error models."""
    errors: dict[str, dict[str, ParameterError]] = {path: {} for path in free.paths}
    slopes = np.abs(free.slope(at))
    bounds = {path: parameters[path].bounds for path in free.paths}
    for name, told in found.items():
        deviation = np.sqrt(np.diag(told.matrix))
        intervals = linear_intervals(at, deviation, told.freedom, free, bounds)
        for path, error, freedom in zip(free.paths, deviation * slopes, told.freedom, strict=True):
            errors[path][name] = ParameterError(float(error), intervals[path], float(freedom))
    return {
        path: dataclasses.replace(p, errors=errors[path]) if p.free and np.isfinite(p.standard_error) else p
        for path, p in parameters.items()
    }
