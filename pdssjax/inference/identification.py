"""Identification of the parameters of a study: jointly, or the piezo first as the thesis did."""

import dataclasses
import functools
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from typing import Literal, NamedTuple, TypeAlias, get_args

import equinox as eqx
import numpy as np

from ..core import (
    Given,
    InputError,
    check_executor,
    check_kind,
    clear_bar,
    member,
    members,
    nearest,
    notebook_progress,
    one_blas_thread,
    require_float64,
)
from ..integration import Accuracy, accuracy_with
from ..study import OWN_MINIMISER, Estimate, Study
from .draws import Drawing
from .effort import Effort, effort_of
from .evidence import Evidence
from .integrator_check import check_accuracy, with_check
from .kept_fit import FitAndStarts, fit_document, restored_fit, run_settings
from .least_squares import MAX_ITERATIONS, Fit, FitMethod, Method, Progress, evaluated, joint, quiet
from .losses.base import AbstractLoss
from .problem import Problem
from .record_checks import check_measured_once, warn_of_reversed_signs
from .search.multistart import BestPoint, Point, best_fit, best_of_starts, check_starts, with_all_records, with_noise
from .solver.minimisers import Minimiser, check_minimiser
from .stack_first.held_stack import due_to_stack, point_of_whole_study, sequential, with_stack_held
from .stack_first.peak_picking import PickedStack, pick_peaks
from .summary import summarise
from .uncertainty.drawn_intervals import with_bootstrap, with_posterior
from .uncertainty.parameter_errors import with_error_models
from .uncertainty.profile_intervals import with_profile_intervals

Intervals: TypeAlias = Literal["linear", "profile", "bootstrap", "posterior"]
"""Intervals by the covariance, by profile likelihood, by a bootstrap, or by draws of the posterior."""

DRAWN = ("bootstrap", "posterior")
"""Kinds of intervals that are drawn."""


class FitInterrupted(KeyboardInterrupt):
    """A fit was broken off: by Ctrl-C, or by whatever else raises `KeyboardInterrupt` in the main thread."""

    estimate: Estimate | None
    """The estimate at the best point so far, not converged unless the fit was done; None where there is none yet."""

    def __init__(self, estimate: Estimate | None):
        super().__init__("the fit was interrupted")
        self.estimate = estimate


