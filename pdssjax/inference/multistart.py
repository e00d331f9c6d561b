"""Fits from starts that lead somewhere: found from the data, compared early, left again if need be.

The sum of squares has many local minima.  Slips that come at the wrong moment make large
basins; small discontinuities lie within them, where a parameter decides whether the contact just
reverses or just does not (the law's forces jump there, and the motion after it with them).
So several starts are tried while the fit is poor, a few iterations each before the best go
on, and a fit that ends at a discontinuity is restarted from perturbed points.
"""

import dataclasses
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from ..integration import Accuracy
from ..study import Parameter, Study
from .ending import Ending
from .initial_values.search import guess_starts, rank_starts
from .least_squares import (
    Fit,
    Progress,
    Run,
    lowered,
    of_platform_alone,
    piezo_alone,
    reduced_chi2,
    shown_by_platform,
    summed,
)
from .problem import Problem, pose

_HALVING_ROUNDS = ((10, 5), (4, 7))
"""Successive halving while the fit is poor: how many starts, and the iterations of each; the best go on."""

_FIRST = 12
"""Iterations after which a fit from a start that was searched for must look promising."""

_PROMISING = 2.0
"""Reduced chi-square at that moment."""

_MORE = 3
"""So many times as many are tried where nothing shows the platform alone: then a fit may be good and wrong."""

_PATIENCE = 3
"""Starts in a row that may fail to improve a poor fit: then it is the model that is poor."""

_POOR = 1.15
"""Reduced chi-square above which a fit is poor, where the noise is only guessed from the samples."""

_DISCONTINUOUS = 2.2
"""Evaluations per iteration above which the residual counts as discontinuous; smooth: 1, after a rejection: 2."""

_DISCONTINUOUS_ENDINGS = (Ending.SLOW_STEPS, Ending.STALLED, Ending.REJECTED, Ending.DISCONTINUITY)

_MOST_RESTARTS = 4
"""Perturbed restarts in a row that may fail to lower chi-square."""

_VISIBLE = 0.01
"""By how much chi-square must fall to make it another result."""

_LONG = 60
"""Iterations from which the way was long: then valleys are flat, and other starts may end in better ones.

This and `_OTHERS` were chosen on one record, that of Liu et al. with Coulomb's law; nothing shows that they suit
others, and there, too, small changes of the numerics undid what they had found (550 for 498).
"""

_OTHERS = 4
"""Other starts tried then, each to its end."""

_PERTURBATION = 2.0
"""Size of the first perturbation in standard errors; each that fails is followed by one twice as large."""

_LARGEST_PERTURBATION = 0.3
"""Largest change of one parameter by a perturbation, on the fit's scale."""


def best_fit(study: Study, accuracy: Accuracy, run: Run, report: Progress) -> tuple[Fit, Problem, dict[str, float]]:
    """The fit from the study's starts; where it is poor, the best from several starts found from the data.

    **Returns:** the fit, its problem with the noise found, and the starts it came from.
    """
    starts, missing = guess_starts(study.models, study.parameters, study.records)
    problem = pose(study, starts, accuracy)
    _compile(problem, study, starts)
    ranked = _ranked(study, study.parameters, problem, starts, report) if missing else [starts]
    fit, spent = _first(problem, ranked[0], run, report) if missing else run(problem, starts, report), 0
    platform_unobserved = missing and _platform_unobserved(study, problem)
    starts = _shown(ranked[0], starts, platform_unobserved)
    raced = platform_unobserved or _is_poor(fit, problem)
    if raced:
        free = {path: _without_start(p) for path, p in study.parameters.items()}
        others = ranked[1:] if missing else _ranked(study, free, problem, starts, report)
        fit, starts, spent = _successive_halving(fit, problem, starts, others, run, report, platform_unobserved)
    fit = _perturbed_restarts(fit, problem, run, report)
    if not raced and (fit.iterations > _LONG or _at_new_bound(fit, problem, starts)):
        fit, starts = _compared_with_others(fit, problem, starts, ranked[1 : 1 + _OTHERS], run, report)
    fit, problem = _with_noise(fit._replace(evaluations=fit.evaluations + spent), problem, run, report)
    return fit, problem, starts


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


def _first(problem: Problem, starts: dict[str, float], run: Run, report: Progress) -> Fit:
    """The fit from the most promising start, broken off where it leads nowhere."""
    first = run(problem, starts, report, _FIRST)
    if first.success or not reduced_chi2(first, problem) < _PROMISING:
        return first
    fit = run(problem, problem.residual.transform.decode(first.free), report)
    return summed(fit, [first])


def _without_start(parameter: Parameter) -> Parameter:
    """`parameter` as the search may start it anywhere; the starts of what the platform shows are better."""
    keep = not parameter.free or shown_by_platform(parameter.path)
    return parameter if keep else dataclasses.replace(parameter, start=None)


def _ranked(study, parameters, problem, starts, report) -> list[dict[str, float]]:
    """Starts from the search, the most promising first, with the piezo from the platform records alone."""
    piezo = piezo_alone(problem, starts, report)
    report("searching for starts")
    return rank_starts(study.models, parameters, study.records, piezo)


def _is_poor(fit: Fit, problem: Problem) -> bool:
    """Chi-square is larger than the noise allows: four standard deviations of its own, where that is given."""
    known = all(record.noise is not None for record in problem.records)
    spread = np.sqrt(2.0 / np.size(fit.state.residual))
    return not reduced_chi2(fit, problem) < (1.0 + 4.0 * spread if known else _POOR)


