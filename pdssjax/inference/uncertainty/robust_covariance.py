"""Covariance of an estimate under a robust loss: the sandwich of its score and its curvature."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ..covariance import Covariance, least_squares_covariance
from ..losses.base import AbstractLoss


def robust_covariance(
    root: Float[np.ndarray, " n"], jacobian: Float[np.ndarray, "n p"], held: Bool[np.ndarray, " p"], loss: AbstractLoss
) -> Covariance:
    """B^-1 M B^-1 with B = J' diag(rho''/2) J and M = J' diag(rho'/2)^2 J (P. J. Huber, Robust Statistics, 1981, 7.6).

    What is given of the noise only scales the loss: M takes the scatter from the residuals themselves.

    **Arguments:** `root`s of the residuals and their `jacobian`, as the fit leaves them; `held` parameters count as
    known.
    """
    whole = least_squares_covariance(jacobian, held)
    kept = np.flatnonzero(whole.identifiable)
    if not kept.size:
        return whole
    original = loss.original(jnp.asarray(root))
    r, influence, curvature = map(np.asarray, (original, loss.influence(original), loss.curvature(original)))
    slope = np.where(np.abs(root) > 1e-12, influence / np.where(root == 0.0, 1.0, root), 1.0)
    columns = jacobian[:, kept] / slope[:, None]
    norms = np.linalg.norm(columns, axis=0)
    columns = columns / norms
    bread = np.linalg.inv(columns.T @ (curvature[:, None] * columns))
    scores = columns * influence[:, None]
    matrix = np.full_like(whole.matrix, np.nan)
    spread = bread @ (scores.T @ scores) @ bread * r.size / max(r.size - kept.size, 1)
    matrix[np.ix_(kept, kept)] = spread / np.outer(norms, norms)
    return whole._replace(matrix=matrix)
