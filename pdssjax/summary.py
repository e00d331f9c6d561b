"""Turns a fit into an estimate: errors, correlations, statistics, records, and what the user must read."""

import dataclasses

import numpy as np

from .estimate import Estimate, FittedParameter, FittedRecord, Statistics, compare
from .fitting import Fit, Problem, of_piezo, reduced_chi2
from .parameters import REACH, Scale
from .residual import free_offset
from .uncertainty import Covariance, correlation, covariance, propagated

NORMAL_95 = 1.959964
"""Half width of a 95 % interval in standard errors."""
VAGUE = float(np.log(10.0))
"""Standard error on the fit's scale from which a parameter counts as one without information."""


def summarise(study, method, problem, fit, starts) -> Estimate:
    """The estimate that a `fit` of a `study` amounts to; `seconds` is left at 0."""
    free, fitted = problem.residual.scale, {**starts, **problem.residual.scale.decode(fit.free)}
    values = {path: float(value) for path, value in fitted.items()}
    statistics = _statistics(problem, fit)
    known, naive = _covariances(method, problem, fit)
    # Residuals larger than the noise given make the errors larger, never smaller.
    inflation = max(1.0, statistics.reduced_chi2) if statistics.reduced_chi2 < np.inf else 1.0
    deviation = np.sqrt(np.diag(known.matrix) * inflation)
    vague = known.informed & (deviation > VAGUE)
    known = known._replace(informed=known.informed & ~vague)
    deviation = np.where(vague, np.nan, deviation)
    slopes = np.abs(free.slope(fit.free))
    parameters = {}
    for path, declared in study.parameters.items():
        i = free.paths.index(path) if declared.free else None
        parameters[path] = _parameter(declared, values[path], starts[path], i, fit, free, deviation, known)
    if naive is not None:
        naive_errors = np.sqrt(np.diag(naive) * inflation) * slopes
        parameters = {
            path: dataclasses.replace(p, naive_standard_error=float(naive_errors[free.paths.index(path)]))
            if p.free and p.informed
            else p
            for path, p in parameters.items()
        }
    matrix = known.matrix * inflation * np.outer(slopes, slopes)
    records = _compared(study, problem, fit, known.matrix * inflation, values)
    return Estimate(
        title=study.title,
        method=method,
        converged=fit.success,
        message=fit.message,
        parameters=parameters,
        names=free.paths,
        correlation=correlation(known.matrix),
        covariance=matrix,
        records=records,
        statistics=statistics,
        notes=tuple(_notes(study, problem, fit, known, vague, statistics, records)),
        seconds=0.0,
    )


def _at_bound(fit: Fit, free: Scale) -> np.ndarray:
    return (fit.free <= free.low) | (fit.free >= free.high)


def _out_of_reach(study, fit: Fit, free: Scale, side: str) -> list[str]:
    """Positive parameters that ran as far as a fit lets them where the study sets no bound on that `side`."""
    out = []
    for i, path in enumerate(free.paths):
        declared = study.parameters[path]
        reached = fit.free[i] <= free.low[i] if side == "low" else fit.free[i] >= free.high[i]
        # The legal range may end sooner than the reach of the start does.
        end = np.exp(getattr(free, side)[i]) if free.logarithmic[i] else np.nan
        ours = getattr(declared, side) is None and not np.isclose(end, getattr(declared.quantity, side), rtol=1e-5)
        if reached and ours and free.logarithmic[i]:
            out.append(path)
    return out


def _covariances(method, problem, fit) -> tuple[Covariance, np.ndarray | None]:
    """On the fit's scale; for a sequential fit also what takes its first step for exact."""
    jacobian = np.asarray(fit.state.jacobian)
    free = problem.residual.scale
    held = _at_bound(fit, free)
    whole = covariance(jacobian, held)
    if method == "joint":
        return whole, None
    sizes = [record.time.size for record in problem.records]
    platform = np.repeat([record.measures == "platform" for record in problem.records], sizes)
    piezo = of_piezo(free) & whole.informed
    earlier, later = np.flatnonzero(piezo), np.flatnonzero(~of_piezo(free) & whole.informed)
    first = covariance(jacobian[platform][:, earlier], np.zeros(earlier.size, bool)).matrix
    plain, full = propagated(jacobian[~platform], first, later, earlier)
    unknown = ~whole.informed
    for matrix in (plain, full):
        matrix[unknown] = np.nan
        matrix[:, unknown] = np.nan
    return Covariance(full, whole.informed, whole.null), plain


