"""Fits from starts that lead somewhere: found from the data, compared early, left again if need be.

The sum of squares has many local minima.  Slips that come at the wrong moment make large
basins; small discontinuities lie within them, where a parameter decides whether the contact just
reverses or just does not (the law's forces jump there, and the motion after it with them).
So several starts are raced while the fit is poor, has run into a bound or took a long way (`races.py`), and a fit
that ends at a discontinuity is restarted from perturbed points.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from ...integration import Accuracy
from ...study import Study, Values
from ..effort import USUAL, Effort
from ..estimated_noise import with_noise
from ..fit_statistics import reduced_chi2
from ..initial_values.search import guess_starts
from ..least_squares import Fit, FitMethod, Progress, quiet, summed
from ..long_records import question_lengths
from ..losses.base import AbstractLoss
from ..problem import Problem, pose
from ..solver.ending import Ending
from ..variable_projection import is_separable
from .perturbed_restarts import MOST_RESTARTS, beyond_discontinuity
from .races import Contest, platform_unobserved, race, ranked, reason_at_first, reason_in_the_end, shown

_FIRST = 12
"""Iterations after which a fit from a start that was searched for must look promising."""

_PROMISING = 2.0
"""Reduced chi-square at that moment."""


class Budget:
    """Counts the evaluations of every run that it watches, and ends the comparison with other starts.

    Once they are spent a run takes a single step, so that the best so far stands.
    """

    def __init__(self, effort: Effort):
        self.effort, self.spent, self.refused = effort, 0, 0

    def counted(self, run: FitMethod) -> FitMethod:
        """`run`, as long as evaluations are left."""

        def limited(problem: Problem, starts: Values, report: Progress, limit: int = self.effort.iterations) -> Fit:
            if self.spent >= self.effort.evaluations:
                self.refused += 1
                return run(problem, starts, quiet, 1)
            fit = run(problem, starts, report, limit)
            self.spent += fit.evaluations
            return fit

        return limited

    @property
    def word(self) -> str:
        """What a user reads where runs were refused."""
        told = f"; after {self.spent} evaluations no other start was fitted"
        return told + self.effort.advice


def best_fit(
    study: Study,
    accuracy: Accuracy,
    run: FitMethod,
    report: Progress,
    loss: AbstractLoss | None = None,
    excused: Callable[[Fit, Problem], bool] | None = None,
    effort: Effort = USUAL,
) -> tuple[Fit, Problem, dict[str, float]]:
    """The fit from the study's starts; where it is poor and not `excused`, the best from several found from the data.

    As many as the `effort` allows: once its evaluations are spent other starts are no longer fitted.

    **Returns:** the fit, its problem with the noise found, and the starts it came from.
    """
    starts, missing = guess_starts(study.models, study.parameters, study.records)
    problem = pose(study, starts, accuracy, loss, effort)
    question_lengths(problem, starts)
    _compile(problem, study, starts)
    if is_separable(problem):  # what is searched is little, and no contact makes wrong optima of it
        fit, problem = with_noise(run(problem, starts, report), problem, run, report)
        return fit, problem, starts
    found = ranked(study, study.parameters, problem, starts, report) if missing else []
    budget = Budget(effort)
    tried, unobserved = budget.counted(run), missing and platform_unobserved(study, problem)
    contest = Contest(study, problem, found, unobserved, tried, report, excused, effort)
    fit = _first(problem, found[0], tried, report) if missing else tried(problem, starts, report)
    starts = shown(found[0], starts, contest) if missing else starts
    raced = reason_at_first(fit, contest)
    if raced:
        fit, starts = race(raced, fit, starts, contest)
    fit = beyond_discontinuity(fit, problem, tried, report, effort.some(MOST_RESTARTS))
    again = reason_in_the_end(fit, starts, contest, bool(raced))
    if again:
        fit, starts = race(again, fit, starts, contest)
    if budget.refused and fit.ending == Ending.RUNNING:  # the best of what was begun, brought to its end
        fit = summed(run(problem, problem.decode(fit.free), report), [fit])
    fit, problem = with_noise(fit, problem, run, report)
    return (fit._replace(message=fit.message + budget.word) if budget.refused else fit), problem, starts


def _compile(problem: Problem, study: Study, starts: dict[str, float]) -> None:
    """Compile values and Jacobian side by side: XLA is busy with one while Python traces the other."""
    with ThreadPoolExecutor() as pool:
        pool.submit(study.lowered(starts).compile)
        pool.submit(problem.lowered(problem.encode(starts)).compile)


def _first(problem: Problem, starts: dict[str, float], run: FitMethod, report: Progress) -> Fit:
    """The fit from the most promising start, broken off where it leads nowhere."""
    first = run(problem, starts, report, _FIRST)
    if first.success or not reduced_chi2(first, problem) < _PROMISING:
        return first
    fit = run(problem, problem.decode(first.free), report)
    return summed(fit, [first])
