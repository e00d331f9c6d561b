"""The fit without its outliers, the samples that stand out of its residuals, to first order.

Least squares is pulled by glitches: twelve of 100 standard deviations among 1000 samples move the prediction of all
others by as much as noise.  So the others are not judged by what the fit leaves of them, but by what the optimum of
them alone would, to first order.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ..metrics import outliers
from ..study import cycles_a_second
from .covariance import NO_INFORMATION
from .least_squares import Fit, evaluated, quiet
from .problem import Problem

_ROUNDS = 5
"""Rounds of looking for samples that stand out: what pulls the fit off hides smaller ones."""


class WithoutOutliers(NamedTuple):
    """A fit without the samples that stand out, of n residuals and p parameters."""

    outlying: Bool[np.ndarray, " n"]
    """Which samples stand out."""
    residual: Float[np.ndarray, " n"]
    """Whitened, as the loss counts them; NaN where a sample stands out."""
    step: Float[np.ndarray, " p"]
    """How far the fit would end elsewhere, on its scale; 0 under a robust loss, which outliers hardly pull."""


def without_outliers(problem: Problem, fit: Fit) -> WithoutOutliers:
    """Estimate the `fit` without the samples that stand out; the fit itself where none does."""
    residual = np.asarray(fit.state.residual)
    out, step = _outlying(problem, residual), np.zeros(fit.free.size)
    if not out.any() or problem.residual.loss.is_robust:
        return WithoutOutliers(out, np.where(out, np.nan, residual), step)
    columns = _columns(problem, fit)
    # The difference of two steps: that with all samples is 0 only where the fit ended in an optimum.
    whole, rest = _step(columns, residual, np.ones(out.size, bool)), residual
    for _ in range(_ROUNDS):
        turn = _step(columns, residual, ~out) - whole
        rest, step = residual + columns @ turn, turn[: step.size]
        more = _outlying(problem, rest) | out
        if np.array_equal(more, out):
            break
        out = more
    return WithoutOutliers(out, np.where(out, np.nan, rest), step)


def undisturbed_point(problem: Problem, fit: Fit) -> Float[np.ndarray, " p"]:
    """Where the `fit` would end without the samples that stand out, on its scale; where it ended if none does.

    The step there is that of the linear model.  Where it leaves more of the other samples than the fit does the model
    is not linear so far, and the fit's end it is.
    """
    found = without_outliers(problem, fit)
    if not found.step.any():
        return fit.free
    there = np.clip(fit.free + found.step, *problem.bounds)
    moved = np.asarray(evaluated(problem, there, quiet).state.residual)
    is_nearer = _left(problem, moved, ~found.outlying) < _left(problem, np.asarray(fit.state.residual), ~found.outlying)
    return there if is_nearer else fit.free


def _left(problem: Problem, residual: Float[np.ndarray, " n"], counted: Bool[np.ndarray, " n"]) -> float:
    """The sum of squares of the samples `counted`, free zeros of records theirs."""
    total = 0.0
    for record, rows in zip(problem.records, problem.rows, strict=True):
        left = residual[rows][counted[rows]]
        zero = np.mean(left) if record.offset is None and left.size else 0.0
        total += float(np.sum((left - zero) ** 2))
    return total


def _outlying(problem: Problem, roots: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Which residuals, as the loss counts them, belong to samples that stand out (`metrics.outliers`)."""
    residual, out = np.asarray(problem.residual.loss.original(jnp.asarray(roots))), np.zeros(roots.size, bool)
    for record, rows, noise in zip(problem.records, problem.rows, problem.noise, strict=True):
        predicted = record.measured - noise * residual[rows]
        out[rows][outliers(record.measured, predicted, record.time, cycles_a_second(record))] = True
    return out


def _columns(problem: Problem, fit: Fit) -> Float[np.ndarray, "n q"]:
    """The Jacobian of what the fit is free to change: p columns, 0 of parameters at bounds, and the free zeros'."""
    jacobian = np.asarray(fit.state.jacobian) * ~problem.residual.transform.at_bound(fit.free)
    zeros = [rows for record, rows in zip(problem.records, problem.rows, strict=True) if record.offset is None]
    ones = np.zeros((jacobian.shape[0], len(zeros)))
    for i, rows in enumerate(zeros):
        ones[rows, i] = 1.0
    return np.column_stack([jacobian, ones])


def _step(
    columns: Float[np.ndarray, "n q"], residual: Float[np.ndarray, " n"], used: Bool[np.ndarray, " n"]
) -> Float[np.ndarray, " q"]:
    """The step that leaves the least of the `residual`, by the rows that are `used`."""
    size = np.linalg.norm(columns, axis=0)
    size = np.where(size > 0, size, 1.0)
    return -np.linalg.lstsq((columns / size)[used], residual[used], rcond=NO_INFORMATION)[0] / size