def _parameter(declared, value, start, i, fit, free, deviation, known) -> FittedParameter:
    nan = float("nan")
    common = dict(path=declared.path, value=value, unit=declared.unit)
    if i is None:
        return FittedParameter(
            **common, standard_error=nan, interval=(nan, nan), free=False, start=None, at_bound=False, informed=True
        )
    at_bound = bool(_at_bound(fit, free)[i])
    half = NORMAL_95 * deviation[i]
    ends = [float(free.decode(fit.free + side * half)[declared.path]) for side in (-1.0, 1.0)]
    return FittedParameter(
        **common,
        standard_error=float(deviation[i] * abs(free.slope(fit.free)[i])),
        interval=(ends[0], ends[1]) if np.isfinite(half) else (nan, nan),
        free=True,
        start=start,
        at_bound=at_bound,
        informed=bool(known.informed[i]) or at_bound,
    )


def _statistics(problem: Problem, fit: Fit) -> Statistics:
    samples = int(np.size(fit.state.residual))
    free = fit.free.size + sum(record.offset is None for record in problem.records)
    sizes = np.array([record.time.size for record in problem.records])
    # Minus twice the log-likelihood: the noise counts, where it is estimated.
    deviance = fit.chi2 + 2.0 * np.sum(sizes * np.log(problem.noise)) + samples * np.log(2.0 * np.pi)
    return Statistics(
        chi2=fit.chi2,
        reduced_chi2=reduced_chi2(fit, problem),
        aic=float(deviance + 2.0 * free),
        bic=float(deviance + np.log(samples) * free),
        evaluations=fit.evaluations,
        iterations=fit.iterations,
        samples=samples,
        free=free,
    )


def _compared(study, problem, fit, matrix, values) -> tuple[FittedRecord, ...]:
    """Every record beside its prediction, each with its own zero."""
    at = {id(record): i for i, record in enumerate(problem.records)}
    slopes = np.asarray(fit.state.aux_jacobian)
    out = []
    for record, motion in zip(study.records, study.predict(values, problem.residual.accuracy), strict=True):
        motion = np.asarray(motion)
        offset = free_offset(record.measured, motion, record.offset)
        i = at.get(id(record))
        noise = problem.noise[i] if i is not None else record.noise
        if noise is None:
            noise = float(np.std(record.measured - motion))
        error = float("nan")
        if record.offset is None and i is not None:
            error = float(np.sqrt(noise**2 / record.time.size + slopes[i] @ np.nan_to_num(matrix) @ slopes[i]))
        out.append(compare(record, motion, noise=float(noise), offset=offset, offset_standard_error=error))
    return tuple(out)


def _notes(study, problem, fit, known, vague, statistics, records) -> list[str]:
    paths = problem.residual.scale.paths
    notes = []
    for direction in known.null:
        part = [(path, share) for path, share in zip(paths, direction, strict=True) if share != 0]
        names = ", ".join(path for path, _ in part)
        if len(part) == 1:
            notes.append(f"The data say nothing about {names}; its value is where the fit began.")
        elif all(abs(share - 1.0) < 1e-3 for _, share in part):
            notes.append(
                f"The data tell {names} only up to a common factor: all of them may be multiplied by the same "
                "number. Fix one, for example the mass, to know the others."
            )
        else:
            notes.append(f"The data tell {names} only in combination; what is given is one of many equal solutions.")
    if vague.any():
        names = ", ".join(np.array(paths)[vague])
        notes.append(f"The data hardly tell {names}: one standard error is a factor of ten or more.")
    bound = np.array(paths)[_at_bound(fit, problem.residual.scale)]
    small, large = (_out_of_reach(study, fit, problem.residual.scale, side) for side in ("low", "high"))
    for ends, what in ((small, "from zero"), (large, "from one without limit")):
        if ends:
            notes.append(
                f"The data cannot tell {', '.join(ends)} {what}: the fit stopped a factor of {REACH:g} from the "
                "start, and holds it there for the errors of the others."
            )
    if bound := [path for path in bound if path not in small + large]:
        notes.append(f"At a bound, and held there for the errors of the others: {', '.join(bound)}.")
    given = [record.noise is not None for record in problem.records]
    if statistics.reduced_chi2 > 1.2 and any(given):
        notes.append(
            f"The residuals exceed the noise given (reduced chi-square {statistics.reduced_chi2:.3g}): the model does "
            "not explain all that was measured. The errors are enlarged accordingly."
        )
    wavy = [record.name for record in records if record.role == "fit" and record.simulated and _waviness(record) > 0.3]
    if wavy:
        notes.append(
            "Neighbouring residuals are alike, as the model's own errors are and noise is not, in: "
            f"{', '.join(wavy)}. The true errors are larger than the standard errors given."
        )
    failed = [record.name for record in records if not record.simulated]
    if failed:
        notes.append(f"The simulation could not finish for: {', '.join(failed)}.")
    return notes


def _waviness(record: FittedRecord) -> float:
    """Correlation of neighbouring residuals."""
    rest = record.measured - record.predicted
    return float(np.sum(rest[1:] * rest[:-1]) / max(np.sum(rest**2), 1e-300))
