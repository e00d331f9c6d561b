"""Covariance of a least-squares estimate, and what the data cannot tell.

With the Jacobian J of the whitened residuals, the covariance is (J' J)^-1.  It is taken from
the singular values of J with columns of unit norm: a direction without information, where
that value vanishes, is left out, and the parameters that take part in it have no error.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

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
        matrix[~identifiable] = np.nan
        matrix[:, ~identifiable] = np.nan
    return Covariance(matrix, identifiable, null)


def correlation(matrix: Float[np.ndarray, "p p"]) -> Float[np.ndarray, "p p"]:
    """Correlations from covariances; NaN stays NaN."""
    deviation = np.sqrt(np.diag(matrix))
    with np.errstate(invalid="ignore", divide="ignore"):
        return matrix / np.outer(deviation, deviation)


def estimate_sensitivity(
    later: Float[np.ndarray, "n l"], earlier: Float[np.ndarray, "n e"]
) -> Float[np.ndarray, "l e"]:
    """Derivative of the least-squares estimate of the parameters fitted `later` by those fitted `earlier`.

    With residuals r(a, b) and a held, the estimate of b is where J_b' r = 0, so that an error da moves it by
    -(J_b' J_b)^-1 J_b' J_a da, to first order (K. M. Murphy and R. H. Topel, Journal of Business and Economic
    Statistics 3(4), 1985).

    **Arguments:** the columns of the residuals' Jacobian in the parameters fitted `later`, which determine them
    all, and in those fitted `earlier`.
    """
    norms = np.linalg.norm(later, axis=0)
    norms = np.where(norms > 0, norms, 1.0)
    return -np.linalg.lstsq(later / norms, earlier, rcond=None)[0] / norms[:, None]


def propagated(
    jacobian: Float[np.ndarray, "n p"],
    first: Float[np.ndarray, "q q"],
    later: Int[np.ndarray, " r"],
    earlier: Int[np.ndarray, " q"],
) -> tuple[Float[np.ndarray, "p p"], Float[np.ndarray, "p p"]]:
    """Covariance of a fit in two steps: naive, and with the first step's errors carried on.

    **Arguments:** `jacobian` of the second step's residuals in all parameters; `first`, the
    covariance of the parameters at the places `earlier`, fitted before and then held, while
    those at the places `later` were fitted.  An error e of the first moves the second by
    -(J2' J2)^-1 J2' J1 e (first order).
    """
    naive = least_squares_covariance(jacobian[:, later], np.zeros(later.size, bool)).matrix
    shift = estimate_sensitivity(jacobian[:, later], jacobian[:, earlier])
    p = jacobian.shape[1]
    plain, whole = np.zeros((p, p)), np.zeros((p, p))
    for matrix, block in ((plain, naive), (whole, naive + shift @ first @ shift.T)):
        matrix[np.ix_(earlier, earlier)] = first
        matrix[np.ix_(later, later)] = block
    whole[np.ix_(later, earlier)] = shift @ first
    whole[np.ix_(earlier, later)] = (shift @ first).T
    return plain, whole
