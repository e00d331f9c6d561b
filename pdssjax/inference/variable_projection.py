"""Variable projection: parameters in which the prediction is linear are solved for, the others searched.

With residuals r(a, x) = r(a, 0) + A(a) x the best x for each a is a linear least-squares problem within
bounds, and what is minimised is ||r(a, x(a))||^2 over a alone.  Of its Jacobian the part in the span
of A is left out (L. Kaufman, BIT 15, 1975, on G. H. Golub and V. Pereyra, SIAM J. Numerical Analysis 10(2),
1973), which leaves Gauss-Newton steps good to first order; columns of x at a bound do not span.

The result is the start of the fit of all parameters, which then only has to confirm the optimum, and
gives the covariance of all parameters.
"""

import itertools
from collections import deque
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
from .solver.iterations import Linearised, Point, Run, begin, iterates
from .solver.levenberg_marquardt import BoundedLevenbergMarquardt

FEWEST_LINEAR = 2
"""Fewest linear parameters that are worth projecting out."""

_DAMPING = 1e-12
"""Damping of the linear parameters, in columns of unit norm: it only leaves out directions without information."""

_FACTORS = (5.0, 2.0)
"""Factors by which positive parameters are tried larger and smaller before any step."""

_MOST = 60
"""Linearisations of a search after that, at most."""

_SOLVER = BoundedLevenbergMarquardt(rtol=1e-12, self_check=False)
"""Unchecked: Kaufman's Jacobian is right along the gradient only."""


class Projected(NamedTuple):
    """The end of a search by variable projection."""

    free: Float[np.ndarray, " p"]
    """All parameters, on the fit's scale."""
    chi2: float
    evaluations: int
    """Linearisations, at most."""


def linear_parameters(problem: Problem, used: Bool[np.ndarray, " records"]) -> Bool[np.ndarray, " p"]:
    """Which free parameters the residuals of the `used` records are jointly linear in, on the fit's scale.

    These are the stack's parameters declared linear, where every record shows the platform alone, friction does not act
    back on it, and squares are minimised; else none.
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
    report: Callable[[str], None] = lambda line: None,
) -> Projected:
    """The least-squares point of all that is `fitted`, the `linear` ones of it projected out, from `free` on.

    **Arguments:** `weights` are 1/noise of the records, 0 of those left out.  A search that cannot begin, since the
    simulation cannot finish at `free`, ends there.
    """
    linear, searched = linear & fitted, fitted & ~linear
    evaluate = eqx.Partial(linearised_residual, problem.residual, weights)
    projected = _ProjectedResidual(evaluate, linear, searched, *problem.bounds)
    here, count = np.clip(free, *problem.bounds), 1
    left, _ = projected.values(here)
    if searched.any() and np.isfinite(_squares(left)):
        report(f"searching {searched.sum()} thresholds and times beside {linear.sum()} linear parameters")
        here, count = _by_factors(projected, here, searched & problem.residual.transform.logarithmic)
        run = Run(_SOLVER, projected, problem.residual.transform.bounds_where(searched, here))
        blank = begin(run, here, left, None)
        here, state = deque(iterates(run, here, blank, _MOST), maxlen=1).pop()
        count += int(state.evaluations) + int(state.iterations)
    here, left = projected.solved(here)
    chi2 = _squares(left)
    return Projected(here, chi2, 2 * count) if np.isfinite(chi2) else Projected(free, np.inf, 2 * count)


class _ProjectedResidual(NamedTuple):
    """The residual that the best linear parameters leave, as a solver evaluates it: `solver.iterations.Evaluations`."""

    at: Callable[[Point], tuple[Float[Array, " n"], Float[Array, "n p"]]]
    linear: Bool[np.ndarray, " p"]
    searched: Bool[np.ndarray, " p"]
    low: Float[np.ndarray, " p"]
    high: Float[np.ndarray, " p"]

    def values(self, point: Point) -> tuple[Float[Array, " n"], None]:
        return self.solved(point)[1], None

    def linearised(self, point: Point) -> Linearised:
        free, _ = self.solved(point)
        residual, jacobian = self.at(free)
        spanning = self.linear & (free > self.low) & (free < self.high)
        return (residual, None), (jnp.where(self.searched, _outside(jacobian, spanning), 0.0), None)

    def solved(self, point: Point) -> tuple[Float[np.ndarray, " p"], Float[Array, " n"]]:
        """A `point` with the best linear parameters in place of its own, and the residual there."""
        free, linear = np.array(point, float), self.linear
        residual, jacobian = self.at(free)
        step = _box_step(jacobian[:, linear], residual, *((end - free)[linear] for end in (self.low, self.high)))
        free[linear] += np.asarray(step)
        return np.clip(free, self.low, self.high), residual + jacobian[:, linear] @ step


def _by_factors(
    projected: _ProjectedResidual, here: Float[np.ndarray, " p"], positive: Bool[np.ndarray, " p"]
) -> tuple[Float[np.ndarray, " p"], int]:
    """The best of points where `positive` parameters differ one by one by large factors: valleys may be several.

    **Returns:** the point, and how many were evaluated.
    """
    least, count = _squares(projected.values(here)[0]), 1
    for factor, place in itertools.product(_FACTORS, np.flatnonzero(positive)):
        step, best = np.log(factor) * (np.arange(here.size) == place), here
        for there in (here - step, here + step):
            there = np.clip(there, projected.low, projected.high)
            left, count = _squares(projected.values(there)[0]), count + 1
            if left < least:
                best, least = there, left
        here = best
    return here, count


@jax.jit
def _box_step(
    columns: Float[Array, "n q"], residual: Float[Array, " n"], low: Float[Array, " q"], high: Float[Array, " q"]
) -> Float[Array, " q"]:
    """The minimum of ||residual + columns x||^2 within the bounds; a column of zeros keeps its x at 0."""
    norms = _norms(columns)
    upper, projected = triangle(columns / norms, residual)
    return solve_in_box(upper, projected, jnp.asarray(_DAMPING), low * norms, high * norms).x / norms


@jax.jit
def _outside(jacobian: Float[Array, "n p"], spanning: Bool[np.ndarray, " p"]) -> Float[Array, "n p"]:
    """`jacobian` without the span of those of its columns that are `spanning`."""
    span = jnp.where(spanning, jacobian, 0.0)
    left, singular, _ = jnp.linalg.svd(span / _norms(span), full_matrices=False)
    basis = jnp.where(singular > _DAMPING * singular[0], left, 0.0)
    return jacobian - basis @ (basis.T @ jacobian)


def _norms(columns: Float[Array, "n q"]) -> Float[Array, " q"]:
    norms = jnp.linalg.norm(columns, axis=0)
    return jnp.where(norms > 0.0, norms, 1.0)


def _squares(residual: Float[Array, " n"]) -> float:
    return float(jnp.sum(residual**2))
