"""Fits by least squares: one Levenberg-Marquardt run after the other, from starts that lead somewhere."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from .integration import Accuracy
from .levenberg_marquardt import BoundedLevenbergMarquardt, LMState
from .parameters import Scale, scale
from .records import Record
from .residual import Residual, as_weights, noise_floor
from .starts import find_starts
from .study import Study

Progress = Callable[[str], None]

MAX_ITERATIONS = 100
_STARTS = 6
"""Starts tried at most while the fit is poor."""
_PATIENCE = 2
"""Starts in a row that may fail to improve a poor fit: then it is the model that is poor."""
_POOR = 2.0
"""Reduced chi-square above which a fit is poor, where the noise is only guessed from the samples."""


class Problem(NamedTuple):
    """What a fit needs, made once for all its steps."""

    residual: Residual
    records: tuple[Record, ...]
    """The records fitted."""
    noise: np.ndarray
    """Standard deviation of each [m]."""


Run = Callable[[Problem, dict[str, Any], Progress], "Fit"]
"""A way to fit: from a problem and starts to where it ended."""


class Fit(NamedTuple):
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


def pose(study: Study, starts: dict[str, float], accuracy: Accuracy) -> Problem:
    """The fit of a study's records with role "fit", parameters scaled after their `starts`."""
    records = tuple(record for record in study.records if record.role == "fit")
    fixed = {path: starts[path] for path, parameter in study.parameters.items() if not parameter.free}
    residual = Residual(study.models, records, scale(study.parameters, starts), fixed, accuracy)
    noise = np.array([noise_floor(r) if r.noise is None else r.noise for r in records])
    return Problem(residual, records, noise)


def best_fit(
    study: Study, problem: Problem, starts: dict[str, float], run: Run, report: Progress
) -> tuple[Fit, Problem, dict[str, float]]:
    """The fit from `starts`; where it is poor, the best of several starts found from the data.

    **Returns:** the fit, its problem with the noise found, and the starts it came from.
    """
    fit = run(problem, starts, report)
    anywhere = {
        path: p if p.value is not None or path.startswith("piezo.") else dataclasses.replace(p, start=None)
        for path, p in study.parameters.items()
    }
    spent, in_vain = fit.evaluations, 0
    for rank in range(1, _STARTS):
        if in_vain == _PATIENCE or not _is_poor(fit, problem):
            break
        report(f"the fit is poor: trying start {rank + 1} of {_STARTS}")
        other = find_starts(study.models, anywhere, study.records, rank - 1)
        rival = run(problem, other, report)
        spent += rival.evaluations
        in_vain = 0 if rival.chi2 < (1.0 - 1e-3) * fit.chi2 else in_vain + 1
        if rival.chi2 < fit.chi2:
            fit, starts = rival, other
    fit, problem = _with_noise(fit._replace(evaluations=spent), problem, run, report)
    return fit, problem, starts


def _is_poor(fit: Fit, problem: Problem) -> bool:
    """Chi-square is larger than the noise allows: four standard deviations of its own, where that is given."""
    known = all(record.noise is not None for record in problem.records)
    spread = np.sqrt(2.0 / np.size(fit.state.residual))
    return not fit.success or reduced_chi2(fit, problem) > (1.0 + 4.0 * spread if known else _POOR)


def _with_noise(fit: Fit, problem: Problem, run: Run, report: Progress) -> tuple[Fit, Problem]:
    """Estimates the noise of the records that do not give it, and fits again with that."""
    unknown = [record.noise is None for record in problem.records]
    for _ in range(2):
        if not any(unknown) or not np.isfinite(fit.chi2):
            break
        report("weighing the records by the noise found")
        problem = problem._replace(noise=np.where(unknown, _noise_left(problem, fit), problem.noise))
        fit = run(problem, problem.residual.scale.decode(fit.free), report)
    return fit, problem


