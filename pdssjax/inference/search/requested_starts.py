"""Fits from as many starts as a user asks for: how many optima there are, and whether the best was found.

The starts are Sobol points over the ranges that a search would use, on logarithmic scales.  Two fits have ended in
the same optimum where neither chi-square nor the linear model tells their ends apart.
"""

import functools
from collections.abc import Mapping
from concurrent.futures import Executor
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ...core import MOST_STARTS, check_whole, sobol_points
from ...study import Multistart, Study
from ..draws import each_done
from ..fit_statistics import reduced_chi2
from ..initial_values.search import scatter_ranges
from ..least_squares import Fit, FitMethod, Progress, quiet
from ..problem import Problem

APART = 1.0
"""Distance by the linear model, in standard deviations of the noise, from which two ends are different optima."""


class Ended(NamedTuple):
    """One fit."""

    begun: dict[str, float]
    fit: Fit


def check_starts(count: int) -> None:
    """**Raises** `InputError` where so many starts are none."""
    check_whole("starts", count, 0, MOST_STARTS)


def spread_starts(study: Study, around: Mapping[str, float], count: int, seed: int = 0) -> list[dict[str, float]]:
    """`count` starts for every listed parameter [SI]; `around` gives what has no range of its own."""
    ranges = scatter_ranges(study.models, study.parameters, study.records, around)
    low, high = (np.log([ends[side] for ends in ranges.values()]) for side in (0, 1))
    points = low + (high - low) * sobol_points(count, len(ranges), seed)
    return [dict(around) | dict(zip(ranges, map(float, np.exp(point)), strict=True)) for point in points]


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
    others = spread_starts(study, values, count)
    found: dict[int, Ended] = {}
    report(f"fitting from {count} more starts")
    work = functools.partial(_fitted, problem, run, others)
    for number, ended in each_done(work, range(count), executor):
        found[number] = Ended(others[number], ended)
        report(f"more starts: {len(found)} of {count}, lowest chi-square {min(e.fit.chi2 for e in found.values()):.6g}")
    everyone = [Ended(starts, fit), *(found[number] for number in range(count))]
    total = sum(ended.fit.evaluations for ended in everyone)
    best = min(everyone, key=lambda ended: ended.fit.chi2 if ended.fit.success else np.inf)
    if fit.success and (not best.fit.chi2 < fit.chi2 or _same(best.fit, fit, problem)):
        best = everyone[0]
    return best.fit._replace(evaluations=total), best.begun, _table(problem, everyone, study, values)


def _fitted(problem: Problem, run: FitMethod, starts: list[dict[str, float]], number: int) -> Fit:
    return run(problem, starts[number], quiet)


def _table(problem: Problem, everyone: list[Ended], study: Study, around: Mapping[str, float]) -> Multistart:
    """All ends, the lowest chi-square first."""
    ordered = sorted(everyone, key=lambda ended: ended.fit.chi2)
    transform = problem.residual.transform
    fits = [ended.fit for ended in ordered]
    return Multistart(
        names=transform.paths,
        chi2=np.array([fit.chi2 for fit in fits]),
        converged=np.array([fit.success for fit in fits]),
        starts=np.array([[ended.begun[path] for path in transform.paths] for ended in ordered]),
        ends=transform.in_si(np.stack([fit.free for fit in fits])),
        optimum=np.array(optima(fits, problem)),
        iterations=np.array([fit.iterations for fit in fits]),
        ranges=scatter_ranges(study.models, study.parameters, study.records, around),
    )


def optima(fits: list[Fit], problem: Problem) -> list[int]:
    """For each of the `fits`, the lowest chi-square first, the number of its optimum; -1 where it did not converge."""
    representatives: list[Fit] = []
    numbers = []
    for fit in fits:
        number = -1
        if fit.success:
            equal = [k for k, other in enumerate(representatives) if _same(fit, other, problem)]
            number = equal[0] if equal else len(representatives)
            if not equal:
                representatives.append(fit)
        numbers.append(number)
    return numbers


def _same(fit: Fit, other: Fit, problem: Problem) -> bool:
    """Neither chi-square nor the linear model tells the ends of two fits apart."""
    factor = max(1.0, reduced_chi2(other, problem))
    step: Float[np.ndarray, " p"] = np.asarray(fit.free) - np.asarray(other.free)
    apart = float(np.sum((np.asarray(other.state.jacobian) @ step) ** 2))
    return abs(fit.chi2 - other.chi2) < APART**2 * factor and apart < APART**2 * factor
