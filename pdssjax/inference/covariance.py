"""Covariance of a least-squares estimate, and what the data cannot tell.

With the Jacobian J of the whitened residuals, the covariance is (J' J)^-1.  It is taken from
the singular values of J with columns of unit norm: a direction without information, where
that value vanishes, is left out, and the parameters that take part in it have no error.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

NO_INFORMATION = 1e-8
"""Relative singular value below which a direction of the parameters leaves the residuals alone."""

TAKES_PART = 1e-4
"""Share of a parameter in such a direction, by its effect on the residuals, from which it is undetermined."""


class Covariance(NamedTuple):
    """Covariance of p free numbers, on the fit's scale."""

    matrix: Float[np.ndarray, "p p"]
    """NaN in the rows and columns of parameters without information."""
    identifiable: Bool[np.ndarray, " p"]
    null: list[Float[np.ndarray, " p"]]
    """Directions without information, largest entry 1, 0 for parameters that take no part."""


def least_squares_covariance(jacobian: Float[np.ndarray, "n p"], held: Bool[np.ndarray, " p"]) -> Covariance:
    """Covariance of the least-squares estimate; `held` parameters, at a bound, count as known.

    A column of zeros is a direction without information of its own.
    """
    p = jacobian.shape[1]
    matrix = np.full((p, p), np.nan)
    norms = np.linalg.norm(jacobian, axis=0)
    identifiable = ~held & (norms > 0)
    null = [np.eye(p)[i] for i in np.flatnonzero(~held & (norms == 0))]
    kept = np.flatnonzero(identifiable)
    if kept.size:
        _, singular, rows = np.linalg.svd(jacobian[:, kept] / norms[kept], full_matrices=False)
        undetermined = singular <= NO_INFORMATION * singular[0]
        for row in rows[undetermined]:
            direction = np.zeros(p)
            # Judged on columns of unit norm, so that no parameter's unit matters.
            direction[kept] = np.where(np.abs(row) > TAKES_PART * np.max(np.abs(row)), row, 0.0) / norms[kept]
            null.append(direction / direction[np.argmax(np.abs(direction))])
            identifiable &= direction == 0
        rows = rows / norms[kept]
        inverse = rows[~undetermined] / singular[~undetermined, None]
        matrix[np.ix_(kept, kept)] = inverse.T @ inverse
        set_unknown(matrix, ~identifiable)
    return Covariance(matrix, identifiable, null)


def set_unknown(matrix: Float[np.ndarray, "p p"], unknown: Bool[np.ndarray, " p"]) -> None:
    """Set the rows and columns of `unknown` parameters in a covariance to NaN."""
    matrix[unknown] = np.nan
    matrix[:, unknown] = np.nan


def scaled_least_squares(
    columns: Float[np.ndarray, "n k"], target: Float[np.ndarray, "n *m"], rcond: float | None = None
) -> Float[np.ndarray, "k *m"]:
    """The least-squares solution x of `columns` x = `target`, by columns of unit norm; 0 for a column of zeros."""
    norms = np.linalg.norm(columns, axis=0)
    norms = np.where(norms > 0, norms, 1.0)
    return (np.linalg.lstsq(columns / norms, target, rcond=rcond)[0].T / norms).T


def correlation(matrix: Float[np.ndarray, "p p"]) -> Float[np.ndarray, "p p"]:
    """Correlations from covariances; NaN stays NaN."""
    deviation = np.sqrt(np.diag(matrix))
    with np.errstate(invalid="ignore", divide="ignore"):
        return matrix / np.outer(deviation, deviation)