def _successive_halving(
    fit, problem, starts, others, run, report, platform_unobserved
) -> tuple[Fit, dict[str, float], int]:
    """The best of `fit` and of the fits from the `others`, its starts, and the evaluations of all the rest."""
    spent, candidates, late = fit.evaluations, [(other, other, 0) for other in others], [(fit, starts)]
    for admitted, limit in _HALVING_ROUNDS:
        admitted *= _MORE if platform_unobserved else 1
        results = []
        for number, (begun, at, taken) in enumerate(candidates[:admitted], 1):
            report(f"trying others: start {number} of {min(admitted, len(candidates))}, {limit} iterations each")
            rival = run(problem, at, _quiet, limit)
            results.append((rival._replace(iterations=rival.iterations + taken), begun))
        spent += sum(rival.evaluations for rival, _ in results)
        results = sorted(results + late, key=lambda result: result[0].chi2)
        decode = problem.residual.transform.decode
        candidates, late = [(begun, decode(rival.free), rival.iterations) for rival, begun in results], []
    in_vain = 0
    for begun, at, taken in candidates:
        if in_vain == _PATIENCE or not (platform_unobserved or _is_poor(fit, problem)):
            break
        report("going on from the best of the other starts")
        rival = run(problem, at, report)
        spent += rival.evaluations
        in_vain = 0 if rival.chi2 < (1.0 - 1e-3) * fit.chi2 else in_vain + 1
        if rival.chi2 <= (1.0 + 1e-9) * fit.chi2:
            fit, starts = (
                rival._replace(iterations=rival.iterations + taken),
                _shown(begun, starts, platform_unobserved),
            )
    return fit, starts, spent - fit.evaluations


def _perturbed_restarts(fit: Fit, problem: Problem, run: Run, report: Progress) -> Fit:
    """`fit`, or a better one beyond a discontinuity at which it may have ended."""
    random = np.random.default_rng(0)
    taken, spent, in_vain = 0, 0, 0
    while _is_discontinuous(fit) and in_vain < _MOST_RESTARTS:
        report("chi-square is discontinuous here: restarting from perturbed points")
        rival = run(
            problem, problem.residual.transform.decode(_perturbed_point(fit, problem, 2.0**in_vain, random)), _quiet
        )
        spent += rival.evaluations
        in_vain = 0 if rival.chi2 < fit.chi2 - 1.0 else in_vain + 1
        if rival.chi2 < fit.chi2 - _VISIBLE:
            taken, spent = taken + fit.iterations, spent - rival.evaluations + fit.evaluations
            fit = rival
    return fit._replace(iterations=fit.iterations + taken, evaluations=fit.evaluations + spent)


def _compared_with_others(fit, problem, starts, others, run, report) -> tuple[Fit, dict[str, float]]:
    """The best of `fit` and of whole fits from the `others`, and its starts."""
    spent = fit.evaluations
    for number, other in enumerate(others, 1):
        report(f"a long way or a bound: comparing with start {number} of {len(others)}")
        rival = _perturbed_restarts(run(problem, other, _quiet), problem, run, _quiet)
        spent += rival.evaluations
        if rival.chi2 < fit.chi2 - _VISIBLE:
            fit, starts = rival, other
    return fit._replace(evaluations=spent), starts


def _at_new_bound(fit: Fit, problem: Problem, starts: dict[str, float]) -> bool:
    """The fit ran into a bound that it did not start from: there may be a better optimum elsewhere."""
    low, high = problem.bounds
    begun = problem.encode(starts)
    return bool(np.any(((fit.free <= low) & (begun > low)) | ((fit.free >= high) & (begun < high))))


def _is_discontinuous(fit: Fit) -> bool:
    """Many steps were rejected on the way, or the last ones: chi-square is not what its gradient predicts."""
    return fit.ending in _DISCONTINUOUS_ENDINGS or fit.evaluations - 5 > _DISCONTINUOUS * fit.iterations


def _perturbed_point(fit: Fit, problem: Problem, factor: float, random: np.random.Generator) -> np.ndarray:
    """A point some standard errors from where the `fit` ended."""
    bounds, jacobian = problem.residual.transform, np.asarray(fit.state.jacobian)
    held = (fit.free <= bounds.low) | (fit.free >= bounds.high)
    _, singular, rows = np.linalg.svd(np.where(held, 0.0, jacobian), full_matrices=False)
    errors = 1.0 / np.maximum(singular, 1e-9 * singular[0])
    step = rows.T @ (
        np.minimum(_PERTURBATION * factor * errors, _LARGEST_PERTURBATION) * random.normal(size=singular.size)
    )
    step *= ~held / max(1.0, np.max(np.abs(step)) / _LARGEST_PERTURBATION)
    return np.clip(fit.free + step, bounds.low, bounds.high)


def _quiet(message: str) -> None:
    """Reports nothing."""


def _with_noise(fit: Fit, problem: Problem, run: Run, report: Progress) -> tuple[Fit, Problem]:
    """Estimates the noise of the records that do not give it, and fits again with that."""
    unknown = [record.noise is None for record in problem.records]
    for _ in range(2):
        if not any(unknown) or not np.isfinite(fit.chi2):
            break
        report("weighing the records by the noise found")
        problem = problem._replace(noise=np.where(unknown, _noise_left(problem, fit), problem.noise))
        fit = summed(run(problem, problem.residual.transform.decode(fit.free), report), [fit])
    return fit, problem


def _noise_left(problem: Problem, fit: Fit) -> np.ndarray:
    """Standard deviation of each record's residuals, in its unit, degrees of freedom shared by samples."""
    sizes = np.array([record.time.size for record in problem.records])
    parts = np.split(np.asarray(fit.state.residual), np.cumsum(sizes)[:-1])
    degrees_taken = fit.free.size * sizes / sizes.sum() + [record.offset is None for record in problem.records]
    squares = np.array([np.sum(part**2) for part in parts])
    return problem.noise * np.sqrt(squares / np.maximum(sizes - degrees_taken, 1.0))
