"""The best point that a fit has come to, for when it is broken off."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool

from ...study import Values
from ..least_squares import MAX_ITERATIONS, Fit, FitMethod, Progress, evaluated
from ..problem import Problem, unwatched
from ..stack_parameters import of_platform_alone


class Point(NamedTuple):
    """Where a run of a fit has been."""

    fit: Fit
    problem: Problem
    starts: dict[str, float]
    """Where that run began [SI], by path; fixed parameters too."""
    covers: int
    """What the run fits: 2 all records, 1 those that need the contact, 0 those of the platform."""


class BestPoint:
    """Remembers the best point of all runs that it watches."""

    def __init__(self):
        self.point: Point | None = None
        self._starts: dict[str, float] = {}

    def watched(self, run: FitMethod) -> FitMethod:
        """`run`, which tells of every iteration."""

        def told(problem: Problem, starts: Values, report: Progress, limit: int = MAX_ITERATIONS) -> Fit:
            given = {**problem.residual.fixed, **starts}
            self._starts = {path: float(number) for path, number in given.items()}
            return run(problem._replace(watch=self.note), starts, report, limit)

        return told

    def note(self, problem: Problem, used: Bool[np.ndarray, " records"], fit: Fit) -> None:
        """Keep the point of `fit`, of the records `used`, if it is the best so far.

        A run over more of the records is better, whatever its chi-square; among runs over the
        same ones chi-square tells, unless the noise was estimated anew: then the later counts.
        """
        if not np.isfinite(fit.chi2):
            return
        platform = of_platform_alone(problem.records)
        covers = 2 if used.all() else 1 if (used & ~platform).any() else 0
        best = self.point
        if best is not None and covers <= best.covers:
            same_noise = np.array_equal(problem.noise, best.problem.noise)
            if covers < best.covers or (same_noise and fit.chi2 >= best.fit.chi2):
                return
        self.point = Point(fit, problem._replace(watch=unwatched), self._starts, covers)


def completed(point: Point, report: Progress) -> Fit:
    """The fit at a `point`, with the residuals and the Jacobian of all records."""
    if point.covers == 2:
        return point.fit
    whole = evaluated(point.problem, point.fit.free, report)
    return point.fit._replace(state=whole.state, evaluations=point.fit.evaluations + whole.evaluations)
