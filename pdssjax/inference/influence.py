"""How a least-squares estimate follows the samples, to first order: what every covariance of it is made of.

Where the samples are off by e, the estimate is off by H^-1 J' e.  H = J' J + sum r d2r is the whole second derivative
of half the sum of squares: where the model does not explain the data, its residuals r do not average out, and without
their curvature the errors are wrong (H. White, Econometrica 50(1), 1982).  docs/results.md says by how much.
"""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from .covariance import NO_INFORMATION

LEAST_CURVATURE = 0.1
"""Least curvature of the sum of squares that is believed, as a share of that of J' J; below it the picture is too far
from quadratic for any covariance."""


def influence_of(
    jacobian: Float[np.ndarray, "n p"], curvature: Float[np.ndarray, "p p"] | None = None
) -> Float[np.ndarray, "n p"]:
    """H^-1 J', transposed: the effect of each sample on each parameter, all of them fitted at once.

    **Arguments:** `curvature`, the sum of residuals times their second derivatives; None: none.  A direction without
    information is left out.
    """
    left, spread = _directions(jacobian)
    if curvature is None:
        return left @ spread.T
    return left @ np.linalg.solve(_relative_curvature(spread, curvature), spread.T)


def influence_in_two_steps(
    first: Float[np.ndarray, "n p"],
    second: Float[np.ndarray, "n p"],
    earlier: Int[np.ndarray, " q"],
    later: Int[np.ndarray, " r"],
    curvatures: tuple[Float[np.ndarray, "p p"], Float[np.ndarray, "p p"]] | None = None,
) -> Float[np.ndarray, "n p"]:
    """The effect of each sample on each parameter where those at the places `earlier` are fitted first and then held.

    **Arguments:** the Jacobians of the residuals of the `first` step and of the `second`, each with zeros in the rows
    of the samples that it does not use; `curvatures` of either, as `influence_of` takes them.
    """
    early, late = curvatures or (None, None)
    found = np.zeros(first.shape)
    found[:, earlier] = influence_of(first[:, earlier], None if early is None else early[np.ix_(earlier, earlier)])
    left, spread = _directions(second[:, later])
    inverse = spread.T
    cross = left.T @ second[:, earlier]
    if late is not None:
        # In the directions in which J' J is the identity.
        inverse = np.linalg.solve(_relative_curvature(spread, late[np.ix_(later, later)]), spread.T)
        cross = cross + spread.T @ late[np.ix_(later, earlier)]
    found[:, later] = left @ inverse - found[:, earlier] @ cross.T @ inverse
    return found


def curvature_of(
    jacobian_at: Callable[[Float[np.ndarray, " p"]], Float[np.ndarray, "n p"]],
    free: Float[np.ndarray, " p"],
    residual: Float[np.ndarray, " n"],
    jacobian: Float[np.ndarray, "n p"],
    moved: Bool[np.ndarray, " p"],
    groups: Sequence[slice],
    high: Float[np.ndarray, " p"],
) -> list[Float[np.ndarray, "p p"]]:
    """Sum of residuals times their second derivatives, of each group of samples, by differences of the Jacobian.

    **Arguments:** `jacobian_at`, the Jacobian at a point; `residual` and `jacobian` at the point `free`; which
    parameters are `moved`, each by its error if all others were known; `high`, upper bounds that no step crosses.

    **Returns:** a matrix a group, zero in the columns that are not moved; column j is (J(free + h e_j) - J)' r / h.
    """
    out = [np.zeros((free.size, free.size)) for _ in groups]
    for j in np.flatnonzero(moved):
        step = 1.0 / float(np.linalg.norm(jacobian[:, j]))
        if free[j] + step > high[j]:
            step = -step
        there = jacobian_at(free + step * (np.arange(free.size) == j))
        for matrix, rows in zip(out, groups, strict=True):
            matrix[:, j] = (there[rows] - jacobian[rows]).T @ residual[rows] / step
    return out


def _directions(jacobian: Float[np.ndarray, "n p"]) -> tuple[Float[np.ndarray, "n k"], Float[np.ndarray, "p k"]]:
    """U and L of the Jacobian's pseudo-inverse L U', with U' U = 1 and L L' = (J' J)^-1."""
    norms = np.linalg.norm(jacobian, axis=0)
    norms = np.where(norms > 0, norms, np.inf)
    left, singular, rows = np.linalg.svd(jacobian / norms, full_matrices=False)
    known = singular > NO_INFORMATION * np.max(singular, initial=0.0)
    return left[:, known], (rows[known] / singular[known, None] / norms).T


def _relative_curvature(
    spread: Float[np.ndarray, "p k"], curvature: Float[np.ndarray, "p p"]
) -> Float[np.ndarray, "k k"]:
    """1 + L' S L: H where J' J is the identity, its eigenvalues not below `LEAST_CURVATURE`."""
    relative = spread.T @ (0.5 * (curvature + curvature.T)) @ spread
    values, axes = np.linalg.eigh(relative)
    return axes * np.maximum(1.0 + values, LEAST_CURVATURE) @ axes.T
