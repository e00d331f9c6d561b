"""Why a fit is raced against fits from other starts, which ones, and for how long: one table, one rule.

Every race is a successive halving (`successive_halving.py`).  Before a fit is trusted there may be one at first, while
it is poor, and one in the end, where the best optimum may yet lie elsewhere or the way was long.
"""

import dataclasses
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from ...study import Parameter, Study, Values
from ..effort import USUAL, Effort
from ..fit_statistics import reduced_chi2
from ..initial_values.search import rank_starts, scatter_starts
from ..least_squares import Fit, FitMethod, Progress, piezo_alone
from ..poor_fit import enlarged_covariance, is_poor
from ..problem import Problem
from ..stack_parameters import of_platform_alone, shown_by_platform
from ..validation import is_refuted, missed_records
from .perturbed_restarts import MOST_RESTARTS, restarts
from .successive_halving import successive_halving


class Race(NamedTuple):
    """Other starts that a fit is compared with, and when that ends."""

    rounds: tuple[tuple[int, int], ...]
    """Successive halving: how many starts, and the iterations of each; the best go on."""
    until_good: bool
    """It ends with the first fit that converged and is not poor; else when the best starts are used up or improve
    nothing."""
    announced: str = ""
    """What the user reads of the reason."""
    scattered: bool = False
    """Against starts that differ in every parameter, the best of which is restarted from perturbed points at the end;
    else against those that differ in what the search looked for."""


RACES = {
    "platform unobserved": Race(((30, 5), (12, 7)), until_good=False),
    "poor": Race(((10, 5), (4, 7)), until_good=True),
    "elsewhere": Race(((48, 6), (12, 12)), False, "searching for starts that differ in every parameter", True),
    "long way": Race(((10, 5), (4, 7)), False, "that was a long way: comparing with other starts"),
}
"""By reason.  Where nothing shows the platform alone, a fit may be good and wrong."""

_SCATTERED, _STACK_GIVEN = 32, 16
"""Starts of "elsewhere" that differ in every parameter; and that differ in what the study does not say of the stack."""

_LONG = 60
"""Iterations from which the way was long: three of 97 blind random rigs ended in a wrong optimum, all after more."""

_NOTICEABLE = 4.0
"""Decrease of chi-square that noise alone seldom leaves: two standard errors of one parameter."""


class Contest(NamedTuple):
    """What all races of one study share."""

    study: Study
    problem: Problem
    found: list[dict[str, float]]
    """Starts that a search found for what has none, the most promising first; empty where everything has one."""
    platform_unobserved: bool
    """The piezo is searched for, and no record shows the platform alone."""
    run: FitMethod
    report: Progress
    excused: Callable[[Fit, Problem], bool] | None = None
    """Whether what a poor fit leaves comes of what is held in it, so that no other start would help; None: never."""
    effort: Effort = USUAL
    """How many starts are tried."""

    def is_poor(self, fit: Fit) -> bool:
        """A `fit` leaves more than noise, or records contradict each other, and another start may mend it.

        Or those that were not fitted are not predicted.  Nothing is said of them where what is held in the fit is
        excused, since its errors would count, too.
        """
        if is_poor(fit, self.problem):
            return not (self.excused and self.excused(fit, self.problem))
        if self.excused or all(record.role == "fit" for record in self.study.records):
            return False
        return is_refuted(missed_records(self.study, self.problem, fit, enlarged_covariance(fit, self.problem)))


def platform_unobserved(study: Study, problem: Problem) -> bool:
    """Records depend on the platform, none shows it alone, and the study does not say where its parameters start."""
    piezo = [p for path, p in study.parameters.items() if path.startswith("piezo.") and p.free and p.start is None]
    depends = any(record.measurement.effector_moves for record in problem.records)
    return bool(piezo) and depends and not of_platform_alone(problem.records).any()


def reason_at_first(fit: Fit, contest: Contest) -> str | None:
    """Why a first `fit` is to be raced against others, a key of `RACES`; None where it need not be."""
    if contest.platform_unobserved:
        return "platform unobserved"
    return "poor" if contest.is_poor(fit) else None


def reason_in_the_end(fit: Fit, starts: dict[str, float], contest: Contest, raced: bool) -> str | None:
    """Why a `fit` is to be raced against others although it stands; `raced` tells whether it was before."""
    problem = contest.problem
    # The starts given or searched for, or a bound, may not have let the fit go where the best optimum is.
    if contest.is_poor(fit) if raced else _at_new_bound(fit, problem, starts):
        return "elsewhere"
    # Starts that the study gives are left alone where they lead to an end.
    doubted = len(contest.found) > 1 or not fit.success
    return "long way" if fit.iterations > _LONG and not raced and doubted else None


