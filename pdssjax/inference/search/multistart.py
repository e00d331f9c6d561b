"""Fits from several starts, and the estimate of noise that is not given.

- `best_fit` races several starts (`races.py`) while a fit is poor, at a bound or slow to converge.  Chi-square has many
  minima: slips at wrong moments make wide ones, a contact that just reverses or just does not makes small jumps.  A fit
  that ends at such a jump is restarted from perturbed points.
- `with_noise` estimates the noise from the residuals and fits again, in turn.
- `best_of_starts` fits from as many Sobol points of the search ranges, on logarithmic scales, as a user asks for, and
  counts optima: two ends are one optimum where neither chi-square nor the linear model tells them apart.
"""

import functools
import warnings
from collections.abc import Callable
from concurrent.futures import Executor
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ...core import MOST_STARTS, InputWarning, check_whole, sobol_points
from ...integration import Accuracy, is_closed
from ...study import Multistart, Run, Study, Values, with_room
from ..draws import each_done
from ..effort import USUAL, Effort
from ..evidence import Evidence
from ..initial_values.search import guess_starts, scatter_ranges
from ..least_squares import MAX_ITERATIONS, Fit, FitMethod, Progress, by_record, evaluated, quiet, with_counts_of
from ..losses.base import AbstractLoss
from ..problem import Problem, pose
from ..solver.lm_state import Ending
from ..stack_parameters import platform_alone_records
from ..variable_projection import is_separable
from .races import (
    MOST_RESTARTS,
    RaceContext,
    beyond_discontinuity,
    platform_unobserved,
    race,
    ranked,
    reason_at_first,
    reason_in_the_end,
    starts_to_report,
)


class Point(NamedTuple):
    """A point that a run of a fit has come to."""

    fit: Fit
    problem: Problem
    starts: dict[str, float]
    """The starts of that run [SI], by path, with the fixed parameters."""
    covers: int
    """Records that the run fits: 2 all, 1 those that need the contact, 0 those of the platform."""


class BestPoint:
    """Remembers the best point of all runs that it watches."""

    def __init__(self):
        self.point: Point | None = None
        self._starts: dict[str, float] = {}

    def watched(self, run: FitMethod) -> FitMethod:
        """`run` with every iteration noted."""

        def watched_run(problem: Problem, starts: Values, report: Progress, limit: int = MAX_ITERATIONS) -> Fit:
            given = {**problem.residual.fixed, **starts}
            self._starts = {path: float(number) for path, number in given.items()}
            return run(problem._replace(watch=self.note), starts, report, limit)

        return watched_run

    def note(self, problem: Problem, used: Bool[np.ndarray, " records"], fit: Fit) -> None:
        """Keep the point of `fit`, of the records `used`, if it is the best so far.

        A run over more of the records is better, whatever its chi-square; among runs over the
        same ones chi-square tells, unless the noise was estimated anew: then the later counts.
        """
        if not np.isfinite(fit.chi2):
            return
        covers = 2 if used.all() else 1 if (used & ~platform_alone_records(problem.records)).any() else 0
        best = self.point
        if best is not None and covers <= best.covers:
            same_noise = np.array_equal(problem.noise, best.problem.noise)
            if covers < best.covers or (same_noise and fit.chi2 >= best.fit.chi2):
                return
        self.point = Point(fit, problem._replace(watch=None), self._starts, covers)


def with_all_records(point: Point, report: Progress) -> Fit:
    """The fit at a `point`, with the residuals and the Jacobian of all records."""
    if point.covers == 2:
        return point.fit
    whole = evaluated(point.problem, point.fit.free, report)
    return point.fit._replace(state=whole.state, evaluations=point.fit.evaluations + whole.evaluations)


