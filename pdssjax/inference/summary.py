"""Turn a fit into an `Estimate`: verdict, standard errors, correlations, statistics, notes and pulls.

The pull of a parameter compares its estimate p with an independent measurement t of standard error s that the fit uses.
The two are correlated:

    var(p - t) = var(p) + s^2 - 2 cov(p, t)

cov(p, t) is s^2 times how far the estimate follows t.  Where residuals are as large as the noise given and all is
fitted at once it is var(p), and the pull is (p - t) / sqrt(s^2 - var(p)), as in fits with constraints in particle
physics (L. Demortier and L. Lyons, Everything you always wanted to know about pulls, CDF/ANAL/PUBLIC/5776, 2002).
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float

from ..core import installed_versions
from ..integration import solver_name
from ..study import (
    Estimate,
    FittedParameter,
    FittedRecord,
    MeasuredApart,
    Provenance,
    Study,
    Unexplained,
    compare,
    failure_cause,
)
from .beyond_noise import exceeds_floor
from .covariance import correlation
from .diagnosis import contradicting, diagnose
from .evidence import Evidence
from .least_squares import START_FAILED, Fit, Method, by_record
from .notes.of_fit import notes_of
from .problem import Problem
from .residual import free_offset
from .stack_first.held_stack import with_stack_freed
from .stack_first.peak_picking import PickedStack
from .steady_sines import inseparable
from .uncertainty.influence import amplification_of
from .uncertainty.linear_intervals import linear_intervals, record_factors
from .uncertainty.parameter_errors import StandardErrors, standard_errors_of
from .validation import is_refuted

_INFORMATIVE = 0.1
"""Standard deviation of the difference over the prior's standard error, below which the records tell next to nothing:
the error of the estimate is 99.5 % of the prior's, or more."""


def measurement_with_pull(
    prior: tuple[float, float], value: float, variance: float, covariance: float
) -> MeasuredApart:
    """The number and error measured apart of a parameter, the `prior`, with the pull of its estimate; all in its unit.

    **Arguments:** the estimate's `value` and `variance`, NaN where not known, and its `covariance` with the prior.
    """
    number, error = prior
    difference = variance + error**2 - 2.0 * covariance
    informative = difference > (_INFORMATIVE * error) ** 2
    return MeasuredApart(number, error, (value - number) / math.sqrt(difference) if informative else math.nan)


WEAKLY_DETERMINED = float(np.log(10.0))
"""Standard error on the fit's scale from which a parameter counts as one without information."""


