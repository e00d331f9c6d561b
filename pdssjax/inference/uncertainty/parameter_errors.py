"""Standard errors by every method, loss and error model, and the advice which error model to believe.

`standard_errors_of` takes the noise as white and enlarges errors where residuals exceed the noise given.  A fit in two
steps propagates the first step's errors (`influence`) and also has naive errors, which take that step as exact; picked
peaks are a first step whose samples are their readings.  `with_error_models` adds the errors by every error model, and
`advise` names the last model whose assumption the residuals support, where that changes an error by more than 15 %.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ...core import member, members
from ...study import ErrorAdvice, Estimate, FittedParameter, ParameterError, cycles_a_second
from ..beyond_noise import leaves_unresolved
from ..covariance import Covariance, set_unknown
from ..evidence import Evidence
from ..least_squares import Method, Progress
from ..losses.base import AbstractLoss
from ..notes.about_records import listed
from ..stack_first.peak_picking import PATHS, PickedStack
from ..stack_parameters import stack_parameters
from .error_models.base import AbstractErrorModel, RecordErrors, total_of
from .influence import FittedPoint
from .linear_intervals import effective_freedom, linear_intervals, record_factors, row_factors

EVIDENT = 10.0
"""Evidence of a record for an error model (as of Akaike's criterion) from which the one before it is wrong: some four
standard deviations."""

MATTERS = 1.15
"""Ratio of a parameter's errors by two models from which it matters which one is believed."""


def advise(
    parameters: Mapping[str, FittedParameter], evidence: Mapping[str, Sequence[float]], records: Sequence[str]
) -> ErrorAdvice | None:
    """Which error model to believe, in one sentence.

    **Arguments:** `parameters` with their errors; the `evidence` of the fitted `records` for each model, from "white"
    on: by that of "coloured", neighbouring residuals are alike, by that of "with-misfit", more of them than noise
    explains is alike in all cycles (or smooth, in a record that does not repeat).

    **Returns:** None where no parameter has errors.
    """
    known = [parameter for parameter in parameters.values() if parameter.errors]
    if not known:
        return None
    slow, repeating = (_evident(evidence.get(name, ()), records) for name in ("coloured", "with-misfit"))
    grown, path = _most_changed(known, "coloured", "with-misfit")
    if repeating and grown >= MATTERS:
        return ErrorAdvice(
            "with-misfit",
            f"Believe the errors with misfit: residuals in {repeating} are alike from cycle to cycle, or smooth, "
            "beyond what noise explains, so the model errs there, and more data of the same kind do not average that "
            f"away. It makes errors up to {grown:.2g} times the coloured ones ({path}).",
        )
    ratio, path = _most_changed(known, "white", "coloured")
    if (slow or repeating) and not 1.0 / MATTERS < ratio < MATTERS:
        return ErrorAdvice(
            "coloured",
            f"Believe the coloured errors: residuals in {slow or repeating} are not independent of each other, and the "
            f"white ones are wrong by a factor of up to {max(ratio, 1.0 / ratio):.2g} ({path}); no misfit that makes a "
            "difference is seen.",
        )
    why = "the residuals are independent of each other, and none repeat beyond chance"
    if slow or repeating:
        why = f"what is not white in the residuals of {slow or repeating} changes no error by more than 15 %"
    return ErrorAdvice("white", f"The white errors hold: {why}.")


def _evident(evidence: Sequence[float], records: Sequence[str]) -> str:
    return listed(f'"{name}"' for name, most in zip(records, evidence, strict=False) if most >= EVIDENT)


def _most_changed(parameters: Sequence[FittedParameter], before: str, after: str) -> tuple[float, str]:
    """The ratio of errors by two models that is farthest from 1, and whose it is."""
    ratios = [
        (p.errors[after].standard_error / p.errors[before].standard_error, p.path)
        for p in parameters
        if p.errors[before].standard_error > 0 and p.errors[after].standard_error > 0
    ]
    return max(ratios, key=lambda pair: max(pair[0], 1.0 / pair[0]), default=(1.0, ""))


class _ByModel(NamedTuple):
    """Errors of p parameters by one error model."""

    matrix: Float[np.ndarray, "p p"]
    """Covariance of the parameters on their own scales, NaN where not known."""
    freedom: Float[np.ndarray, " p"]
    """Degrees of freedom of the noise that it rests on."""
    evidence: list[float]
    """Evidence of each record for the model."""


def all_error_models() -> list[AbstractErrorModel]:
    """All error models, from the strictest assumption to the weakest."""
    family = "inference.uncertainty.error_models"
    return sorted((member(family, name)() for name in members(family)), key=lambda model: model.rank)


def with_error_models(estimate: Estimate, evidence: Evidence, report: Progress) -> Estimate:
    """`estimate` with the errors of its parameters by all error models, and the advice which of them to believe.

    Unchanged where the fit could not start, or no parameter has an error.
    """
    problem, fit = evidence.problem, evidence.fit
    point = FittedPoint(estimate.method, evidence)
    if not point.known.any() or not np.isfinite(point.residual).all() or not np.isfinite(point.jacobian).all():
        return estimate
    found = _covariances(point, estimate, all_error_models(), None)
    for_models = {name: by_model.evidence for name, by_model in found.items()}
    if any(most >= EVIDENT for shares in for_models.values() for most in shares):
        # Residuals that are not white do not average out in the second derivative of chi-square.
        found |= _covariances(point, estimate, all_error_models()[1:], point.curvatures(report))
    free = problem.residual.transform
    slopes = np.abs(free.slope(fit.free))
    parameters = dict(estimate.parameters)
    bounds = {path: parameters[path].bounds for path in free.paths}
    for name, by_model in found.items():
        deviation = np.sqrt(np.diag(by_model.matrix))
        intervals = linear_intervals(free.own(fit.free), deviation, by_model.freedom, free, bounds)
        for path, error, freedom in zip(free.paths, deviation * slopes, by_model.freedom, strict=True):
            p = parameters[path]
            if np.isfinite(p.standard_error):
                by_name = {**p.errors, name: ParameterError(float(error), intervals[path], float(freedom))}
                parameters[path] = dataclasses.replace(p, errors=by_name)
    fitted = [record for record in estimate.records if record.role == "fit"]
    # Rounding follows the motion as a misfit does, and is none.
    misfits = zip(fitted, for_models["with-misfit"], strict=True)
    for_models["with-misfit"] = [0.0 if leaves_unresolved(record) else most for record, most in misfits]
    advice = advise(parameters, for_models, [record.name for record in problem.records])
    if advice is not None and not estimate.converged:
        reason = f"The fit did not converge: its errors are those of no optimum. {advice.reason}"
        advice = advice._replace(reason=reason)
    return dataclasses.replace(
        estimate,
        parameters=parameters,
        error_advice=advice,
        covariances={name: by_model.matrix * np.outer(slopes, slopes) for name, by_model in found.items()},
    )


def _record_errors(point: FittedPoint, estimate: Estimate, effect: Float[np.ndarray, "n p"]) -> list[RecordErrors]:
    """Every fitted record as error models take it; the records of the `estimate` tell which samples stand out."""
    problem, evidence = point.problem, point.evidence
    factors = record_factors(problem, evidence.variance_factor)
    jacobian = problem.residual.transform.own_jacobian(point.jacobian)
    fitted = [record for record in estimate.records if record.role == "fit"]
    return [
        RecordErrors(
            residual=point.residual[rows],
            jacobian=jacobian[rows],
            influence=effect[rows],
            time=record.time,
            frequency=cycles_a_second(record),
            variance_factor=float(factors[i]),
            freedom=max(record.time.size - float(evidence.effective_parameters[i]), 1.0),
            noise_freedom=float(evidence.noise_freedom[i]),
            pooled=bool(evidence.noise_is_given[i]),
            outlying=np.isin(np.arange(record.time.size), found.outliers),
        )
        for i, (record, rows, found) in enumerate(zip(problem.records, problem.rows, fitted, strict=True))
    ]


def _covariances(
    point: FittedPoint,
    estimate: Estimate,
    models: Sequence[AbstractErrorModel],
    curvatures: Sequence[Float[np.ndarray, "p k"]] | None,
) -> dict[str, "_ByModel"]:
    own = point.problem.residual.transform
    effect, unknown = own.own_effect(point.influence(curvatures)), own.tied_to(~point.known)
    records, out = _record_errors(point, estimate, effect), {}
    # What was measured apart has errors of its own, whatever those of the samples.
    prior = effect[point.problem.rows_apart]
    for model in models:
        shares = model.shares(records)
        matrix = total_of(shares) + prior.T @ prior
        set_unknown(matrix, unknown)
        variances = [np.diag(share.covariance) for share in shares]
        freedom, pooled = [share.freedom for share in shares], [share.pooled for share in shares]
        freedom = effective_freedom(np.diag(matrix), variances, freedom, pooled)
        out[model.name] = _ByModel(matrix, freedom, [share.evidence for share in shares])
    return out


def robust_effect(
    root: Float[np.ndarray, " n"],
    jacobian: Float[np.ndarray, "n p"],
    known: Bool[np.ndarray, " p"],
    loss: AbstractLoss,
    samples: int,
) -> Float[np.ndarray, "n p"]:
    """J B^-1, each row times its rho'/2, with B = J' diag(rho''/2) J: the effect of each residual on each parameter.

    The sum of its squares is the sandwich covariance of P. J. Huber, Robust Statistics, 1981, 7.6.  What is given of
    the noise only scales the loss: the scatter is that of the residuals themselves.

    **Arguments:** `root`s of the residuals and their `jacobian`, as the fit leaves them; the parameters that are not
    `known` have no effect; residuals beyond the number of `samples` are of what was measured apart, with an error of 1.
    """
    is_sample = np.arange(root.size) < samples
    original = loss.original(jnp.asarray(root))
    influence, curvature = np.asarray(loss.influence(original)), np.asarray(loss.curvature(original))
    slope = np.where(is_sample & (np.abs(root) > 1e-12), influence / np.where(root == 0.0, 1.0, root), 1.0)
    influence, curvature = np.where(is_sample, influence, 1.0), np.where(is_sample, curvature, 1.0)
    columns = jacobian[:, known] / slope[:, None]
    norms = np.linalg.norm(columns, axis=0)
    columns = columns / norms
    effect = np.zeros(jacobian.shape)
    effect[:, known] = influence[:, None] * columns @ np.linalg.inv(columns.T @ (curvature[:, None] * columns)) / norms
    return effect


class StandardErrors(NamedTuple):
    """Standard errors of p free numbers, on the fit's scale."""

    covariance: Covariance
    """Enlarged by the `factor`."""
    naive: Float[np.ndarray, "p p"] | None
    """The covariance that takes the first of two steps for exact, enlarged as well; None of a joint fit."""
    cov_with_prior: Float[np.ndarray, " p"]
    """Covariance of each estimate with what was measured apart of it, which the estimate follows; no other counts."""
    factor: float
    """Ratio of variances to those of the noise given; 1 under a robust loss, which takes the scatter from the
    residuals."""
    freedom: Float[np.ndarray, " p"]
    """Degrees of freedom of the noise that each standard error rests on; infinite where it is known."""


def standard_errors_of(method: Method, evidence: Evidence, stack: PickedStack | None) -> StandardErrors:
    """The covariances of a fit; a `stack` read off peaks is the first of two steps."""
    evidence = dataclasses.replace(evidence, after_stack=stack is not None)
    problem, loss = evidence.problem, evidence.problem.residual.loss
    point, naive = FittedPoint(method, evidence, stack), None
    factor, unknown = evidence.variance_factor, ~point.known
    if loss.is_robust:
        samples, factor = problem.rows_apart.start, 1.0
        left = max(samples - point.known.sum(), 1)
        effect = robust_effect(point.residual, point.jacobian, point.known, loss, samples)
        factors = np.where(np.arange(len(effect)) < samples, samples / left, 1.0)
        freedom, pooled = np.full(len(problem.records), left), np.ones(len(problem.records), bool)
    else:
        effect, factors = point.influence(), row_factors(problem, factor)
        freedom, pooled = evidence.noise_freedom, evidence.noise_is_given
    if method != "joint":
        factors = np.append(factors, np.ones(len(effect) - factors.size))
        if stack is not None:
            unknown |= stack_parameters(problem) & ~problem.residual.transform.among(PATHS)
        naive = _covariance(point.steps.with_first_exact().influence(), factors, unknown)
    known = evidence.given_covariance._replace(matrix=_covariance(effect, factors, unknown))
    own = problem.residual.transform
    squares = factors[:, None] * own.own_effect(effect) ** 2
    shares = [np.sum(squares[rows], axis=0) for rows in problem.rows]
    freedom = effective_freedom(np.diag(own.own_covariance(known.matrix)), shares, freedom, pooled)
    return StandardErrors(known, naive, _covariance_with_priors(point, effect), factor, freedom)


def _covariance(
    effect: Float[np.ndarray, "n p"], factors: Float[np.ndarray, " n"], unknown: Bool[np.ndarray, " p"]
) -> Float[np.ndarray, "p p"]:
    matrix = effect.T @ (factors[:, None] * effect)
    set_unknown(matrix, unknown)
    return matrix


def _covariance_with_priors(point: FittedPoint, effect: Float[np.ndarray, "n p"]) -> Float[np.ndarray, " p"]:
    """The covariance of each estimate with its number measured apart.

    The effect of that number is that of its row, whose error is 1 over its Jacobian on this scale.
    """
    residual, out = point.problem.residual, np.zeros(effect.shape[1])
    effect = residual.transform.own_effect(effect)
    for row, path in enumerate(residual.prior.paths, point.problem.rows_apart.start):
        place = residual.transform.paths.index(path)
        if point.stack is not None and path in PATHS:
            out[place] = point.stack.prior.covariance[PATHS.index(path), PATHS.index(path)]
        elif point.jacobian[row, place] != 0.0:
            out[place] = effect[row, place] / point.jacobian[row, place]
    return out