def warn_of_memory_use(problem: Problem, starts: Values) -> None:
    """Warn with `InputWarning` of records whose derivatives take more than 2 GB; closed forms need no steps."""
    residual = problem.residual
    for record in problem.records:
        models, motion = residual.predictor.models, record.motion
        setup = record.measurement.setup(models)
        run = Run(record.drive, jnp.asarray(record.time), None if motion is None else jnp.asarray(motion))
        system = setup.system(models, {**residual.fixed, **starts}, run)
        if is_closed(system):
            continue
        segments, last = setup.segments(record.drive, record.time), float(record.time[-1])
        steps = with_room(residual.accuracy, setup, models, segments, last).max_steps
        directions = 1 + len(residual.transform.paths)
        # Bytes by step, component and direction: 240 000 steps of 6 components in 9 directions took 2.6 GB.
        size = 200.0 * steps * len(jax.tree.leaves(system.initial())) * directions
        if size > 2e9:
            warnings.warn(
                f'record "{record.name}": integrating its {last:.3g} s (up to {steps} steps) with derivatives takes '
                f"about {1e-9 * size:.1f} GB of memory, more than the 2 GB from which this warns. Shorten the record "
                '(window = ["0 s", "1 s"]) or fix parameters. A play or maxwell-slip stack needs no integration where '
                "only the platform is measured, without an amplifier and by a sensor without a bandwidth.",
                InputWarning,
                stacklevel=2,
            )


_FEWEST, _MOST = 2, 10
"""Fewest and most rounds of estimating the noise; a first guess from a few samples may be far too large."""


def with_noise(fit: Fit, problem: Problem, run: FitMethod, report: Progress) -> tuple[Fit, Problem]:
    """Estimate the noise of the records that do not give it, and fit again with that."""
    unknown = [record.noise is None for record in problem.records]
    sizes = np.array([record.time.size for record in problem.records])
    for number in range(_MOST):
        if not any(unknown) or not np.isfinite(fit.chi2) or (number and fit.ending == Ending.RUNNING):
            break  # a fit that used up its iterations is reweighted once only, since each round takes as long again
        freedom = sizes - Evidence(problem, fit).effective_parameters
        parts = zip(by_record(problem, fit), freedom, strict=True)
        scatter = np.array([problem.residual.loss.scatter(part, float(left)) for part, left in parts])
        noise = np.where(unknown, problem.noise * scatter, problem.noise)
        if number >= _FEWEST and np.allclose(noise, problem.noise, rtol=0.02, atol=0.0):
            break
        report("weighing the records by the noise found")
        problem = problem._replace(noise=noise)
        fit = with_counts_of(run(problem, problem.decode(fit.free), report), [fit])
    return fit, problem