def summarise(
    study: Study, method: Method, evidence: Evidence, starts: Mapping[str, float], stack: PickedStack | None = None
) -> Estimate:
    """The estimate by the `evidence` of a fit of a `study`; `seconds` is left at 0.

    A `stack` read off peaks is the first of two steps, whose covariance is that of the readings.
    """
    problem, fit = evidence.problem, evidence.fit
    free, loss = problem.residual.transform, problem.residual.loss
    values = {path: float(value) for path, value in {**starts, **free.decode(fit.free)}.items()}
    errors, mixed = standard_errors_of(method, evidence, stack), inseparable(evidence)
    factor, known = errors.factor, errors.covariance
    with np.errstate(invalid="ignore"):  # rounding may make a variance negative: the error is unknown then
        deviation = np.sqrt(np.diag(free.own_covariance(known.matrix)))
    weakly_determined = known.identifiable & (deviation > WEAKLY_DETERMINED)
    # Parameters tied to one without information, or mixed by steady sines, have no error either.
    tied_to_unknown = known.identifiable & np.isnan(deviation)
    silent = weakly_determined | tied_to_unknown | free.among(() if mixed is None else mixed.paths)
    known, deviation = known._replace(identifiable=known.identifiable & ~silent), np.where(silent, np.nan, deviation)
    slopes = np.abs(free.slope(fit.free))
    parameters = _parameters(study, evidence, values, starts, errors, known.identifiable, deviation)
    records = _beside_predictions(study, evidence, known.matrix, values, factor)
    diagnosis = diagnose(problem, fit, known.matrix) if np.isfinite(fit.chi2) else None
    if diagnosis and stack is not None:  # records of peaks are not fitted, and contradict where peaks were misread
        diagnosis = dataclasses.replace(diagnosis, agreement=())
    # The errors of a fit in two steps, or under a robust loss, are not those of least squares.
    alone = method == "joint" and not loss.is_robust
    missed = evidence.missed if alone else evidence.missed_within(known.matrix)
    above_floor = [r.role == "fit" and r.noise_estimated and exceeds_floor(r) for r in records]
    causes: dict[Unexplained, bool] = {
        "noise": evidence.leaves_more_than_noise or (stack is None and any(above_floor)),
        "contradiction": diagnosis is not None and bool(contradicting(diagnosis.agreement)),
        "validation": is_refuted(missed),
    }
    unexplained: tuple[Unexplained, ...] = tuple(cause for cause, holds in causes.items() if holds)
    explained, message = _verdict(evidence, values, bool(unexplained), stack)
    estimate = Estimate(
        title=study.title,
        method=method,
        converged=fit.success,
        message=message,
        parameters=parameters,
        names=free.paths,
        correlation=correlation(free.own_covariance(known.matrix)),
        covariance=free.own_covariance(known.matrix) * np.outer(slopes, slopes),
        records=records,
        statistics=evidence.statistics,
        notes=(),
        seconds=0.0,
        amplification=amplification_of(problem, fit, known.identifiable),
        diagnosis=diagnosis,
        explained=explained,
        unexplained_by=() if explained or fit.message == START_FAILED else unexplained,
        loss=type(loss).__name__.lower(),
        actuator=study.models.chosen,
        solver=solver_name(problem.residual.accuracy.method),
        provenance=Provenance(study=str(study.path or ""), versions=installed_versions()),
    )
    notes = notes_of(estimate, study, evidence, known.null, weakly_determined, factor, missed, mixed)
    return dataclasses.replace(estimate, notes=notes)


def _verdict(
    evidence: Evidence, values: Mapping[str, float], unexplained: bool, stack: PickedStack | None
) -> tuple[bool, str]:
    """The verdict on a fit: whether it explains its records, and a sentence on how it ended.

    What is `unexplained` may be due to a stack that was read off peaks.
    """
    problem, fit = evidence.problem, evidence.fit
    if fit.message == START_FAILED:
        return False, how_it_ended(problem, fit, values)
    if stack is None or not unexplained or not np.isfinite(fit.chi2):
        return not unexplained, fit.message
    if with_stack_freed(fit, problem, stack).leaves_more_than_noise:
        return False, fit.message
    return True, f"{fit.message}; the stack as it was read off peaks does not follow its records"


def how_it_ended(problem: Problem, fit: Fit, values: Mapping[str, float]) -> str:
    """How a fit ended, in a sentence; where it could not start at `values` [SI], with what fails there."""
    if fit.message != START_FAILED:
        return fit.message
    residual = problem.residual
    cause = failure_cause(residual.predictor, problem.records, {**residual.fixed, **values}, residual.accuracy)
    return f"{START_FAILED}: {cause or 'its residuals are not finite'}"