@one_blas_thread()
def identify(
    study: Study,
    method: Method = "joint",
    *,
    intervals: Intervals = "linear",
    loss: str = "squares",
    effort: str | Effort = "usual",
    drawing: Drawing | None = None,
    starts: int = 0,
    executor: Executor | None = None,
    progress: Progress | None = None,
    accuracy: Accuracy | None = None,
    solver: Given = None,
    minimiser: Minimiser | None = None,
    check_with: Given = None,
) -> Estimate:
    """Estimate the free parameters of a study from its records with role "fit", with uncertainties.

        study = pdssjax.load_study("my-rig/study.toml")
        estimate = pdssjax.identify(study, intervals="profile")
        estimate.parameters["friction.sigma0_a"].interval

    **Arguments:**

    - `study`: models, parameters and records.
    - `method`: "joint", all parameters from all records at once; "sequential", the piezo from the platform records,
      then the others with the piezo held and its errors propagated; "peaks", as sequential, but with the piezo read
      from the peaks of step responses (`peak_picking`).
    - `intervals`: "linear", symmetric on the scale of the fit; "profile" (joint only), by profile likelihood;
      "posterior" (joint only), by draws of the posterior; "bootstrap" (not "peaks"), one whole fit per replicate.
    - `loss`: "squares"; or, for a joint fit with linear intervals, "huber" or "cauchy", which limit the influence of
      outliers and have standard errors from a sandwich covariance.
    - `effort`: "quick", "usual", "thorough" or an `Effort`: how many starts a doubtful fit is compared with, how many
      evaluations that may take, and after how many slow steps a fit ends.
    - `drawing`: number, seed and storage of bootstrap replicates or posterior draws.
    - `starts`: number of additional starts to fit and compare (`Estimate.multistart`).
    - `executor`: where independent fits and chains run; None: in this thread.  Profiles and posteriors need threads;
      processes must be spawned, not forked.
    - `progress`: called with lines of text; None: a bar in notebooks.
    - `accuracy` or `solver` (not both): how to integrate, in place of the study's solver.  `solver` is a name in
      `pdssjax.integration.SOLVERS` or a diffrax solver.
    - `minimiser`: an optimistix solver such as `optimistix.Dogleg(rtol=1e-8, atol=1e-8)`, in place of
      `BoundedLevenbergMarquardt`.
    - `check_with`: an integrator, given as `solver` is, by which the fit is repeated from its optimum
      (`Estimate.check`).

    **Returns:** the estimate.  A fit that does not converge is returned, too, with `converged` False and the reason in
    `message`.

    **Raises:** `InputError` where there is nothing to fit, or no record to pick peaks from.  `FitInterrupted`, a
    `KeyboardInterrupt` with the best point so far in `estimate`.  Warns with `InputWarning` where a record moves
    against its drive.
    """
    require_float64("identify")
    begun = time.perf_counter()
    kinds = {"drawing": (drawing, Drawing), "executor": (executor, Executor), "accuracy": (accuracy, Accuracy)}
    _check_arguments(study, method, intervals, executor, minimiser, starts, kinds)
    integrator = _integrator(study, accuracy, solver)
    stack = pick_peaks(study) if method == "peaks" else None
    identification = _Identification(
        whole=study,
        study=with_stack_held(study, stack.values) if stack else study,
        stack=stack,
        method=method,
        loss=_loss(loss, method, intervals),
        intervals=intervals,
        drawing=drawing or Drawing(),
        starts=starts,
        executor=executor,
        accuracy=integrator,
        minimiser=minimiser,
        referee=check_accuracy(check_with, integrator),
        report=progress or notebook_progress() or quiet,
        held_values_explain=functools.partial(due_to_stack, study, stack, integrator) if stack else None,
        effort=effort_of(effort),
        begun=begun,
    )
    return identification.estimate()


