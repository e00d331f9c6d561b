"""Fits with the stack held at numbers found before, and the fit in two steps that way.

The second of two steps leaves out the records of the platform alone, so that starts, restarts and verdicts depend on
the others only.  Afterwards all records and parameters are joined again, for the statistics and for the covariance,
which includes the stack's errors.

The errors of a stack read off peaks leave residuals in the walks, as a wrong law does.  So the walks are judged by
their residuals with the stack free to move within its errors.  To first order these have the least of

    |r + J d|^2 + d_s' C^-1 d_s

over steps d of all parameters, d_s those of the readings, with their covariance C.  If this step exceeds the errors of
the readings beyond chance, the stack does not explain the residuals.
"""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from ...integration import Accuracy
from ...study import Study, Values, split_path
from ..covariance import scaled_least_squares
from ..evidence import Evidence
from ..least_squares import MAX_ITERATIONS, Fit, Progress, evaluated, fit_phase, quiet, with_counts_of
from ..prior import is_by_chance
from ..problem import Problem, pose
from ..search.multistart import Point
from ..stack_parameters import platform_alone_records, stack_parameters
from .peak_picking import PATHS, PickedStack


def with_stack_held(study: Study, stack: Mapping[str, float]) -> Study:
    """The study with its free parameters among the `stack`, numbers by path [SI], fixed at those.

    Of its records those fitted are left that do not show the platform alone; parameters that hold in others only are
    fixed where they start.
    """
    records = tuple(r for r in study.records if r.role == "fit" and not r.measurement.platform_alone)
    conditions = {"", *(condition for record in records for condition in record.conditions)}
    held = {path: number for path, number in stack.items() if path in study.parameters and study.parameters[path].free}
    for path, parameter in study.parameters.items():
        if parameter.free and split_path(path)[1] not in conditions:
            held[path] = parameter.quantity.nominal if parameter.start is None else parameter.start
    return dataclasses.replace(study.with_values(held), records=records)


def point_of_whole_study(study: Study, point: Point, accuracy: Accuracy, report: Progress) -> Point:
    """The point of a fit with the stack held, as a point of the whole study.

    Noise that was not given is that found in the second step, and the floor of the platform's records.
    """
    found = {path: float(number) for path, number in point.problem.decode(point.fit.free).items()}
    problem, second = pose(study, point.starts, accuracy), point.problem
    known = {id(record): noise for record, noise in zip(second.records, second.noise, strict=True)}
    noise = [known.get(id(record), floor) for record, floor in zip(problem.records, problem.noise, strict=True)]
    problem = problem._replace(noise=np.array(noise))
    whole = evaluated(problem, problem.encode({**point.starts, **found}), report)
    fit = whole._replace(success=point.fit.success, message=point.fit.message, ending=point.fit.ending)
    return Point(with_counts_of(fit, [point.fit]), problem, point.starts, point.covers)


def sequential(problem: Problem, starts: Values, report: Progress, limit: int = MAX_ITERATIONS) -> Fit:
    """Fit the piezo to the platform records; then, with the piezo held, the other parameters to the rest."""
    platform = platform_alone_records(problem.records)
    free = problem.residual.transform.encode(starts)
    piezo = stack_parameters(problem)
    first = fit_phase(problem, free, platform, piezo, "piezo", report, limit)
    last = with_piezo_held(problem, first.free, report, limit)
    if not first.success:
        last = last._replace(success=False, message=f"piezo: {first.message}", ending=first.ending)
    return with_counts_of(last, [first])


def with_piezo_held(
    problem: Problem, free: Float[np.ndarray, " p"], report: Progress, limit: int = MAX_ITERATIONS
) -> Fit:
    """Fit the other parameters to the records that do not show the platform alone, from the point `free`."""
    platform = platform_alone_records(problem.records)
    piezo = stack_parameters(problem)
    second = fit_phase(problem, free, ~platform, ~piezo, "friction", report, limit)
    # Both steps' residuals, for the statistics and the errors.
    whole = evaluated(problem, second.free, report)
    state = whole.state._replace(iterations=second.state.iterations, evaluations=second.state.evaluations)
    ended = {"success": second.success, "message": second.message, "ending": second.ending}
    return with_counts_of(whole._replace(state=state, **ended), [second])


def due_to_stack(study: Study, stack: PickedStack, accuracy: Accuracy, fit: Fit, problem: Problem) -> bool:
    """Whether the errors of the `stack` held in this `fit` of a `study` explain the residuals of the walks."""
    numbers = {**problem.residual.fixed, **problem.decode(fit.free)}
    starts = {path: float(number) for path, number in numbers.items()}
    whole = point_of_whole_study(study, Point(fit, problem, starts, 1), accuracy, quiet)
    return not with_stack_freed(whole.fit, whole.problem, stack).is_poor


def with_stack_freed(fit: Fit, problem: Problem, stack: PickedStack) -> Evidence:
    """The evidence of the walks alone with the stack freed, at the end of a fit that held it."""
    transform, alone = problem.residual.transform, platform_alone_records(problem.records)
    every = np.arange(np.size(fit.state.residual))
    rows = np.concatenate([every[r] for r, is_alone in zip(problem.rows, alone, strict=True) if not is_alone])
    residual, jacobian = np.asarray(fit.state.residual)[rows], np.asarray(fit.state.jacobian)[rows]
    moves = (transform.among(PATHS) | ~stack_parameters(problem)) & ~transform.at_bound(fit.free)
    readings = stack.prior.rows(transform.paths)
    rest = np.append(residual, np.zeros(len(readings)))
    step = -scaled_least_squares(np.vstack([jacobian, readings]) * moves, rest, 1e-9)
    if is_by_chance(readings @ step):
        residual = residual + jacobian @ (step * moves)
    walks = tuple(record for record, is_alone in zip(problem.records, alone, strict=True) if not is_alone)
    state = fit.state._replace(residual=residual, jacobian=jacobian)
    return Evidence(problem._replace(records=walks, noise=problem.noise[~alone]), fit._replace(state=state))
