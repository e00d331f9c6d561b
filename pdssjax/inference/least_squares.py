"""Fits by least squares: Levenberg-Marquardt runs, one after the other, from given starts."""

from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple, Protocol, TypeAlias

import numpy as np
from jaxtyping import Bool, Float

from ..core import on_device
from ..study import Values
from .effort import Effort
from .problem import Problem
from .residual import as_weights
from .solver.iterations import Run, begin, iterates
from .solver.kink import along_kink, beside_kink
from .solver.levenberg_marquardt import BoundedLevenbergMarquardt
from .solver.lm_state import SUCCESSES, Ending, LMState
from .solver.minimisers import minimised
from .stack_parameters import platform_alone_records, platform_parameters
from .variable_projection import FEWEST_LINEAR, linear_parameters, project

Progress: TypeAlias = Callable[[str], None]
"""A function that is called with a line of text on what is being done."""

Method: TypeAlias = Literal["joint", "sequential", "peaks"]
"""All parameters at once, or the piezo first: by least squares, or from the peaks of step responses."""

MAX_ITERATIONS = 1000
"""Iterations of one run at most, whatever the effort."""

INVISIBLE = 0.01
"""Decrease of chi-square, in units of the reduced chi-square, too small to matter: a tenth of a standard error."""

SMALL_JUMP = 0.1
"""Jump of chi-square, in units of the reduced chi-square, at which a fit may end: a third of a standard error."""

START_FAILED = "the actuator cannot be simulated at the start"

MESSAGES = {
    Ending.CONVERGED: "the gradient is small, and no step would change chi-square visibly",
    Ending.WITHIN_ROUNDING: "as far as the simulation's rounding allows: what the linear model still "
    "predicts is less than a tenth of a standard error",
    Ending.SLOW_STEPS: "slow steps along an ill-conditioned valley, where chi-square hardly falls "
    "although the linear model predicts it: the last {spent} evaluations gained {gained:.2g}{advice}",
    Ending.STALLED: "stalled, the gradient is small but the Jacobian all but singular, and no step "
    "lowers chi-square although the linear model predicts it",
    Ending.REJECTED: "no step lowers chi-square although its gradient is not small",
    Ending.DISCONTINUITY: "chi-square has a discontinuity here, where an event of the contact comes or goes",
    Ending.WRONG_DERIVATIVE: "the Jacobian disagrees with differences of the residual",
    Ending.START_FAILED: START_FAILED,
    Ending.SMALL_JUMP: "but for a jump of chi-square of {jump:.1g} here, where an event of the contact comes or goes: "
    "too small to move any parameter by a third of its standard error",
    Ending.KINK: "chi-square has a kink here, where the residuals change their slope, and may be lower beyond it",
}
"""Messages of the endings; that of a jump has its size, that of slow steps their gain."""

AT_KINK = (
    "on a kink of chi-square, where the residuals change their slope: it is higher on either side, and standard errors "
    "hold for one of the slopes"
)

AT_BOUNDS = "at bounds: the gradient is small for all other parameters"

INTERRUPTED = "interrupted; this is the best point so far, not an optimum"


class FitMethod(Protocol):
    """A way to fit: from a problem and starts to where it ended, after `limit` iterations a phase at most."""

    def __call__(self, problem: Problem, starts: Values, report: Progress, limit: int = ...) -> "Fit": ...


class Fit(NamedTuple):
    """Where a Levenberg-Marquardt run ended."""

    free: Float[np.ndarray, " p"]
    state: LMState
    success: bool
    message: str
    iterations: int
    evaluations: int
    ending: Ending = Ending.RUNNING
    """RUNNING where the iterations were used up."""

    @property
    def chi2(self) -> float:
        value = float(np.sum(np.asarray(self.state.residual) ** 2))
        known = self.iterations and self.ending != Ending.START_FAILED and np.isfinite(value)
        return value if known else np.inf


def by_record(problem: Problem, fit: Fit) -> list[Float[np.ndarray, " samples"]]:
    """The whitened residuals of each record."""
    return [np.asarray(fit.state.residual)[rows] for rows in problem.rows]