def _noise_left(problem: Problem, fit: Fit) -> np.ndarray:
    """Standard deviation of each record's residuals [m], degrees of freedom shared by samples."""
    sizes = np.array([record.time.size for record in problem.records])
    parts = np.split(np.asarray(fit.state.residual), np.cumsum(sizes)[:-1])
    lost = fit.free.size * sizes / sizes.sum() + [record.offset is None for record in problem.records]
    squares = np.array([np.sum(part**2) for part in parts])
    return problem.noise * np.sqrt(squares / np.maximum(sizes - lost, 1.0))


def reduced_chi2(fit: Fit, problem: Problem) -> float:
    """Chi-square per degree of freedom, the free offsets counted."""
    offsets = sum(record.offset is None for record in problem.records)
    return fit.chi2 / max(np.size(fit.state.residual) - fit.free.size - offsets, 1)


def joint(problem: Problem, starts: dict[str, Any], report: Progress) -> Fit:
    """The piezo's parameters first, from the platform records, then everything from everything.

    The first stage is cheap and only brings the piezo near: with it far off, the slips
    come at the wrong moments, and the friction parameters would go astray.
    """
    measures = np.array([record.measures for record in problem.records])
    free = problem.residual.scale.encode(starts)
    piezo = of_piezo(problem.residual.scale)
    spent = []
    if (measures == "platform").any() and (measures == "effector").any() and piezo.any() and not piezo.all():
        first = _least_squares(problem, free, measures == "platform", piezo, "piezo", report)
        free, spent = first.free, [first]
    last = _least_squares(problem, free, np.ones(len(measures), bool), np.ones(free.size, bool), "all", report)
    return _summed(last, spent)


def sequential(problem: Problem, starts: dict[str, Any], report: Progress) -> Fit:
    """The piezo from the platform records; then, with the piezo held, the others from the rest."""
    measures = np.array([record.measures for record in problem.records])
    free = problem.residual.scale.encode(starts)
    piezo = of_piezo(problem.residual.scale)
    first = _least_squares(problem, free, measures == "platform", piezo, "piezo", report)
    second = _least_squares(problem, first.free, measures == "effector", ~piezo, "friction", report)
    # Both steps' residuals, for the statistics and the errors.
    whole = _least_squares(problem, second.free, np.ones(len(measures), bool), piezo & ~piezo, "all", report)
    whole = whole._replace(success=first.success and second.success, message=second.message)
    return _summed(whole, [first, second])


def of_piezo(scale: Scale) -> np.ndarray:
    """Which free parameters belong to the piezo, shape (parameters,)."""
    return np.array([path.startswith("piezo.") for path in scale.paths])


def _summed(last: Fit, earlier: Sequence[Fit]) -> Fit:
    """`last` with the iterations of the `earlier` stages counted in."""
    return last._replace(
        iterations=last.iterations + sum(fit.iterations for fit in earlier),
        evaluations=last.evaluations + sum(fit.evaluations for fit in earlier),
    )


def _least_squares(problem, free, used, loose, name, report) -> Fit:
    """One Levenberg-Marquardt run over the `loose` parameters and the `used` records."""
    bounds = problem.residual.scale
    low, high = (np.where(loose, end, free) for end in (bounds.low, bounds.high))
    options = {"lower": jnp.asarray(low), "upper": jnp.asarray(high)}
    weights = as_weights(problem.noise, used)
    samples = sum(record.time.size for record, use in zip(problem.records, used, strict=True) if use)
    # A step that lowers chi-square by 1e-4 is a hundredth of a standard error, one by 0.05 a quarter.
    visible: Any = jnp.asarray(1.0 / samples)  # an array: a new Python float would compile anew
    solver = BoundedLevenbergMarquardt(rtol=1e-4 * visible, crawl=0.05 * visible)
    y = jnp.clip(jnp.asarray(free, float), options["lower"], options["upper"])
    state, over, evaluations = _begin(solver, problem.residual, y, weights, options), False, 0
    result = optx.RESULTS.nonlinear_max_steps_reached
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
    return Fit(np.asarray(y), state, success, message, iterations, evaluations)


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
