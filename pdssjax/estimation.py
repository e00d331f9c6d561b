"""Identifies the parameters of a study: jointly, or the piezo first as the thesis did."""

import dataclasses
import time
from collections.abc import Callable, Sequence
from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from .errors import InputError
from .estimate import Estimate, FittedParameter, FittedRecord, Statistics, compare
from .integration import Accuracy
from .levenberg_marquardt import BoundedLevenbergMarquardt, LMState
from .parameters import Scale, scale
from .records import Record
from .residual import Residual, as_weights, free_offset, noise_floor
from .starts import find_starts
from .study import Study
from .uncertainty import Covariance, correlation, covariance, propagated

Method = Literal["joint", "sequential"]
Progress = Callable[[str], None]

MAX_ITERATIONS = 100
NORMAL_95 = 1.959964
"""Half width of a 95 % interval in standard errors."""
VAGUE = float(np.log(10.0))
"""Standard error on the fit's scale from which a parameter counts as one without information."""
_STARTS = 6
"""Starts tried at most while the fit is poor."""
_PATIENCE = 2
"""Starts in a row that may fail to improve a poor fit: then it is the model that is poor."""
_POOR = 2.0
"""Reduced chi-square above which a fit is poor, where the noise is only guessed from the samples."""


class _Problem(NamedTuple):
    """What a fit needs, made once for all its steps."""

    residual: Residual
    records: tuple[Record, ...]
    """The records fitted."""
    noise: np.ndarray
    """Standard deviation of each [m]."""


class _Fit(NamedTuple):
    """Where a Levenberg-Marquardt run ended."""

    free: np.ndarray
    state: LMState
    success: bool
    message: str
    iterations: int
    evaluations: int

    @property
    def chi2(self) -> float:
        value = float(np.sum(np.asarray(self.state.residual) ** 2))
        return value if self.iterations and np.isfinite(value) else np.inf


def identify(
    study: Study,
    method: Method = "joint",
    *,
    progress: Progress | None = None,
    accuracy: Accuracy | None = None,
) -> Estimate:
    """The free parameters of a study from its records with role "fit", with uncertainties.

    **Arguments:** `method` is "joint", all parameters from all records at once, or
    "sequential": the piezo from the platform records, then the others with the piezo held,
    as in the thesis, the first step's errors carried on into the second.  `progress` is
    called with a line of text now and then.

    **Raises:** `InputError` if there is nothing to fit.  A fit that does not converge is
    returned all the same, with `converged` False and the reason in `message`.
    """
    begun = time.perf_counter()
    report = progress or (lambda message: None)
    _check(study, method)
    report("finding starts")
    starts = study.values()
    problem = _problem(study, starts, accuracy or Accuracy())
    run = _joint if method == "joint" else _sequential
    fit, problem, starts = _with_good_starts(study, problem, starts, run, report)
    report("predicting every record")
    estimate = _estimate(study, method, problem, fit, starts, report)
    return dataclasses.replace(estimate, seconds=time.perf_counter() - begun)


def _check(study: Study, method: str) -> None:
    where = study.path or study.title
    if method not in ("joint", "sequential"):
        raise InputError(f'method: found "{method}", expected "joint" or "sequential".')
    fitted = [record for record in study.records if record.role == "fit"]
    if not fitted:
        raise InputError(f'{where}: found no record with role "fit", expected at least one.')
    free = [path for path, parameter in study.parameters.items() if parameter.free]
    if not free:
        raise InputError(f"{where}: parameters: found none that is free, expected at least one to fit.")
    measured = {record.measures for record in fitted}
    if method == "sequential" and measured != {"platform", "effector"}:
        raise InputError(
            f"{where}: found fitted records of the {' and the '.join(sorted(measured))} only; "
            "the sequential method expects some of the platform, for the piezo, and some of the end-effector."
        )


def _problem(study: Study, starts: dict[str, float], accuracy: Accuracy) -> _Problem:
    records = tuple(record for record in study.records if record.role == "fit")
    fixed = {path: starts[path] for path, parameter in study.parameters.items() if not parameter.free}
    residual = Residual(study.models, records, scale(study.parameters, starts), fixed, accuracy)
    noise = np.array([noise_floor(r) if r.noise is None else r.noise for r in records])
    return _Problem(residual, records, noise)


