"""Races of a fit against fits from other starts: why, against which, and for how long.

Before a fit is trusted there may be a race at first, while it is poor, and one in the end, where the best optimum may
yet lie elsewhere or the way was long.  Every race is a successive halving: many starts are fitted for a few iterations,
of which the best go on (K. Jamieson and A. Talwalkar, Non-stochastic best arm identification and hyperparameter
optimization, AISTATS 2016).

Restarts from points perturbed around where a fit ended look beyond a discontinuity, or into the next valley.  Each is a
step of monotonic basin hopping (R. H. Leary, Journal of Global Optimization 18, 2000): a point is kept only where the
fit from it ends lower.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ...study import Parameter, Study, Values
from ..covariance import scaled_least_squares
from ..effort import USUAL, Effort
from ..evidence import Evidence
from ..initial_values.search import rank_starts, scatter_starts
from ..least_squares import Fit, FitMethod, Progress, piezo_alone, quiet
from ..problem import Problem
from ..solver.derivative_check import CHECKS
from ..solver.lm_state import STOPPED, Ending
from ..stack_parameters import platform_alone_records, shown_by_platform
from ..validation import is_refuted

PATIENCE = 3
"""Starts in a row that may fail to improve a poor fit: then it is the model that is poor."""


class Candidate(NamedTuple):
    """A start, and how far the fit from it has come."""

    start: dict[str, float]
    point: Values
    iterations: int


def successive_halving(
    fit: Fit,
    problem: Problem,
    start: dict[str, float],
    rivals: Sequence[dict[str, float]],
    rounds: Sequence[tuple[int, int]],
    good: Callable[[Fit], bool],
    run: FitMethod,
    report: Progress,
) -> tuple[Fit, dict[str, float]]:
    """The best of `fit` and of the fits from the `rivals`, with the evaluations of all, and its start."""
    total, candidates = fit.evaluations, [Candidate(rival, rival, 0) for rival in rivals]
    unfinished = [(fit, start)] if fit.ending == Ending.RUNNING else []
    for admitted, limit in rounds:
        results = []
        for number, candidate in enumerate(candidates[:admitted], 1):
            report(f"trying others: start {number} of {min(admitted, len(candidates))}, {limit} iterations each")
            rival = run(problem, candidate.point, quiet, limit)
            total += rival.evaluations
            results.append((rival._replace(iterations=rival.iterations + candidate.iterations), candidate.start))
        results = sorted(results + unfinished, key=lambda result: result[0].chi2)
        candidates = [Candidate(begun, problem.decode(rival.free), rival.iterations) for rival, begun in results]
        unfinished = []
    in_vain = 0
    for candidate in candidates:
        if in_vain == PATIENCE or good(fit):
            break
        report("going on from the best of the other starts")
        rival = run(problem, candidate.point, report)
        total += rival.evaluations
        in_vain = 0 if rival.chi2 < (1.0 - 1e-3) * fit.chi2 else in_vain + 1
        if rival.chi2 <= (1.0 + 1e-9) * fit.chi2:
            fit, start = rival._replace(iterations=rival.iterations + candidate.iterations), candidate.start
    return fit._replace(evaluations=total), start


_DISCONTINUOUS_ENDINGS = (*STOPPED, Ending.DISCONTINUITY, Ending.SMALL_JUMP, Ending.KINK)

MOST_RESTARTS = 4
"""Perturbed restarts in a row that may fail to lower chi-square."""

_MOST_EVALUATIONS = 2.2
"""Evaluations per iteration beyond which many steps were rejected or bent: a smooth step takes one, others two."""

_LARGEST_PERTURBATION = 0.3
"""Largest change of one parameter by a perturbation, on the fit's scale."""


def beyond_discontinuity(
    fit: Fit, problem: Problem, run: FitMethod, report: Progress, most: int = MOST_RESTARTS
) -> Fit:
    """`fit`, or a better one beyond a discontinuity at which it may have ended, after `most` restarts in vain."""
    if _is_discontinuous(fit):
        report("chi-square is discontinuous here: restarting from perturbed points")
        return restarts(fit, problem, run, most, _is_discontinuous)
    return fit