def race(reason: str, fit: Fit, starts: dict[str, float], contest: Contest) -> tuple[Fit, dict[str, float]]:
    """The best of `fit` and of the fits from the other starts that the `reason` asks for, and its starts."""
    (rounds, until_good, announced, scattered), (_, problem, _, _, run, report, _, effort) = RACES[reason], contest
    rounds = [(effort.some(admitted), limit) for admitted, limit in rounds]
    if announced:
        report(announced)
    others = _scattered(fit, starts, contest) if scattered else _searched(starts, contest)
    if scattered and not others:
        return fit, starts
    good = lambda fit: until_good and fit.success and not contest.is_poor(fit)
    best, begun = successive_halving(fit, problem, starts, others, rounds, good, run, report)
    if scattered:
        report("restarting the best from perturbed points")
        return restarts(best, problem, run, effort.some(2 * MOST_RESTARTS)), begun
    return best, shown(begun, starts, contest)


def ranked(
    study: Study, parameters: Mapping[str, Parameter], problem: Problem, starts: Values, report: Progress
) -> list[dict[str, float]]:
    """Starts from the search, the most promising first, with the piezo from the platform records alone."""
    piezo = piezo_alone(problem, starts, report)
    report("searching for starts")
    return rank_starts(study.models, parameters, study.records, piezo)


def shown(begun: dict[str, float], earlier: dict[str, float], contest: Contest) -> dict[str, float]:
    """The starts to report: what the platform shows has those from before its own fit, unless searched for."""
    if contest.platform_unobserved:
        return begun
    return begun | {path: number for path, number in earlier.items() if shown_by_platform(path, contest.problem)}


def _searched(starts: dict[str, float], contest: Contest) -> list[dict[str, float]]:
    """What a search found beside the first; where the study gives all starts, what one finds without them."""
    if contest.found:
        return contest.found[1:]
    return ranked(contest.study, _without_starts(contest), contest.problem, starts, contest.report)


def _scattered(fit: Fit, starts: dict[str, float], contest: Contest) -> list[dict[str, float]]:
    """Starts that differ in every parameter but for what is known better, held where the `fit` has it.

    That is what the platform alone shows, and what was measured apart.  Beside them starts with the stack as the
    study gives it: the more parameters are scattered, the fewer starts come near a narrow basin around it.
    """
    study, problem = contest.study, contest.problem
    platform = of_platform_alone(problem.records).any()
    known = lambda path: path in problem.residual.apart or (platform and shown_by_platform(path, problem))
    held = [path for path in problem.residual.transform.paths if known(path)]
    around = starts | {path: float(number) for path, number in problem.decode(fit.free).items() if path in held}
    scattered = scatter_starts(study.models, study.parameters, study.records, around, held)[
        : contest.effort.some(_SCATTERED)
    ]
    given = {path: p.start for path, p in study.parameters.items() if path.startswith("piezo.") and p.free}
    given = {path: start for path, start in given.items() if start is not None and path not in held}
    if not given:
        return scattered
    contest.report("searching for starts with the stack as the study gives it")
    what = study.models, study.parameters, study.records, around | given, [*held, *given]
    return [*scatter_starts(*what, to_sticking=True)[: contest.effort.some(_STACK_GIVEN)], *scattered]


def _without_starts(contest: Contest) -> dict[str, Parameter]:
    """The parameters as a search may start them anywhere, but for those that are known better.

    They are those that the platform shows and those that were measured apart.
    """
    known = lambda path, p: not p.free or p.standard_error or shown_by_platform(path, contest.problem)
    listed = contest.study.parameters.items()
    return {path: p if known(path, p) else dataclasses.replace(p, start=None) for path, p in listed}


def _at_new_bound(fit: Fit, problem: Problem, starts: dict[str, float]) -> bool:
    """The fit was driven into a bound that it did not start from: there may be a better optimum elsewhere.

    Not where it would gain no more than noise beyond the bound: then the records just do not tell the parameter from
    it, such as a damping from none.
    """
    low, high = problem.bounds
    begun = problem.encode(starts)
    reached = ((fit.free <= low) & (begun > low)) | ((fit.free >= high) & (begun < high))
    return bool(reached.any()) and _gain_beyond_bounds(fit, problem) > _NOTICEABLE


def _gain_beyond_bounds(fit: Fit, problem: Problem) -> float:
    """Decrease of chi-square, in units of its reduced value, that the linear model predicts without bounds."""
    jacobian, residual = np.asarray(fit.state.jacobian), np.asarray(fit.state.residual)
    size = np.linalg.norm(jacobian, axis=0)
    jacobian = jacobian / np.where(size > 0, size, 1.0)
    step = np.linalg.lstsq(jacobian, residual, rcond=1e-9)[0]
    return float(np.sum((jacobian @ step) ** 2) / max(reduced_chi2(fit, problem), 1e-300))
