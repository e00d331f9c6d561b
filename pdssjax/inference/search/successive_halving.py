"""Successive halving: many starts fitted for a few iterations, of which the best go on.

K. Jamieson and A. Talwalkar, Non-stochastic best arm identification and hyperparameter optimization, AISTATS 2016.
"""

from collections.abc import Callable, Sequence

from ..least_squares import Fit, FitMethod, Progress, quiet
from ..problem import Problem
from ..solver.ending import Ending

PATIENCE = 3
"""Starts in a row that may fail to improve a poor fit: then it is the model that is poor."""


def successive_halving(
    fit: Fit,
    problem: Problem,
    starts: dict[str, float],
    others: Sequence[dict[str, float]],
    rounds: Sequence[tuple[int, int]],
    good: Callable[[Fit], bool],
    run: FitMethod,
    report: Progress,
) -> tuple[Fit, dict[str, float]]:
    """The best of `fit` and of the fits from the `others`, with the evaluations of all, and its starts."""
    total, candidates = fit.evaluations, [(other, other, 0) for other in others]
    late = [(fit, starts)] if fit.ending == Ending.RUNNING else []
    for admitted, limit in rounds:
        results = []
        for number, (begun, at, taken) in enumerate(candidates[:admitted], 1):
            report(f"trying others: start {number} of {min(admitted, len(candidates))}, {limit} iterations each")
            rival = run(problem, at, quiet, limit)
            results.append((rival._replace(iterations=rival.iterations + taken), begun))
        total += sum(rival.evaluations for rival, _ in results)
        results = sorted(results + late, key=lambda result: result[0].chi2)
        candidates, late = [(begun, problem.decode(rival.free), rival.iterations) for rival, begun in results], []
    in_vain = 0
    for begun, at, taken in candidates:
        if in_vain == PATIENCE or good(fit):
            break
        report("going on from the best of the other starts")
        rival = run(problem, at, report)
        total += rival.evaluations
        in_vain = 0 if rival.chi2 < (1.0 - 1e-3) * fit.chi2 else in_vain + 1
        if rival.chi2 <= (1.0 + 1e-9) * fit.chi2:
            fit, starts = rival._replace(iterations=rival.iterations + taken), begun
    return fit._replace(evaluations=total), starts