def restarts(
    fit: Fit, problem: Problem, run: FitMethod, most: int, needed: Callable[[Fit], bool] = lambda fit: True
) -> Fit:
    """`fit`, or a better one from points perturbed more and more, as long as that is `needed`.

    The first `MOST_RESTARTS` are perturbed along what the records hardly show, by two standard errors and then twice as
    much after each that fails, further ones as much in every parameter.  There are none around where nothing can be
    simulated.

    **Returns:** the best, once so many in a row as `most` found no better one, with the evaluations of all.
    """
    random = np.random.default_rng(0)
    iterations = spent = in_vain = 0
    while np.isfinite(fit.chi2) and needed(fit) and in_vain < most:
        factor = 2.0 ** (in_vain % MOST_RESTARTS)
        # In every parameter, so that those at bounds leave them.
        if in_vain >= MOST_RESTARTS or problem.residual.transform.at_bound(fit.free).all():
            step = 0.01 * factor * random.normal(size=fit.free.size)
        else:
            step = _step_of_errors(fit, problem, factor, random)
        step = step / max(1.0, np.max(np.abs(step)) / _LARGEST_PERTURBATION)
        rival = run(problem, problem.decode(np.clip(fit.free + step, *problem.bounds)), quiet)
        spent += rival.evaluations
        in_vain = 0 if rival.chi2 < fit.chi2 - 1.0 else in_vain + 1
        if rival.chi2 < fit.chi2 - 0.01:
            iterations, spent = iterations + fit.iterations, spent - rival.evaluations + fit.evaluations
            fit = rival
    return fit._replace(iterations=fit.iterations + iterations, evaluations=fit.evaluations + spent)


def _is_discontinuous(fit: Fit) -> bool:
    """Whether many steps were rejected on the way, or the last ones: chi-square is not what its gradient predicts."""
    # Of its last run alone: the evaluations of a fit are also those of all that it was compared with.
    last = fit.state
    # A smooth run takes one evaluation an iteration, besides the start and the checks of its derivatives.
    steps = int(last.evaluations) - 1 - CHECKS
    return fit.ending in _DISCONTINUOUS_ENDINGS or steps > _MOST_EVALUATIONS * int(last.iterations)


def _step_of_errors(fit: Fit, problem: Problem, factor: float, random: np.random.Generator) -> np.ndarray:
    """A random step of some standard errors, in parameters that are not at bounds."""
    moves = ~problem.residual.transform.at_bound(fit.free)
    _, singular, rows = np.linalg.svd(np.where(moves, np.asarray(fit.state.jacobian), 0.0), full_matrices=False)
    errors = 1.0 / np.maximum(singular, 1e-9 * singular[0])
    sizes = np.minimum(2.0 * factor * errors, _LARGEST_PERTURBATION)
    return (rows.T @ (sizes * random.normal(size=singular.size))) * moves


class Race(NamedTuple):
    """Other starts that a fit is compared with, and when that ends."""

    rounds: tuple[tuple[int, int], ...]
    """Successive halving: how many starts, and the iterations of each; the best go on."""
    until_good: bool
    """Whether the first fit that converged and is not poor ends the race; else it ends when the best starts are used up
    or improve nothing."""
    announced: str = ""
    """The reason in words, for the report."""
    scattered: bool = False
    """Against starts that differ in every parameter, the best of which is restarted from perturbed points at the end;
    else against those that differ in what the search looked for."""


_SCATTERED, _STACK_GIVEN = 32, 16
"""Starts of "elsewhere" that differ in every parameter; and that differ in what the study does not say of the stack."""

RACES = {
    "platform unobserved": Race(((30, 5), (12, 7)), until_good=False),
    "poor": Race(((10, 5), (4, 7)), until_good=True),
    "elsewhere": Race(
        ((_SCATTERED + _STACK_GIVEN, 6), (12, 12)), False, "searching for starts that differ in every parameter", True
    ),
    "long way": Race(((10, 5), (4, 7)), False, "that was a long way: comparing with other starts"),
}
"""The races by reason.  Where nothing shows the platform alone, a fit may be good and wrong."""