def _parameters(
    study: Study,
    evidence: Evidence,
    values: Mapping[str, float],
    starts: Mapping[str, float],
    errors: StandardErrors,
    identifiable: Bool[np.ndarray, " p"],
    deviation: Float[np.ndarray, " p"],
) -> dict[str, FittedParameter]:
    """All parameters of a study, those free with their errors, intervals and pulls; `deviation` on their own scales."""
    fit, free, declared = evidence.fit, evidence.problem.residual.transform, study.bounded_parameters
    held, slopes = free.at_bound(fit.free), np.abs(free.slope(fit.free))
    bounds = {path: declared[path].bounds() for path in free.paths}
    intervals = linear_intervals(free.own(fit.free), deviation, errors.freedom, free, bounds)
    naive = None if errors.naive is None else np.sqrt(np.diag(free.own_covariance(errors.naive))) * slopes
    out = {}
    for path, p in declared.items():
        fixed = FittedParameter(
            path=path,
            value=values[path],
            standard_error=math.nan,
            interval=(math.nan, math.nan),
            unit=p.unit,
            free=False,
            start=None,
            at_bound=False,
            identifiable=True,
        )
        if path not in free.paths:
            out[path] = fixed
            continue
        i, pull = free.paths.index(path), None
        error, known = float(deviation[i] * slopes[i]), bool(identifiable[i] or held[i])
        if p.measured_apart is not None:
            variance = math.nan if held[i] else error**2  # a bound moves the estimate off where chance would leave it
            covariance = float(slopes[i] ** 2 * errors.cov_with_prior[i])
            pull = measurement_with_pull(p.measured_apart, values[path], variance, covariance)
        out[path] = dataclasses.replace(
            fixed,
            standard_error=error,
            interval=intervals[path],
            free=True,
            start=starts[path],
            at_bound=bool(held[i]),
            identifiable=known,
            naive_standard_error=float(naive[i]) if naive is not None and known else None,
            degrees_of_freedom=float(errors.freedom[i]),
            bounds=bounds[path],
            measured_apart=pull,
        )
    return out


def _beside_predictions(
    study: Study, evidence: Evidence, matrix: Float[np.ndarray, "p p"], values: dict[str, float], factor: float
) -> tuple[FittedRecord, ...]:
    """Every record beside its prediction, each with its own zero."""
    problem, fit, loss = evidence.problem, evidence.fit, evidence.problem.residual.loss
    slopes, effective = np.asarray(fit.state.aux_jacobian), evidence.effective_parameters
    # Standard deviations of residuals over their noise, as the errors of parameters take them.
    if loss.is_robust:
        parts = zip(by_record(problem, fit), effective, strict=True)
        scatter = [loss.scatter(part, part.size - degrees) for part, degrees in parts]
    else:
        scatter = np.sqrt(record_factors(problem, factor))
    places = {id(record): i for i, record in enumerate(problem.records)}
    motions, out = problem.motions(values), []
    undisturbed = _undisturbed(evidence, values, motions)
    for record, motion, rest in zip(study.records, motions, undisturbed, strict=True):
        i = places.get(id(record))
        noise = record.noise if i is None else problem.noise[i]
        offset = free_offset(record.measured, motion, record.offset, loss, float(noise or 0.0))
        noise = float(np.std(record.measured - motion) if noise is None else noise)
        error = math.nan
        if record.offset is None and i is not None:
            by_parameters = slopes[i] @ np.nan_to_num(matrix) @ slopes[i]
            error = float(np.sqrt((noise * scatter[i]) ** 2 / record.time.size + max(by_parameters, 0.0)))
        out.append(
            compare(
                record,
                motion,
                noise=noise,
                offset=offset,
                offset_standard_error=error,
                parameters=0.0 if i is None else float(effective[i]) - (record.offset is None),
                undisturbed=rest,
            )
        )
    return tuple(out)


def _undisturbed(
    evidence: Evidence, values: Mapping[str, float], motions: list[Float[np.ndarray, " samples"]]
) -> Sequence[Float[np.ndarray, " samples"] | None]:
    """The prediction of every record by the fit without the samples that stand out; None stands for `motions`."""
    problem, fit = evidence.problem, evidence.fit
    if problem.residual.loss.is_robust or not np.isfinite(fit.chi2):
        return [None] * len(motions)
    there = evidence.undisturbed_point
    if np.array_equal(there, fit.free):
        return motions
    found = {path: float(value) for path, value in problem.decode(there).items()}
    moved = problem.motions({**values, **found})
    return moved if all(np.isfinite(motion).all() for motion in moved) else motions
