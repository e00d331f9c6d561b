"""Variable projection: parameters in which the prediction is linear are solved for, the others searched.

With residuals r(a, x) = r(a, 0) + A(a) x the best x for each a is a linear least-squares problem within
bounds, and what is minimised is ||r(a, x(a))||^2 over a alone.  Of its Jacobian the part in the span
of A is left out (L. Kaufman, BIT 15, 1975, on G. H. Golub and V. Pereyra, SIAM J. Numerical Analysis 10(2), 1973), which
leaves Gauss-Newton steps good to first order; columns of x at a bound do not span.

It finds where the fit of all parameters begins: that fit then has little to do but to tell that it
is an optimum, and its covariance is that of all parameters.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..study import split_path
from .solver.box_least_squares import solve_in_box, triangle
from .problem import Linearisation, Problem

FEWEST = 2
"""Linear parameters from which on projecting them out is worth it."""

_DAMPING = 1e-12
"""Of the linear parameters, in columns of unit norm: only leaves out what the data do not tell."""

_ENOUGH = 1e-8
"""Decrease of chi-square, relative, at which the search ends."""

_MOST = 30
"""Steps of the search."""

_BEGIN, _LEAST, _LARGEST = 1e-3, 1e-12, 1e6
"""Damping of the steps, in columns of unit norm: at first, at least, and where no step is left."""


class Projected(NamedTuple):
    """Where the search ended."""

    free: Float[np.ndarray, " p"]
    """All parameters, on the fit's scale."""
    chi2: float
    evaluations: int
    """Linearisations."""


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


def project(
    problem: Problem,
    free: Float[np.ndarray, " p"],
    weights: Float[np.ndarray, " records"],
    fitted: Bool[np.ndarray, " p"],
    linear: Bool[np.ndarray, " p"],
) -> Projected:
    """The least-squares point of all that is `fitted`, the `linear` ones of it projected out, from `free` on.

    **Arguments:** `weights` are 1/noise of the records, 0 of those left out.  A search that cannot begin, since
    the simulation cannot finish at `free`, ends there.
    """
    at = Linearisation(problem.residual, weights)
    low, high = problem.bounds
    linear, searched = linear & fitted, fitted & ~linear
    here, evaluations = _solved(at, np.clip(free, low, high), linear, low, high), 2
    damping = _BEGIN
    for _ in range(_MOST if searched.any() else 0):
        if not np.isfinite(here.chi2) or damping > _LARGEST:
            break
        step = np.zeros(here.free.size)
        held = _held(here.free, linear, low, high)
        step[searched] = _gauss_newton(here, searched, linear & ~held, damping, low, high)
        there, evaluations = _solved(at, np.clip(here.free + step, low, high), linear, low, high), evaluations + 2
        if not there.chi2 < here.chi2:
            damping *= 10.0
            continue
        gained, here, damping = here.chi2 - there.chi2, there, max(damping / 10.0, _LEAST)
        if gained < _ENOUGH * here.chi2:
            break
    return Projected(here.free if np.isfinite(here.chi2) else free, here.chi2, evaluations)


def _solved(
    at: Linearisation,
    free: Float[np.ndarray, " p"],
    linear: Bool[np.ndarray, " p"],
    low: Float[np.ndarray, " p"],
    high: Float[np.ndarray, " p"],
) -> _Point:
    """The best linear parameters for the others in `free`, and the linearisation there."""
    residual, jacobian = at(free)
    moved = free.copy()
    moved[linear] += np.asarray(
        _box_step(jacobian[:, linear], residual, low[linear] - free[linear], high[linear] - free[linear])
    )
    moved = np.clip(moved, low, high)
    residual, jacobian = at(moved)
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


def _held(
    free: Float[np.ndarray, " p"],
    linear: Bool[np.ndarray, " p"],
    low: Float[np.ndarray, " p"],
    high: Float[np.ndarray, " p"],
) -> Bool[np.ndarray, " p"]:
    return linear & ((free <= low) | (free >= high))


def _gauss_newton(
    here: _Point,
    searched: Bool[np.ndarray, " p"],
    spanning: Bool[np.ndarray, " p"],
    damping: float,
    low: Float[np.ndarray, " p"],
    high: Float[np.ndarray, " p"],
) -> Float[np.ndarray, " s"]:
    """A damped step of what is `searched`, with the span of the others' columns left out of its Jacobian."""
    columns = _outside(here.jacobian[:, searched], here.jacobian[:, spanning])
    norms = _norms(columns)
    upper, projected = triangle(columns / norms, here.residual)
    ends = ((end[searched] - here.free[searched]) * norms for end in (low, high))
    return np.asarray(solve_in_box(upper, projected, jnp.asarray(damping), *ends).x / norms)


def _outside(columns: Float[Array, "n s"], span: Float[Array, "n q"]) -> Float[Array, "n s"]:
    """`columns` without what lies in the `span` of others."""
    if not span.shape[1]:
        return columns
    left, singular, _ = jnp.linalg.svd(span / _norms(span), full_matrices=False)
    basis = jnp.where(singular > _DAMPING * singular[0], left, 0.0)
    return columns - basis @ (basis.T @ columns)


def _norms(columns: Float[Array, "n q"]) -> Float[Array, " q"]:
    norms = jnp.linalg.norm(columns, axis=0)
    return jnp.where(norms > 0.0, norms, 1.0)
