"""The fit of everything else with the stack held at numbers found before, and the whole problem at its end.

The second of two steps: the records of the platform alone have been used and are left out, so that starts, restarts
and verdicts look at the others only.  Afterwards all records and parameters are put together again, for the statistics
and for the covariance, which carries the stack's errors on.
"""

import dataclasses
from collections.abc import Mapping

import numpy as np

from ...integration import Accuracy
from ...study import Study, split_path
from ..least_squares import Progress, evaluated, summed
from ..problem import Problem, pose
from ..search.best_point import Point


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


def rejoined(study: Study, point: Point, accuracy: Accuracy, report: Progress) -> Point:
    """Where the fit with the stack held has come to, as a point of the whole study.

    Noise that was not given is that found in the second step, and the floor of the platform's records.
    """
    found = {path: float(number) for path, number in point.problem.decode(point.fit.free).items()}
    problem = _with_noise_of(point.problem, pose(study, point.starts, accuracy))
    whole = evaluated(problem, problem.encode({**point.starts, **found}), report)
    fit = whole._replace(success=point.fit.success, message=point.fit.message, ending=point.fit.ending)
    return Point(summed(fit, [point.fit]), problem, point.starts, point.covers)


def _with_noise_of(second: Problem, whole: Problem) -> Problem:
    known = {id(record): noise for record, noise in zip(second.records, second.noise, strict=True)}
    noise = [known.get(id(record), floor) for record, floor in zip(whole.records, whole.noise, strict=True)]
    return whole._replace(noise=np.array(noise))