_LONG = 60
"""Iterations from which the way was long: three of 97 blind random rigs ended in a wrong optimum, all after more."""

_NOTICEABLE = 4.0
"""Decrease of chi-square that noise alone seldom leaves: two standard errors of one parameter."""


@dataclasses.dataclass
class RaceContext:
    """What all races of one study share."""

    study: Study
    problem: Problem
    searched_starts: list[dict[str, float]]
    """Starts that a search found for what has none, the most promising first; empty where everything has one."""
    platform_unobserved: bool
    """The piezo is searched for, and no record shows the platform alone."""
    run: FitMethod
    report: Progress
    held_values_explain: Callable[[Fit, Problem], bool] | None = None
    """Whether what a poor fit leaves comes of what is held in it, so that no other start would help; None: never."""
    effort: Effort = USUAL
    """Decides how many starts are tried."""
    last_evidence: Evidence | None = None

    def is_poor(self, fit: Fit) -> bool:
        """Whether a `fit` leaves more than noise or its records contradict each other, and another start may mend it.

        A fit is also poor where it does not predict the records that were not fitted.  This is not tested where values
        are held (`held_values_explain` is given): their errors would count against the fit.
        """
        evidence = self.evidence(fit)
        if evidence.is_poor:
            return not (self.held_values_explain and self.held_values_explain(fit, self.problem))
        return not self.held_values_explain and is_refuted(evidence.missed)

    def evidence(self, fit: Fit) -> Evidence:
        """The evidence of a `fit`, computed once for each."""
        if self.last_evidence is None or self.last_evidence.fit is not fit:
            self.last_evidence = Evidence(self.problem, fit, self.study)
        return self.last_evidence


def platform_unobserved(study: Study, problem: Problem) -> bool:
    """Whether records depend on the platform, none shows it alone, and the study gives its parameters no starts."""
    piezo = [p for path, p in study.parameters.items() if path.startswith("piezo.") and p.free and p.start is None]
    depends = any(record.measurement.effector_moves for record in problem.records)
    return bool(piezo) and depends and not platform_alone_records(problem.records).any()


def reason_at_first(fit: Fit, context: RaceContext) -> str | None:
    """Why a first `fit` is to be raced against others, a key of `RACES`; None where it need not be."""
    if context.platform_unobserved:
        return "platform unobserved"
    return "poor" if context.effort.compares and context.is_poor(fit) else None


def reason_in_the_end(fit: Fit, starts: dict[str, float], context: RaceContext, raced: bool) -> str | None:
    """Why a `fit` is to be raced against others although it stands; `raced` tells whether it was before."""
    problem = context.problem
    if not context.effort.compares:
        return None
    # The starts given or searched for, or a bound, may not have let the fit go where the best optimum is.
    if context.is_poor(fit) if raced else _at_new_bound(fit, problem, starts):
        return "elsewhere"
    # Starts that the study gives are left alone where they lead to an end.
    doubted = len(context.searched_starts) > 1 or not fit.success
    return "long way" if fit.iterations > _LONG and not raced and doubted else None


def race(reason: str, fit: Fit, starts: dict[str, float], context: RaceContext) -> tuple[Fit, dict[str, float]]:
    """The best of `fit` and of the fits from the other starts that the `reason` asks for, and its starts."""
    rounds, until_good, announced, scattered = RACES[reason]
    problem, run, report, effort = context.problem, context.run, context.report, context.effort
    rounds = [(effort.some(admitted), limit) for admitted, limit in rounds]
    if announced:
        report(announced)
    others = _scattered(fit, starts, context) if scattered else _other_starts(starts, context)
    if scattered and not others:
        return fit, starts
    good = lambda fit: until_good and fit.success and not context.is_poor(fit)
    best, begun = successive_halving(fit, problem, starts, others, rounds, good, run, report)
    if scattered:
        report("restarting the best from perturbed points")
        return restarts(best, problem, run, effort.some(2 * MOST_RESTARTS)), begun
    return best, starts_to_report(begun, starts, context)