def joint(problem: Problem, starts: Values, report: Progress, limit: int = MAX_ITERATIONS) -> Fit:
    """Fit the parameters of the platform to its own records first, then all parameters to all records.

    The first phase is cheap and only brings the piezo near: with it far off, the slips
    come at the wrong moments, and the friction parameters would diverge.
    """
    platform = platform_alone_records(problem.records)
    free = problem.residual.transform.encode(starts)
    piezo, earlier = platform_parameters(problem), list[Fit]()
    effector_moves = any(record.measurement.effector_moves for record in problem.records)
    if platform.any() and effector_moves and piezo.any() and not piezo.all():
        earlier = [fit_phase(problem, free, platform, piezo, "piezo", report, limit)]
        free = earlier[0].free
    return with_counts_of(fit_all(problem, free, report, limit), earlier)


def fit_all(problem: Problem, free: Float[np.ndarray, " p"], report: Progress, limit: int = MAX_ITERATIONS) -> Fit:
    """One run over all parameters and records, from the point `free`."""
    return fit_phase(problem, free, np.ones(len(problem.records), bool), np.ones(free.size, bool), "all", report, limit)


def evaluated(problem: Problem, free: Float[np.ndarray, " p"], report: Progress) -> Fit:
    """Evaluate all records at the point `free` as a fit of nothing."""
    everything = np.ones(len(problem.records), bool)
    return fit_phase(problem, free, everything, np.zeros(free.size, bool), "all", report)


def piezo_alone(problem: Problem, starts: Values, report: Progress) -> dict[str, float]:
    """The free parameters that the platform alone shows, from its records, the others held at their starts."""
    names = problem.residual.transform
    piezo = platform_parameters(problem)
    used = platform_alone_records(problem.records)
    if not (piezo.any() and used.any()):
        return {}
    fit = fit_phase(problem, names.encode(starts), used, piezo, "piezo", report)
    found = names.decode(fit.free)
    return {path: float(found[path]) for path, wanted in zip(names.paths, piezo, strict=True) if wanted}


def with_counts_of(last: Fit, earlier: Sequence[Fit]) -> Fit:
    """`last` with the iterations of the `earlier` phases counted in."""
    return last._replace(
        iterations=last.iterations + sum(fit.iterations for fit in earlier),
        evaluations=last.evaluations + sum(fit.evaluations for fit in earlier),
    )


def quiet(message: str) -> None:
    """Report no progress."""


def fit_phase(
    problem: Problem,
    free: Float[np.ndarray, " p"],
    used: Bool[np.ndarray, " records"],
    fitted: Bool[np.ndarray, " p"],
    name: str,
    report: Progress,
    limit: int = MAX_ITERATIONS,
) -> Fit:
    """One Levenberg-Marquardt run over the `fitted` parameters and the `used` records.

    It begins where variable projection ends, if the records are linear in some of the parameters.
    """
    linear, evaluations = linear_parameters(problem, used) & fitted, 0
    if linear.sum() >= FEWEST_LINEAR:
        tell: Progress = lambda line: report(f"{name}: {line}")
        found = project(problem, free, as_weights(problem.noise, used), fitted, linear, tell)
        free, evaluations = found.free, found.evaluations
        report(f"{name}: {linear.sum()} linear parameters projected out, chi-square {found.chi2:.6g}")
    limit = min(limit, MAX_ITERATIONS, problem.effort.iterations)
    steps, minimiser_ended = 0, ""
    if problem.minimiser is not None and fitted.any():
        options, weights = problem.residual.transform.bounds_where(fitted, free), as_weights(problem.noise, used)
        free, steps, minimiser_ended = minimised(problem.minimiser, problem.residual, free, weights, options, limit)
        # The package's own solver takes no further step, and only tests the point.
        evaluations, limit = evaluations + steps, 0
    run, start, blank = _start_run(problem, free, used, fitted)
    y, state, history = start, blank, list[tuple[int, float]]()
    for y, state in iterates(run, start, blank, limit):
        chi2 = float(np.sum(np.asarray(state.residual) ** 2))
        if bool(state.accepted):
            history.append((int(state.evaluations), chi2))
        if problem.watch is not None:
            counts = _iterations(state), int(state.evaluations) + evaluations
            problem.watch(problem, used, Fit(np.asarray(y), state, False, INTERRUPTED, *counts))
        report(f"{name}: iteration {int(state.iterations)}, chi-square {chi2:.6g}")
    predicted = np.inf
    y, state = beside_kink(run, y, state)
    if int(state.ending) == Ending.KINK:
        y, state, predicted = along_kink(run, y, state)
    ending = Ending(int(state.ending))
    message, success = _message(run, np.asarray(y), state, fitted, limit, predicted)
    if ending == Ending.SLOW_STEPS:
        message = _slow_message(problem.effort, history)
    if minimiser_ended and ending == Ending.RUNNING:
        message = f"{minimiser_ended} where the gradient is not small"
    counts = _iterations(state) + steps, int(state.evaluations) + evaluations
    return Fit(np.asarray(y), state, success, message, *counts, ending)