class Budget:
    """Counts the evaluations of all runs, and ends the comparison with other starts.

    Once the effort's evaluations are spent a run takes a single step, so that the best fit so far stands.
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


def best_fit(
    study: Study,
    accuracy: Accuracy,
    run: FitMethod,
    report: Progress,
    loss: AbstractLoss | None = None,
    held_values_explain: Callable[[Fit, Problem], bool] | None = None,
    effort: Effort = USUAL,
) -> tuple[Evidence, dict[str, float]]:
    """The fit from the study's starts; where that is poor, the best from several found from the data.

    As many as the `effort` allows: once its evaluations are spent other starts are no longer fitted.  No other start is
    tried where `held_values_explain` what a poor fit leaves.

    **Returns:** the fit, of a problem with the noise found, as evidence; and the starts it came from.
    """
    starts, missing = guess_starts(study.models, study.parameters, study.records)
    problem = pose(study, starts, accuracy, loss, effort)
    warn_of_memory_use(problem, starts)
    if is_separable(problem):  # few parameters are searched, and there is no contact, which would make wrong optima
        fit, problem = with_noise(run(problem, starts, report), problem, run, report)
        return Evidence(problem, fit, study), starts
    budget = Budget(effort)
    tried, unobserved = budget.counted(run), missing and platform_unobserved(study, problem)
    context = RaceContext(study, problem, [], unobserved, tried, report, held_values_explain, effort)
    if missing:
        context.searched_starts = ranked(study.parameters, starts, context)
        fit = tried(problem, context.searched_starts[0], report, 12)  # continued only if these iterations are promising
        if not fit.success and Evidence(problem, fit).reduced_chi2 < 2.0:
            fit = with_counts_of(tried(problem, problem.decode(fit.free), report), [fit])
        starts = starts_to_report(context.searched_starts[0], starts, context)
    else:
        fit = tried(problem, starts, report)
    raced = reason_at_first(fit, context)
    if raced:
        fit, starts = race(raced, fit, starts, context)
    if effort.compares:
        fit = beyond_discontinuity(fit, problem, tried, report, effort.some(MOST_RESTARTS))
    again = reason_in_the_end(fit, starts, context, bool(raced))
    if again:
        fit, starts = race(again, fit, starts, context)
    if budget.refused and fit.ending == Ending.RUNNING:  # the best of what was begun, brought to its end
        fit = with_counts_of(run(problem, problem.decode(fit.free), report), [fit])
    fit, problem = with_noise(fit, problem, run, report)
    if budget.refused:
        refused = f"; after {budget.spent} evaluations no other start was fitted{effort.advice}"
        fit = fit._replace(message=fit.message + refused)
    return context.evidence(fit) if problem is context.problem else Evidence(problem, fit, study), starts


APART = 1.0
"""Distance by the linear model, in standard deviations of the noise, from which two ends are different optima."""


def check_starts(count: int) -> None:
    """**Raises** `InputError` where so many starts are none."""
    check_whole("starts", count, 0, MOST_STARTS)


def best_of_starts(
    study: Study,
    problem: Problem,
    fit: Fit,
    starts: dict[str, float],
    count: int,
    run: FitMethod,
    executor: Executor | None,
    report: Progress,
) -> tuple[Fit, dict[str, float], Multistart]:
    """The best of the usual `fit` and of `count` others, its starts, and where all of them ended."""
    values = {path: float(number) for path, number in {**starts, **problem.decode(fit.free)}.items()}
    ranges = scatter_ranges(study.models, study.parameters, study.records, values)
    low, high = (np.log([ends[side] for ends in ranges.values()]) for side in (0, 1))
    points = np.exp(low + (high - low) * sobol_points(count, len(ranges), 0))
    others = [values | dict(zip(ranges, map(float, point), strict=True)) for point in points]
    found: dict[int, Fit] = {}
    report(f"fitting from {count} more starts")
    work = functools.partial(_fitted, problem, run, others)
    for number, ended in each_done(work, range(count), executor):
        found[number] = ended
        report(f"more starts: {len(found)} of {count}, lowest chi-square {min(e.chi2 for e in found.values()):.6g}")
    ends = [(fit, starts), *((found[number], others[number]) for number in range(count))]
    total = sum(ended.evaluations for ended, _ in ends)
    best, begun = min(ends, key=lambda ended: ended[0].chi2 if ended[0].success else np.inf)
    if fit.success and (not best.chi2 < fit.chi2 or _is_same_optimum(best, fit, problem)):
        best, begun = fit, starts
    return best._replace(evaluations=total), begun, _table(problem, ends, ranges)


def _fitted(problem: Problem, run: FitMethod, starts: list[dict[str, float]], number: int) -> Fit:
    return run(problem, starts[number], quiet)


def _table(
    problem: Problem, ends: list[tuple[Fit, dict[str, float]]], ranges: dict[str, tuple[float, float]]
) -> Multistart:
    """All ends with their starts, the lowest chi-square first; starts lay in these `ranges`."""
    ordered = sorted(ends, key=lambda ended: ended[0].chi2)
    transform, fits = problem.residual.transform, [fit for fit, _ in ordered]
    return Multistart(
        names=transform.paths,
        chi2=np.array([fit.chi2 for fit in fits]),
        converged=np.array([fit.success for fit in fits]),
        starts=np.array([[begun[path] for path in transform.paths] for _, begun in ordered]),
        ends=transform.in_si(transform.own(np.stack([fit.free for fit in fits]))),
        optimum=np.array(optima(fits, problem)),
        iterations=np.array([fit.iterations for fit in fits]),
        ranges=ranges,
    )


def optima(fits: list[Fit], problem: Problem) -> list[int]:
    """For each of the `fits`, the lowest chi-square first, the number of its optimum; -1 where it did not converge."""
    representatives, numbers = list[Fit](), list[int]()
    for fit in fits:
        equal = [k for k, other in enumerate(representatives) if fit.success and _is_same_optimum(fit, other, problem)]
        numbers.append(equal[0] if equal else len(representatives) if fit.success else -1)
        if fit.success and not equal:
            representatives.append(fit)
    return numbers


def _is_same_optimum(fit: Fit, other: Fit, problem: Problem) -> bool:
    """Whether neither chi-square nor the linear model tells the ends of two fits apart."""
    factor = max(1.0, Evidence(problem, other).reduced_chi2)
    step: Float[np.ndarray, " p"] = np.asarray(fit.free) - np.asarray(other.free)
    distance = float(np.sum((np.asarray(other.state.jacobian) @ step) ** 2))
    return abs(fit.chi2 - other.chi2) < APART**2 * factor and distance < APART**2 * factor