def _with_good_starts(study, problem, starts, run, report):
    """The fit; where it is poor, the best of several starts found from the data."""
    fit, tried = run(problem, starts, report)
    best = fit, tried, starts
    anywhere = {
        path: p if p.value is not None or path.startswith("piezo.") else dataclasses.replace(p, start=None)
        for path, p in study.parameters.items()
    }
    spent, in_vain = fit.evaluations, 0
    for rank in range(1, _STARTS):
        if in_vain == _PATIENCE or not _is_poor(best[0], problem):
            break
        report(f"the fit is poor: trying start {rank + 1} of {_STARTS}")
        other = find_starts(study.models, anywhere, study.records, rank - 1)
        fit, tried = run(problem, other, report)
        spent += fit.evaluations
        in_vain = 0 if fit.chi2 < (1.0 - 1e-3) * best[0].chi2 else in_vain + 1
        if fit.chi2 < best[0].chi2:
            best = fit, tried, other
    best = best[0]._replace(evaluations=spent), *best[1:]
    return _with_noise(problem, *best, run, report)


def _is_poor(fit: _Fit, problem: _Problem) -> bool:
    """Chi-square is larger than the noise allows: four standard deviations of its own, where that is given."""
    known = all(record.noise is not None for record in problem.records)
    spread = np.sqrt(2.0 / np.size(fit.state.residual))
    return not fit.success or _reduced(fit, problem) > (1.0 + 4.0 * spread if known else _POOR)


def _with_noise(problem, fit, tried, starts, run, report):
    """Estimates the noise of the records that do not give it, and fits once more with that."""
    unknown = [record.noise is None for record in problem.records]
    for _ in range(2):
        if not any(unknown) or not np.isfinite(fit.chi2):
            break
        sigma = _noise_left(tried, fit)
        problem = tried._replace(noise=np.where(unknown, sigma, tried.noise))
        report("weighing the records by the noise found")
        fit, tried = run(problem, problem.residual.scale.decode(fit.free), report)
    return fit, tried, starts


def _noise_left(problem: _Problem, fit: _Fit) -> np.ndarray:
    """Standard deviation of each record's residuals [m], degrees of freedom shared by samples."""
    sizes = np.array([record.time.size for record in problem.records])
    parts = np.split(np.asarray(fit.state.residual), np.cumsum(sizes)[:-1])
    lost = fit.free.size * sizes / sizes.sum() + [record.offset is None for record in problem.records]
    squares = np.array([np.sum(part**2) for part in parts])
    return problem.noise * np.sqrt(squares / np.maximum(sizes - lost, 1.0))


def _reduced(fit: _Fit, problem: _Problem) -> float:
    offsets = sum(record.offset is None for record in problem.records)
    return fit.chi2 / max(np.size(fit.state.residual) - fit.free.size - offsets, 1)


def _joint(problem: _Problem, starts: dict[str, Any], report: Progress) -> tuple[_Fit, _Problem]:
    """The piezo's parameters first, from the platform records, then everything from everything.

    The first stage is cheap and only brings the piezo near: with it far off, the slips
    come at the wrong moments, and the friction parameters would go astray.
    """
    measures = np.array([record.measures for record in problem.records])
    free = problem.residual.scale.encode(starts)
    piezo = _of_piezo(problem.residual.scale)
    spent = []
    if (measures == "platform").any() and (measures == "effector").any() and piezo.any() and not piezo.all():
        first = _least_squares(problem, free, measures == "platform", piezo, "piezo", report)
        free, spent = first.free, [first]
    last = _least_squares(problem, free, np.ones(len(measures), bool), np.ones(free.size, bool), "all", report)
    return _summed(last, spent), problem


def _sequential(problem: _Problem, starts: dict[str, Any], report: Progress) -> tuple[_Fit, _Problem]:
    measures = np.array([record.measures for record in problem.records])
    free = problem.residual.scale.encode(starts)
    piezo = _of_piezo(problem.residual.scale)
    first = _least_squares(problem, free, measures == "platform", piezo, "piezo", report)
    second = _least_squares(problem, first.free, measures == "effector", ~piezo, "friction", report)
    # Both steps' residuals, for the statistics and the errors.
    whole = _least_squares(problem, second.free, np.ones(len(measures), bool), piezo & ~piezo, "all", report)
    whole = whole._replace(success=first.success and second.success, message=second.message)
    return _summed(whole, [first, second]), problem


def _of_piezo(scale: Scale) -> np.ndarray:
    return np.array([path.startswith("piezo.") for path in scale.paths])


def _summed(last: _Fit, earlier: Sequence[_Fit]) -> _Fit:
    """`last` with the iterations of the `earlier` stages counted in."""
    return last._replace(
        iterations=last.iterations + sum(fit.iterations for fit in earlier),
        evaluations=last.evaluations + sum(fit.evaluations for fit in earlier),
    )