def ranked(parameters: Mapping[str, Parameter], starts: Values, context: RaceContext) -> list[dict[str, float]]:
    """Starts from the search, the most promising first, with the piezo from the platform records alone."""
    study, loss = context.study, context.problem.residual.loss
    piezo = piezo_alone(context.problem, starts, context.report)
    context.report("searching for starts")
    return rank_starts(study.models, parameters, study.records, piezo, context.effort.starts, loss)


def starts_to_report(
    start: dict[str, float], before_platform_fit: dict[str, float], context: RaceContext
) -> dict[str, float]:
    """A `start`, with what the platform alone determines as it was `before_platform_fit`.

    Unless that was searched for: then no record shows the platform alone.
    """
    if context.platform_unobserved:
        return start
    given = before_platform_fit.items()
    return start | {path: number for path, number in given if shown_by_platform(path, context.problem)}


def _other_starts(starts: dict[str, float], context: RaceContext) -> list[dict[str, float]]:
    """Further starts from a search; where the study gives all starts, those found without them.

    What the platform shows and what was measured apart is known better, and keeps its starts.
    """
    if context.searched_starts:
        return context.searched_starts[1:]
    known = lambda path, p: not p.free or p.standard_error or shown_by_platform(path, context.problem)
    parameters = context.study.parameters.items()
    anywhere = {path: p if known(path, p) else dataclasses.replace(p, start=None) for path, p in parameters}
    return ranked(anywhere, starts, context)


def _scattered(fit: Fit, starts: dict[str, float], context: RaceContext) -> list[dict[str, float]]:
    """Starts that differ in every parameter but for what is known better, held where the `fit` has it.

    That is what the platform alone shows, and what was measured apart.  Beside them starts with the stack as the
    study gives it: the more parameters are scattered, the fewer starts come near a narrow basin around it.
    """
    study, problem = context.study, context.problem
    platform = platform_alone_records(problem.records).any()
    known = lambda path: path in problem.residual.prior.paths or (platform and shown_by_platform(path, problem))
    held = [path for path in problem.residual.transform.paths if known(path)]
    around = starts | {path: float(number) for path, number in problem.decode(fit.free).items() if path in held}
    loss = problem.residual.loss
    scattered = scatter_starts(study.models, study.parameters, study.records, around, held, loss=loss)
    scattered = scattered[: context.effort.some(_SCATTERED)]
    stack = {path: p for path, p in study.parameters.items() if path.startswith("piezo.") and path not in held}
    given = {path: p.start for path, p in stack.items() if p.free and p.start is not None}
    if not given:
        return scattered
    context.report("searching for starts with the stack as the study gives it")
    what = study.models, study.parameters, study.records, around | given, [*held, *given]
    return [*scatter_starts(*what, to_sticking=True, loss=loss)[: context.effort.some(_STACK_GIVEN)], *scattered]


def _at_new_bound(fit: Fit, problem: Problem, starts: dict[str, float]) -> bool:
    """Whether the fit was driven into a bound that it did not start from: a better optimum may lie elsewhere.

    Not where it would gain no more than noise beyond the bound: then the records just do not tell the parameter from
    it, such as a damping from none.
    """
    low, high = problem.bounds
    begun = problem.encode(starts)
    reached = ((fit.free <= low) & (begun > low)) | ((fit.free >= high) & (begun < high))
    if not reached.any():
        return False
    # By the linear model without bounds.
    jacobian, residual = np.asarray(fit.state.jacobian), np.asarray(fit.state.residual)
    gain = float(np.sum((jacobian @ scaled_least_squares(jacobian, residual, 1e-9)) ** 2))
    return gain / max(Evidence(problem, fit).reduced_chi2, 1e-300) > _NOTICEABLE