class _Identification(NamedTuple):
    """The checked arguments of `identify`, and the steps from them to an estimate."""

    whole: Study
    study: Study
    """The whole study, or its part with the stack held where that was picked from peaks."""
    stack: PickedStack | None
    method: Method
    loss: AbstractLoss
    intervals: Intervals
    drawing: Drawing
    starts: int
    executor: Executor | None
    accuracy: Accuracy
    minimiser: Minimiser | None
    """A solver in place of the package's own."""
    referee: Accuracy | None
    """The integrator of the fit that checks this one; None: no check."""
    report: Progress
    held_values_explain: Callable[[Fit, Problem], bool] | None
    """Whether the errors of the stack held in a poor fit explain its residuals; None without such a stack."""
    effort: Effort
    begun: float
    """Time at which the identification began [s]."""

    @property
    def run(self) -> FitMethod:
        """The function that fits by the method, with the minimiser if there is one; without, processes can take it."""
        usual: FitMethod = sequential if self.method == "sequential" else joint
        if self.minimiser is None:
            return usual
        return lambda problem, starts, report, limit=MAX_ITERATIONS: usual(
            problem._replace(minimiser=self.minimiser), starts, report, limit
        )

    def estimate(self) -> Estimate:
        """The estimate; **raises** `FitInterrupted` with the best so far where it is broken off."""
        best, finished, estimate = BestPoint(), None, None
        try:
            found = self._fit(best)
            finished = Point(found.evidence.fit, found.evidence.problem, found.starts, 2)
            estimate = self._summary(finished, not self.effort.compares, found.evidence)
            estimate = dataclasses.replace(estimate, multistart=found.multistart, effort=self.effort.name)
            estimate = self._with_intervals(estimate, found.evidence)
            if self.referee is not None:
                second = eqx.tree_at(lambda problem: problem.residual.accuracy, found.evidence.problem, self.referee)
                second = second._replace(minimiser=self.minimiser)
                estimate = with_check(estimate, found.evidence.fit, second, self.method, self.report)
            estimate = dataclasses.replace(estimate, seconds=time.perf_counter() - self.begun)
        except KeyboardInterrupt as interrupt:
            point = finished or best.point
            if estimate is None and point is not None:
                estimate = self._summary(point, briefly=not finished)
            raise FitInterrupted(estimate) from interrupt
        finally:
            clear_bar(self.report)
        return estimate

    def _fit(self, best: BestPoint) -> FitAndStarts:
        """The fit, its problem and its starts: found anew, or those of the run whose draws are resumed."""
        study, report, accuracy, effort = self.study, self.report, self.accuracy, self.effort
        drawn = self.intervals in DRAWN
        settings = run_settings(study, self.method, self.intervals, self.drawing, self.starts, accuracy, effort.name)
        if drawn and (earlier := restored_fit(self.drawing, settings, study, accuracy, report, effort)) is not None:
            return earlier
        report("finding starts")
        evidence, starts = best_fit(
            study, accuracy, best.watched(self.run), report, self.loss, self.held_values_explain, effort
        )
        table = None
        if self.starts:
            problem, usual = evidence.problem, evidence.fit
            fit, starts, table = best_of_starts(
                study, problem, usual, starts, self.starts, self.run, self.executor, report
            )
            if fit.chi2 < usual.chi2:
                fit, problem = with_noise(fit, problem, self.run, report)
            evidence = Evidence(problem, fit, study)
        found = FitAndStarts(evidence, starts, table)
        if drawn:
            self.drawing.store.begin(fit_document(settings, found))
        return found

    def _summary(self, point: Point, briefly: bool, known: Evidence | None = None) -> Estimate:
        """The estimate at a `point`, by the whole study; `known` is its evidence, if computed already."""
        study, stack, report = self.whole, self.stack, self.report
        # An interrupted process may be killed soon: `briefly` leaves out second derivatives, which take long.
        report("predicting every record")
        point = point._replace(fit=with_all_records(point, report), covers=2)
        if stack is not None:
            point = point_of_whole_study(study, point, point.problem.residual.accuracy, report)
        if known is None or known.fit is not point.fit:
            known = Evidence(point.problem, point.fit, study)
        estimate = summarise(study, self.method, known, point.starts, stack)
        if stack is None and not point.problem.residual.loss.is_robust and not briefly:
            estimate = with_error_models(estimate, known, report)
        minimiser = OWN_MINIMISER if self.minimiser is None else type(self.minimiser).__name__
        return dataclasses.replace(estimate, minimiser=minimiser, seconds=time.perf_counter() - self.begun)

    def _with_intervals(self, estimate: Estimate, evidence: Evidence) -> Estimate:
        """`estimate` with the intervals asked for; linear ones where nothing can be drawn around the fit."""
        problem, fit, intervals = evidence.problem, evidence.fit, self.intervals
        if intervals == "linear" or not np.isfinite(fit.chi2):
            return estimate
        if intervals == "profile":
            return with_profile_intervals(estimate, evidence, self.executor, self.report)
        if not estimate.converged:
            note = f"No {intervals}: the fit did not converge, and its intervals are linear."
            return dataclasses.replace(estimate, notes=(*estimate.notes, note))
        # Evaluated anew, so that a resumed run begins with the same numbers to the last bit.
        evidence = Evidence(problem, evaluated(problem, fit.free, quiet))
        settings = self.drawing, self.executor, self.report
        if intervals == "posterior":
            return with_posterior(estimate, evidence, *settings)
        return with_bootstrap(estimate, evidence, self.run, *settings)


