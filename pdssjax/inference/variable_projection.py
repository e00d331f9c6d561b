"""Variable projection: parameters in which the prediction is linear are solved for, the others searched.

With residuals r(a, x) = r(a, 0) + A(a) x the best x for each a is a linear least-squares problem within
bounds, and what is minimised is ||r(a, x(a))||^2 over a alone.  Of its Jacobian the part in the span
of A is left out (L. Kaufman, BIT 15, 1975, on G. H. Golub and V. Pereyra, SIAM J. Numerical Analysis 10(2),
1973), which leaves Gauss-Newton steps good to first order; columns of x at a bound do not span.

It finds where the fit of all parameters begins: that fit then has little to do but to tell that it
is an optimum, and its covariance is that of all parameters.
"""

import time
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..study import split_path
from .problem import Problem, linearised_residual
from .solver.box_least_squares import solve_in_box, triangle

FEWEST_LINEAR = 2
"""Linear parameters from which on projecting them out is worth it."""

_DAMPING = 1e-12
"""Damping of the linear parameters, in columns of unit norm: only leaves out what the data do not tell."""

_NEAR = 1e-4
"""Decrease of chi-square, relative, at which Gauss-Newton steps give way to quasi-Newton ones."""

_ENOUGH, _ROUNDING = 1e-17, 1e-12
"""Decrease, relative, that the latter still go on for; and below which it is lost in the rounding of chi-square."""

_FACTORS = (5.0, 2.0)
"""Factors by which positive parameters are tried larger and smaller before any step."""

_MOST = 30
"""Steps of either kind."""

_USUAL = 10
"""Steps that a search from nearby takes."""

_DECADE, _BRIEF, _UNSEEN = 10.0, 3, 2.0
"""Factor of the starts to which a search is compared that left an element unused: so many steps from each; and the
standard errors from its bound within which an element is unused."""

_BEGIN, _LEAST, _LARGEST = 1e-3, 1e-12, 1e6
"""Damping of the steps, in columns of unit norm: at first, at least, and where no step is left."""


class Projected(NamedTuple):
    """The end of a search by variable projection."""

    free: Float[np.ndarray, " p"]
    """All parameters, on the fit's scale."""
    chi2: float
    evaluations: int
    """Linearisations, at most."""


class _Point(NamedTuple):
    free: Float[np.ndarray, " p"]
    residual: Float[Array, " n"]
    jacobian: Float[Array, "n p"]
    chi2: float


def linear_parameters(problem: Problem, used: Bool[np.ndarray, " records"]) -> Bool[np.ndarray, " p"]:
    """Which free parameters the `used` records' residuals are linear in, all together, on the fit's scale.

    Those of the stack that say so, where every record shows the platform alone, friction does not act back on
    it, and squares are minimised; else none.
    """
    transform, models = problem.residual.transform, problem.residual.predictor.models
    alone = all(record.measurement.platform_alone for record, use in zip(problem.records, used, strict=True) if use)
    if not alone or models.feedback or problem.residual.loss.is_robust:
        return np.zeros(len(transform.paths), bool)
    declared = models.declared()
    named = [declared.get(split_path(path)[0]) for path in transform.paths]
    return np.array([d is not None and d.linear for d in named]) & ~transform.logarithmic


def is_separable(problem: Problem) -> bool:
    """Whether enough of the parameters are linear for a fit of all records to be one by projection."""
    return int(linear_parameters(problem, np.ones(len(problem.records), bool)).sum()) >= FEWEST_LINEAR


def project(
    problem: Problem,
    free: Float[np.ndarray, " p"],
    weights: Float[np.ndarray, " records"],
    fitted: Bool[np.ndarray, " p"],
    linear: Bool[np.ndarray, " p"],
    report: Callable[[str], None] | None = None,
) -> Projected:
    """The least-squares point of all that is `fitted`, the `linear` ones of it projected out, from `free` on.

    **Arguments:** `weights` are 1/noise of the records, 0 of those left out; `report` is told how long it will take.
    A search that cannot begin, since the simulation cannot finish at `free`, ends there.
    """
    linear, searched = linear & fitted, fitted & ~linear
    logarithmic = problem.residual.transform.logarithmic
    evaluate = eqx.Partial(linearised_residual, problem.residual, weights)
    task = _Task(evaluate, linear, searched, searched & logarithmic, *problem.bounds)
    here = _solved(task, np.clip(free, task.low, task.high))
    count = 1
    if searched.any() and np.isfinite(here.chi2):
        # At the bottom of a valley a search begins where a fit is made again with another noise.
        columns = _columns(task, here, task.searched)
        basis = jnp.linalg.qr(columns / _norms(columns))[0]
        is_near = float(jnp.sum((basis.T @ here.residual) ** 2)) < _NEAR * here.chi2
        local = (_by_gauss_newton, _by_quasi_newton)
        if report is not None:
            begun = time.perf_counter()
            jax.block_until_ready(task.at(here.free))
            each, positive = time.perf_counter() - begun, int(task.positive.sum())
            points = _USUAL if is_near else 2 * len(_FACTORS) * positive + 2 * _USUAL + 2 * (_BRIEF + 1) * positive
            report(
                f"searching {int(task.searched.sum())} thresholds and times beside {int(task.linear.sum())} linear "
                f"parameters, some {2.0 * points * each:.1g} s"
            )
        for search in local if is_near else (_by_factors, *local, _by_decades):
            here, more = search(task, here)
            count += more
    return Projected(here.free if np.isfinite(here.chi2) else free, here.chi2, 2 * count)