def _iterations(state: LMState) -> int:
    """Iterations of a run; 1 for one that only evaluated its start."""
    return max(int(state.iterations), 1 - int(state.unevaluated))


def _message(
    run: Run,
    free: Float[np.ndarray, " p"],
    state: LMState,
    fitted: Bool[np.ndarray, " p"],
    limit: int,
    predicted: float,
) -> tuple[str, bool]:
    """How a run ended, in words, and whether that is a success.

    **Arguments:** `predicted` is the decrease of chi-square that the slopes on both sides of a kink still predict.
    """
    ending, chi2 = Ending(int(state.ending)), float(np.sum(np.asarray(state.residual) ** 2))
    if ending == Ending.RUNNING:
        return f"no convergence within {limit} iterations", False
    if ending == Ending.KINK and predicted <= float(run.solver.small_jump) * chi2:
        return AT_KINK, True
    low, high = (np.asarray(run.bounds[end]) for end in ("lower", "upper"))
    if ending == Ending.CONVERGED and (fitted & ((free <= low) | (free >= high))).any():
        return AT_BOUNDS, True
    message = MESSAGES[ending]
    return message.format(jump=float(state.jump)) if ending == Ending.SMALL_JUMP else message, ending in SUCCESSES


def _slow_message(effort: Effort, history: Sequence[tuple[int, float]]) -> str:
    """The message of a run that ended in slow steps.

    **Arguments:** the `history` of the run: evaluations and chi-square after each accepted step.
    """
    (before, higher), (after, lower) = history[-min(effort.slow_steps + 1, len(history))], history[-1]
    return MESSAGES[Ending.SLOW_STEPS].format(spent=after - before, gained=higher - lower, advice=effort.advice)


def _start_run(
    problem: Problem, free: Float[np.ndarray, " p"], used: Bool[np.ndarray, " records"], fitted: Bool[np.ndarray, " p"]
) -> tuple[Run, Float[np.ndarray, " p"], LMState]:
    """The run over the `fitted` parameters and the `used` records, the point where it starts, and its state there."""
    bounds = problem.residual.transform.bounds_where(fitted, free)
    weights = as_weights(problem.noise, used)
    samples = sum(record.time.size for record, use in zip(problem.records, used, strict=True) if use)
    # A step that lowers chi-square by 1e-4 is a hundredth of a standard error.
    visible: float = np.float64(1.0 / samples)  # an array: a new Python float would compile anew
    solver = BoundedLevenbergMarquardt(
        rtol=1e-4 * visible,
        atol=1e-4,
        slow=problem.effort.slow_gain * visible,
        invisible=INVISIBLE * visible,
        small_jump=SMALL_JUMP * visible,
        most_slow_steps=problem.effort.slow_steps,
    )
    y = np.clip(np.asarray(free, float), bounds["lower"], bounds["upper"])
    run = Run(on_device(solver), problem.evaluations(on_device(weights)), on_device(bounds))
    return run, y, begin(run, y, np.zeros(problem.residual.size), weights)