def _check_arguments(
    study: Study,
    method: Method,
    intervals: Intervals,
    executor: Executor | None,
    minimiser: Minimiser | None,
    starts: int,
    kinds: Mapping[str, tuple[object, type]],
) -> None:
    """**Raises** `InputError` for what is not of its kind or does not go together; warns of reversed signs.

    **Arguments:** `kinds` are further arguments by name, each with its type, which may be None.
    """
    check_kind("study", study, Study, "load_study")
    check_starts(starts)
    for name, (given, kind) in kinds.items():
        if given is not None:
            check_kind(name, given, kind)
    check_executor(executor)
    check_minimiser(minimiser)
    check_method(study, method)
    check_intervals(intervals, method, executor)
    warn_of_reversed_signs([record for record in study.records if record.role == "fit"])


def _integrator(study: Study, accuracy: Accuracy | None, solver: Given) -> Accuracy:
    if accuracy is not None and solver is not None:
        raise InputError("solver: found one beside an accuracy, expected one of both: Accuracy(method=...) says both.")
    return accuracy or (study.accuracy if solver is None else accuracy_with(solver))


def _loss(name: str, method: str, intervals: str) -> AbstractLoss:
    known = members("inference.losses")
    if name not in known:
        raise InputError(f'loss: found "{name}"; {nearest(name, known)}')
    loss = member("inference.losses", name)()
    if loss.is_robust and (method, intervals) != ("joint", "linear"):
        raise InputError(
            f'loss: found "{name}" with method "{method}" and intervals "{intervals}", expected "joint" and "linear".'
        )
    return loss


_METHODS: dict[str, tuple[str, ...]] = {
    "bootstrap": ("joint", "sequential"),
    "profile": ("joint",),
    "posterior": ("joint",),
}
"""The methods that have each kind of intervals; all have linear ones."""


def has_intervals(method: Method, intervals: Intervals) -> bool:
    """Whether a `method` has such `intervals`; all have linear ones."""
    return method in _METHODS.get(intervals, (method,))


def check_intervals(intervals: Intervals, method: Method, executor: Executor | None = None) -> None:
    """**Raises** `InputError` for `intervals` that a `method` has not, or an `executor` that cannot find them."""
    if intervals not in get_args(Intervals) or not has_intervals(method, intervals):
        raise InputError(
            f'intervals: found "{intervals}" with method "{method}", expected "linear", or with "joint" "profile", '
            '"bootstrap" or "posterior", or with "sequential" "bootstrap".'
        )
    from concurrent.futures import ProcessPoolExecutor  # it takes long to import

    if intervals in ("profile", "posterior") and isinstance(executor, ProcessPoolExecutor):
        raise InputError(
            f'executor: found a ProcessPoolExecutor with intervals "{intervals}", expected one of threads: what is '
            "compiled is shared."
        )


def check_method(study: Study, method: str) -> None:
    """**Raises** `InputError` where a `study` has nothing to fit, or not the records that a `method` needs."""
    where = study.path or study.title
    if method not in ("joint", "sequential", "peaks"):
        raise InputError(f'method: found "{method}", expected "joint", "sequential" or "peaks".')
    fitted = [record for record in study.records if record.role == "fit"]
    if not fitted:
        raise InputError(f'{where}: found no record with role "fit", expected at least one.')
    check_measured_once(study.records, where)
    free = [path for path, parameter in study.parameters.items() if parameter.free]
    if not free:
        raise InputError(f"{where}: parameters: found none that is free, expected at least one to fit.")
    steps = {(record.measurement.platform_alone, record.measurement.effector_free) for record in fitted}
    if method != "joint" and steps != {(True, False), (False, True)}:
        raise InputError(
            f"{where}: found fitted records of the {' and the '.join(sorted({r.measures for r in fitted}))} only; "
            f"the {method} method expects some of the platform, for the piezo, and some of the end-effector."
        )