def _least_squares(problem, free, used, loose, name, report) -> _Fit:
    """One Levenberg-Marquardt run over the `loose` parameters and the `used` records."""
    bounds = problem.residual.scale
    low, high = (np.where(loose, end, free) for end in (bounds.low, bounds.high))
    options = {"lower": jnp.asarray(low), "upper": jnp.asarray(high)}
    weights = as_weights(problem.noise, used)
    samples = sum(record.time.size for record, use in zip(problem.records, used, strict=True) if use)
    # A step that lowers chi-square by 1e-4 is a hundredth of a standard error, one by 0.05 a quarter.
    solver = BoundedLevenbergMarquardt(rtol=jnp.asarray(1e-4 / samples), crawl=jnp.asarray(0.05 / samples))
    y = jnp.clip(jnp.asarray(free, float), options["lower"], options["upper"])
    state, over, evaluations = _begin(solver, problem.residual, y, weights, options), False, 0
    message = "the start is taken as it is"
    while not over and int(state.iterations) < MAX_ITERATIONS:
        y, state, over, result = _iterate(solver, problem.residual, y, weights, options, state)
        evaluations += 2
        chi2 = float(jnp.sum(state.residual**2))
        report(f"{name}: iteration {int(state.iterations)}, chi-square {chi2:.6g}")
        if over:
            message = _message(result, int(state.crawls) == solver.most_crawls)
    success = bool(over) and bool(result == optx.RESULTS.successful)
    if not over:
        message = f"no convergence within {MAX_ITERATIONS} iterations"
    iterations = max(int(state.iterations), 1 - int(state.fresh))
    return _Fit(np.asarray(y), state, success, message, iterations, evaluations)


def _message(result: Any, crawled: bool) -> str:
    if result == optx.RESULTS.successful and crawled:
        return "chi-square no longer falls visibly, along a valley that the data leave almost flat"
    if result == optx.RESULTS.successful:
        return "no step would change chi-square visibly"
    if result == optx.RESULTS.nonlinear_divergence:
        return "the actuator cannot be simulated at the start"
    return "no step lowers chi-square any further, although the linear model promises it"


@eqx.filter_jit
def _begin(solver, residual, y, weights, options):
    out, aux = jax.eval_shape(residual, y, weights)
    return solver.init(residual, y, weights, options, out, aux, frozenset())


@eqx.filter_jit
def _iterate(solver, residual, y, weights, options, state):
    y, state, _ = solver.step(residual, y, weights, options, state, frozenset())
    over, result = solver.terminate(residual, y, weights, options, state, frozenset())
    return y, state, over, result


def _estimate(study, method, problem, fit, starts, report) -> Estimate:
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
        notes=tuple(_notes(problem, fit, known, vague, statistics, records)),
        seconds=0.0,
    )


def _at_bound(fit: _Fit, free: Scale) -> np.ndarray:
    return (fit.free <= free.low) | (fit.free >= free.high)


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
    piezo = _of_piezo(free) & whole.informed
    earlier, later = np.flatnonzero(piezo), np.flatnonzero(~_of_piezo(free) & whole.informed)
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


def _statistics(problem: _Problem, fit: _Fit) -> Statistics:
    samples = int(np.size(fit.state.residual))
    free = fit.free.size + sum(record.offset is None for record in problem.records)
    deviance = fit.chi2 + 2.0 * sum(r.time.size * np.log(s) for r, s in zip(problem.records, problem.noise, strict=True))
    deviance += samples * np.log(2.0 * np.pi)
    return Statistics(
        chi2=fit.chi2,
        reduced_chi2=_reduced(fit, problem),
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
        offset = free_offset(record.displacement, motion, record.offset)
        i = at.get(id(record))
        noise = problem.noise[i] if i is not None else record.noise
        if noise is None:
            noise = float(np.std(record.displacement - motion))
        error = float("nan")
        if record.offset is None:
            error = noise**2 / record.time.size
            if i is not None:
                error += float(slopes[i] @ np.nan_to_num(matrix) @ slopes[i])
            error = float(np.sqrt(error))
        out.append(compare(record, motion, noise=float(noise), offset=offset, offset_standard_error=error))
    return tuple(out)


def _notes(problem, fit, known, vague, statistics, records) -> list[str]:
    paths = problem.residual.scale.paths
    notes = []
    for direction in known.null:
        part = [(path, share) for path, share in zip(paths, direction, strict=True) if abs(share) > 1e-3]
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
    bound = [path for path, at in zip(paths, _at_bound(fit, problem.residual.scale), strict=True) if at]
    if bound:
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