class _Task(NamedTuple):
    at: Callable[[Float[np.ndarray, " p"]], tuple[Float[Array, " n"], Float[Array, "n p"]]]
    linear: Bool[np.ndarray, " p"]
    searched: Bool[np.ndarray, " p"]
    positive: Bool[np.ndarray, " p"]
    """Which of those searched are on a logarithmic scale: thresholds, times."""
    low: Float[np.ndarray, " p"]
    high: Float[np.ndarray, " p"]


def _by_factors(task: _Task, here: _Point) -> tuple[_Point, int]:
    """The first stage: try times and thresholds one by one by large factors, since there may be several valleys."""
    count = 0
    for factor in _FACTORS:
        for place in np.flatnonzero(task.positive):
            tried = []
            for way in (-1.0, 1.0):
                step = way * np.log(factor) * (np.arange(here.free.size) == place)
                best = min([here, *tried], key=lambda point: point.chi2)
                tried.append(_solved(task, np.clip(here.free + step, task.low, task.high), best.chi2))
            count += len(tried)
            here = min([here, *tried], key=lambda point: point.chi2)
    return here, count


def _by_decades(task: _Task, here: _Point) -> tuple[_Point, int]:
    """The last stage: where an element is unused, times or thresholds may stand a decade off, in another valley."""
    moves = task.searched | task.linear
    columns = np.asarray(here.jacobian)[:, moves]
    size = np.asarray(_norms(jnp.asarray(columns)))
    scatter = np.sqrt(here.chi2 / max(columns.shape[0] - columns.shape[1], 1))
    spread = np.diag(np.linalg.pinv((columns / size).T @ (columns / size)))
    errors = scatter * np.sqrt(np.maximum(spread, 0.0)) / size  # rounding may leave less than nothing
    room = np.minimum(here.free - task.low, task.high - here.free)[moves]
    # An element is unused where its parameter is at a bound, or not to be told from it.
    if not (room < _UNSEEN * errors)[task.linear[moves]].any():
        return here, 0
    count, rivals = 0, []
    for place in np.flatnonzero(task.positive):
        for way in (-1.0, 1.0):
            step = way * np.log(_DECADE) * (np.arange(here.free.size) == place)
            there = _solved(task, np.clip(here.free + step, task.low, task.high))
            there, taken = _by_gauss_newton(task, there, _BRIEF) if np.isfinite(there.chi2) else (there, 0)
            rivals, count = [*rivals, there], count + 1 + taken
    best = min(rivals, key=lambda point: point.chi2, default=here)
    if not np.isfinite(best.chi2):
        return here, count
    for search in (_by_gauss_newton, _by_quasi_newton):
        best, more = search(task, best)
        count += more
    return (best if best.chi2 < here.chi2 else here), count


def _by_gauss_newton(task: _Task, here: _Point, most: int = _MOST) -> tuple[_Point, int]:
    """Where damped Gauss-Newton steps lead, far from the end, and how many points were solved at."""
    damping, count = _BEGIN, 0
    while count < most and damping <= _LARGEST:
        columns, step = _columns(task, here, task.searched), np.zeros(here.free.size)
        norms = _norms(columns)
        upper, projected = triangle(columns / norms, here.residual)
        ends = (jnp.asarray((end - here.free)[task.searched] * norms) for end in (task.low, task.high))
        step[task.searched] = solve_in_box(upper, projected, jnp.asarray(damping), *ends).x / norms
        there, count = _solved(task, np.clip(here.free + step, task.low, task.high), here.chi2), count + 1
        if not there.chi2 < here.chi2:
            damping *= 10.0
            continue
        gained, here, damping = here.chi2 - there.chi2, there, max(damping / 10.0, _LEAST)
        if gained < _NEAR * here.chi2:
            break
    return here, count


