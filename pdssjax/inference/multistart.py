"""Fits from starts that lead somewhere: found from the data, compared early, left again if need be.

The sum of squares has many local minima.  Slips that come at the wrong moment make large
basins; small discontinuities lie within them, where a parameter decides whether the contact just
reverses or just does not (the law's forces jump there, and the motion after it with them).
So several starts are tried while the fit is poor or has run into a bound, a few iterations each before the
best go on; so they are after a long way, and a fit that ends at a discontinuity is restarted from perturbed points.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from jaxtyping import Float

from ..integration import Accuracy
from ..study import Parameter, Study, Values, repeated_residuals
from .goodness import SIGMAS
from .initial_values.search import guess_starts, rank_starts, scatter_starts
from .least_squares import (
    Fit,
    FitMethod,
    Progress,
    lowered,
    of_platform_alone,
    piezo_alone,
    reduced_chi2,
    shown_by_platform,
    summed,
)
from .perturbed_restarts import MOST_RESTARTS, beyond_discontinuity, restarts
from .problem import Problem, pose
from .successive_halving import successive_halving

_HALVING_ROUNDS = ((10, 5), (4, 7))
"""Successive halving while the fit is poor: how many starts, and the iterations of each; the best go on."""

_COMPARING_ROUNDS = ((32, 6), (12, 12))
"""The same where a fit ran into a bound, or stays poor from the starts given; the others differ in every parameter."""

_FIRST = 12
"""Iterations after which a fit from a start that was searched for must look promising."""

_PROMISING = 2.0
"""Reduced chi-square at that moment."""

_MORE = 3
"""So many times as many are tried where nothing shows the platform alone: then a fit may be good and wrong."""

_POOR = 1.15
"""Reduced chi-square above which a fit is poor, where the noise is only guessed from the samples."""

_LONG = 60
"""Iterations from which the way was long: three of 97 blind random rigs ended in a wrong optimum, all after more."""


def best_fit(
    study: Study, accuracy: Accuracy, run: FitMethod, report: Progress
) -> tuple[Fit, Problem, dict[str, float]]:
    """The fit from the study's starts; where it is poor, the best from several starts found from the data.

    **Returns:** the fit, its problem with the noise found, and the starts it came from.
    """
    starts, missing = guess_starts(study.models, study.parameters, study.records)
    problem = pose(study, starts, accuracy)
    _compile(problem, study, starts)
    ranked = _ranked(study, study.parameters, problem, starts, report) if missing else [starts]
    fit = _first(problem, ranked[0], run, report) if missing else run(problem, starts, report)
    platform_unobserved = missing and _platform_unobserved(study, problem)
    starts = _shown(ranked[0], starts, platform_unobserved)
    raced = platform_unobserved or _is_poor(fit, problem)
    if raced:
        others = ranked[1:] if missing else _ranked(study, _without_starts(study), problem, starts, report)
        fit, begun = _race(fit, problem, starts, others, platform_unobserved, run, report)
        starts = _shown(begun, starts, platform_unobserved)
    fit = beyond_discontinuity(fit, problem, run, report)
    if _may_lie_elsewhere(fit, problem, starts, study, raced):
        fit, starts = _compared_with_others(fit, problem, starts, study, run, report)
    elif fit.iterations > _LONG and not raced and len(ranked) > 1:
        report("that was a long way: comparing with other starts")
        never = lambda fit: False
        fit, begun = successive_halving(fit, problem, starts, ranked[1:], _HALVING_ROUNDS, never, run, report)
        starts = _shown(begun, starts, platform_unobserved)
    fit, problem = _with_noise(fit, problem, run, report)
    return fit, problem, starts


def _race(
    fit: Fit,
    problem: Problem,
    starts: dict[str, float],
    others: Sequence[dict[str, float]],
    platform_unobserved: bool,
    run: FitMethod,
    report: Progress,
) -> tuple[Fit, dict[str, float]]:
    """The best of a poor `fit` and of fits from the `others`, and its starts; it ends where one is good."""
    rounds = [(admitted * (_MORE if platform_unobserved else 1), limit) for admitted, limit in _HALVING_ROUNDS]
    good = lambda fit: not (platform_unobserved or _is_poor(fit, problem))
    return successive_halving(fit, problem, starts, others, rounds, good, run, report)


def _may_lie_elsewhere(fit: Fit, problem: Problem, starts: dict[str, float], study: Study, raced: bool) -> bool:
    """The best optimum may be where the starts given, or a bound, have not let the fit go."""
    if not raced:
        return _at_new_bound(fit, problem, starts)
    given = any(p.free and p.start is not None and not shown_by_platform(path) for path, p in study.parameters.items())
    return given and _is_poor(fit, problem)


def _compile(problem: Problem, study: Study, starts: dict[str, float]) -> None:
    """Compile what fits and predicts side by side: XLA is busy with one while Python traces the next."""
    with ThreadPoolExecutor() as pool:
        pool.submit(lowered(problem, starts).compile)
        pool.submit(study.lowered(starts).compile)


def _platform_unobserved(study: Study, problem: Problem) -> bool:
    """Records depend on the platform, none shows it alone, and the study does not say where its parameters start."""
    piezo = [p for path, p in study.parameters.items() if path.startswith("piezo.") and p.free and p.start is None]
    depends = any(record.measurement.effector_moves for record in problem.records)
    return bool(piezo) and depends and not of_platform_alone(problem.records).any()


def _shown(begun: dict[str, float], earlier: dict[str, float], platform_unobserved: bool) -> dict[str, float]:
    """The starts to report: what the platform shows has those from before its own fit, unless searched for."""
    piezo = {} if platform_unobserved else {path: number for path, number in earlier.items() if shown_by_platform(path)}
    return begun | piezo


def _first(problem: Problem, starts: dict[str, float], run: FitMethod, report: Progress) -> Fit:
    """The fit from the most promising start, broken off where it leads nowhere."""
    first = run(problem, starts, report, _FIRST)
    if first.success or not reduced_chi2(first, problem) < _PROMISING:
        return first
    fit = run(problem, problem.decode(first.free), report)
    return summed(fit, [first])


def _without_starts(study: Study) -> dict[str, Parameter]:
    """The parameters as a search may start them anywhere; the starts of what the platform shows are better."""
    keep = lambda path, parameter: not parameter.free or shown_by_platform(path)
    return {path: p if keep(path, p) else dataclasses.replace(p, start=None) for path, p in study.parameters.items()}


def _ranked(
    study: Study, parameters: Mapping[str, Parameter], problem: Problem, starts: Values, report: Progress
) -> list[dict[str, float]]:
    """Starts from the search, the most promising first, with the piezo from the platform records alone."""
    piezo = piezo_alone(problem, starts, report)
    report("searching for starts")
    return rank_starts(study.models, parameters, study.records, piezo)


def _is_poor(fit: Fit, problem: Problem) -> bool:
    """Residuals are more than noise: in their size, in what repeats every cycle, or in how neighbours are correlated.

    The size shows little where no noise is given, and a slip at a wrong moment hides in it.
    """
    known = all(record.noise is not None for record in problem.records)
    samples = np.size(fit.state.residual)
    small = reduced_chi2(fit, problem) < (1.0 + SIGMAS * np.sqrt(2.0 / samples) if known else _POOR)
    if not small:
        return True
    parts = _by_record(problem, fit)
    correlation = sum(part[1:] @ part[:-1] for part in parts) / max(sum(part @ part for part in parts), 1e-300)
    found = [repeated_residuals(record, part) for record, part in zip(problem.records, parts, strict=True)]
    sigmas = [repeated.sigmas for repeated in found if repeated is not None]
    return bool(correlation > SIGMAS / np.sqrt(samples) or sum(sigmas) > SIGMAS * np.sqrt(len(sigmas)))


def _compared_with_others(
    fit: Fit, problem: Problem, starts: dict[str, float], study: Study, run: FitMethod, report: Progress
) -> tuple[Fit, dict[str, float]]:
    """The best of `fit` and of fits from starts scattered in every parameter, and its starts."""
    report("searching for starts that differ in every parameter")
    platform = of_platform_alone(problem.records).any()
    held = [path for path in problem.residual.transform.paths if platform and shown_by_platform(path)]
    around = starts | {path: float(number) for path, number in problem.decode(fit.free).items() if path in held}
    others = scatter_starts(study.models, study.parameters, study.records, around, held)
    if not others:
        return fit, starts
    best, begun = successive_halving(fit, problem, starts, others, _COMPARING_ROUNDS, lambda fit: False, run, report)
    report("restarting the best from perturbed points")
    return restarts(best, problem, run, 2 * MOST_RESTARTS), begun


def _at_new_bound(fit: Fit, problem: Problem, starts: dict[str, float]) -> bool:
    """The fit ran into a bound that it did not start from: there may be a better optimum elsewhere."""
    low, high = problem.bounds
    begun = problem.encode(starts)
    return bool(np.any(((fit.free <= low) & (begun > low)) | ((fit.free >= high) & (begun < high))))


def _with_noise(fit: Fit, problem: Problem, run: FitMethod, report: Progress) -> tuple[Fit, Problem]:
    """Estimates the noise of the records that do not give it, and fits again with that."""
    unknown = [record.noise is None for record in problem.records]
    for _ in range(2):
        if not any(unknown) or not np.isfinite(fit.chi2):
            break
        report("weighing the records by the noise found")
        problem = problem._replace(noise=np.where(unknown, _noise_left(problem, fit), problem.noise))
        fit = summed(run(problem, problem.decode(fit.free), report), [fit])
    return fit, problem


def _noise_left(problem: Problem, fit: Fit) -> Float[np.ndarray, " records"]:
    """Standard deviation of each record's residuals, in its unit, degrees of freedom shared by samples."""
    sizes = np.array([record.time.size for record in problem.records])
    degrees_taken = fit.free.size * sizes / sizes.sum() + [record.offset is None for record in problem.records]
    squares = np.array([np.sum(part**2) for part in _by_record(problem, fit)])
    return problem.noise * np.sqrt(squares / np.maximum(sizes - degrees_taken, 1.0))


def _by_record(problem: Problem, fit: Fit) -> list[Float[np.ndarray, " samples"]]:
    """The whitened residuals of each record."""
    sizes = [record.time.size for record in problem.records]
    return np.split(np.asarray(fit.state.residual), np.cumsum(sizes)[:-1])
