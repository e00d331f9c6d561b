"""Restarts from points perturbed around where a fit ended: what lies beyond a discontinuity, or in the next valley.

Each is a step of monotonic basin hopping (R. H. Leary, Journal of Global Optimization 18, 2000): a point is kept
only where the fit from it ends lower.
"""

from collections.abc import Callable

import numpy as np

from ..least_squares import Fit, FitMethod, Progress, quiet
from ..problem import Problem
from ..solver.ending import STOPPED, Ending

_DISCONTINUOUS = 2.2
"""Evaluations per iteration above which the residual counts as discontinuous; smooth: 1, after a rejection: 2."""

_DISCONTINUOUS_ENDINGS = (*STOPPED, Ending.DISCONTINUITY, Ending.SMALL_JUMP, Ending.KINK)

MOST_RESTARTS = 4
"""Perturbed restarts in a row that may fail to lower chi-square."""

_LOWER = 0.01
"""By how much chi-square must fall to make it another result."""

_PERTURBATION = 2.0
"""Size of the first perturbation in standard errors; each that fails is followed by one twice as large."""

_SCATTER = 0.01
"""Smallest perturbation that is as large for every parameter, on the fit's scale."""

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

    The first `MOST_RESTARTS` are perturbed along what the records hardly show, further ones as much in every
    parameter.  There are none around where nothing can be simulated.

    **Returns:** the best, once so many in a row as `most` found no better one, with the evaluations of all.
    """
    random = np.random.default_rng(0)
    taken, spent, in_vain = 0, 0, 0
    while np.isfinite(fit.chi2) and needed(fit) and in_vain < most:
        factor, isotropic = 2.0 ** (in_vain % MOST_RESTARTS), in_vain >= MOST_RESTARTS
        step = _isotropic_step(fit, factor, random) if isotropic else _step_of_errors(fit, problem, factor, random)
        rival = run(problem, problem.decode(_perturbed(fit, problem, step)), quiet)
        spent += rival.evaluations
        in_vain = 0 if rival.chi2 < fit.chi2 - 1.0 else in_vain + 1
        if rival.chi2 < fit.chi2 - _LOWER:
            taken, spent = taken + fit.iterations, spent - rival.evaluations + fit.evaluations
            fit = rival
    return fit._replace(iterations=fit.iterations + taken, evaluations=fit.evaluations + spent)


def _is_discontinuous(fit: Fit) -> bool:
    """Many steps were rejected on the way, or the last ones: chi-square is not what its gradient predicts."""
    # Of its last run alone: the evaluations of a fit are also those of all that it was compared with.
    last = fit.state
    return fit.ending in _DISCONTINUOUS_ENDINGS or int(last.evaluations) - 5 > _DISCONTINUOUS * int(last.iterations)


def _isotropic_step(fit: Fit, factor: float, random: np.random.Generator) -> np.ndarray:
    """A random step, as large for every parameter, so that those at bounds leave them."""
    return _SCATTER * factor * random.normal(size=fit.free.size)


def _step_of_errors(fit: Fit, problem: Problem, factor: float, random: np.random.Generator) -> np.ndarray:
    """A random step of some standard errors, in parameters that are not at bounds."""
    moves = ~problem.residual.transform.at_bound(fit.free)
    _, singular, rows = np.linalg.svd(np.where(moves, np.asarray(fit.state.jacobian), 0.0), full_matrices=False)
    errors = 1.0 / np.maximum(singular, 1e-9 * singular[0])
    sizes = np.minimum(_PERTURBATION * factor * errors, _LARGEST_PERTURBATION)
    return (rows.T @ (sizes * random.normal(size=singular.size))) * moves


def _perturbed(fit: Fit, problem: Problem, step: np.ndarray) -> np.ndarray:
    """Where the `fit` ended, and a `step` further, within the bounds; no parameter leaves farther than allowed."""
    step = step / max(1.0, np.max(np.abs(step)) / _LARGEST_PERTURBATION)
    return np.clip(fit.free + step, *problem.bounds)