def _by_quasi_newton(task: _Task, here: _Point) -> tuple[_Point, int]:
    """Where BFGS leads, near the end: thresholds bend chi-square more than a linear model of large residuals knows."""
    inside = task.searched & (here.free > task.low) & (here.free < task.high)
    if not inside.any():
        return here, 0
    columns = np.asarray(_columns(task, here, inside))
    scale = np.linalg.norm(columns, axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    curvature = (columns / scale).T @ (columns / scale) + _BEGIN * np.eye(scale.size)
    slope = lambda point: np.asarray(point.jacobian[:, inside].T @ point.residual) / scale
    gradient, count = slope(here), 0
    while count < _MOST:
        way = -np.linalg.solve(curvature, gradient)
        step, predicted = np.zeros(here.free.size), -float(way @ gradient)
        step[inside] = way / scale
        there, count = _solved(task, np.clip(here.free + step, task.low, task.high)), count + 1
        better = there.chi2 < here.chi2
        if np.isfinite(there.chi2):
            moved, slope_there = (there.free - here.free)[inside] * scale, slope(there)
            curvature = _updated_curvature(curvature, moved, slope_there - gradient)
            if predicted < _ROUNDING * here.chi2:
                # Sums of squares no longer tell, but slopes do.
                better = bool(np.linalg.norm(slope_there) < np.linalg.norm(gradient))
            here, gradient = (there, slope_there) if better else (here, gradient)
        else:
            curvature = 10.0 * curvature
        if predicted < _ENOUGH * here.chi2 or (predicted < _ROUNDING * here.chi2 and not better):
            break
    return here, count


def _updated_curvature(
    curvature: Float[np.ndarray, "s s"], moved: Float[np.ndarray, " s"], changed: Float[np.ndarray, " s"]
) -> Float[np.ndarray, "s s"]:
    """The curvature after a step, by the BFGS formula damped after M. J. D. Powell, 1978: it stays positive."""
    bent = curvature @ moved
    expected = float(moved @ bent)
    if expected <= 0.0:
        return curvature
    change = float(moved @ changed)
    share = 1.0 if change >= 0.2 * expected else 0.8 * expected / (expected - change)
    mixed = share * changed + (1.0 - share) * bent
    return curvature - np.outer(bent, bent) / expected + np.outer(mixed, mixed) / float(moved @ mixed)


def _solved(task: _Task, free: Float[np.ndarray, " p"], below: float = np.inf) -> _Point:
    """The best linear parameters for the others in `free`, and the linearisation there.

    It is that with the linear parameters of `free` where chi-square is not `below` what was found before: such a point
    is rejected, and the linear model knows its chi-square.
    """
    linear, moved = task.linear, free.copy()
    residual, jacobian = task.at(free)
    ends = ((end - free)[linear] for end in (task.low, task.high))
    step = _box_step(jacobian[:, linear], residual, *ends)
    moved[linear] += np.asarray(step)
    moved = np.clip(moved, task.low, task.high)
    if not (left := float(jnp.sum((residual + jacobian[:, linear] @ step) ** 2))) < below:
        return _Point(moved, residual, jacobian, left if np.isfinite(left) else np.inf)
    residual, jacobian = task.at(moved)
    chi2 = float(jnp.sum(residual**2))
    return _Point(moved, residual, jacobian, chi2 if np.isfinite(chi2) else np.inf)


@jax.jit
def _box_step(
    columns: Float[Array, "n q"], residual: Float[Array, " n"], low: Float[Array, " q"], high: Float[Array, " q"]
) -> Float[Array, " q"]:
    """The minimum of ||residual + columns x||^2 within the bounds; a column of zeros keeps its x at 0."""
    norms = _norms(columns)
    upper, projected = triangle(columns / norms, residual)
    return solve_in_box(upper, projected, jnp.asarray(_DAMPING), low * norms, high * norms).x / norms


def _columns(task: _Task, here: _Point, searched: Bool[np.ndarray, " p"]) -> Float[Array, "n s"]:
    """Columns of the parameters `searched`, without the span of the linear ones that no bound holds."""
    spanning = (here.free > task.low) & (here.free < task.high)
    return _outside(here.jacobian[:, searched], here.jacobian[:, task.linear], spanning[task.linear])


@jax.jit
def _outside(
    columns: Float[Array, "n s"], others: Float[Array, "n q"], spanning: Bool[np.ndarray, " q"]
) -> Float[Array, "n s"]:
    """`columns` without the span of those of the `others` that are `spanning`; their number compiles nothing anew."""
    span = jnp.where(spanning, others, 0.0)
    left, singular, _ = jnp.linalg.svd(span / _norms(span), full_matrices=False)
    basis = jnp.where(singular > _DAMPING * singular[0], left, 0.0)
    return columns - basis @ (basis.T @ columns)


def _norms(columns: Float[Array, "n q"]) -> Float[Array, " q"]:
    norms = jnp.linalg.norm(columns, axis=0)
    return jnp.where(norms > 0.0, norms, 1.0)
