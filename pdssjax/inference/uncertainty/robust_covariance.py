"""Covariance of an estimate under a robust loss: the sandwich of its score and its curvature."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ..covariance import Covariance, least_squares_covariance
from ..losses.base import AbstractLoss


def robust_covariance(
    root: Float[np.ndarray, " n"],
    jacobian: Float[np.ndarray, "n p"],
    held: Bool[np.ndarray, " p"],
    loss: AbstractLoss,
    apart: Float[np.ndarray, "k p"] | None = None,
) -> tuple[Covariance, Float[np.ndarray, "p p"]]:
    """B^-1 M B^-1 with B = J' diag(rho''/2) J and M = J' diag(rho'/2)^2 J (P. J. Huber, Robust Statistics, 1981, 7.6).

    What is given of the noise only scales the loss: M takes the scatter from the residuals themselves.  What was
    measured apart has the error given: it adds J' J to both.

    **Arguments:** `root`s of the residuals of the samples and their `jacobian`, as the fit leaves them; `held`
    parameters count as known; the Jacobian of what was measured `apart`.

    **Returns:** the covariance, and B^-1, by which the estimate follows what was measured apart; NaN alike.
    """
    given = np.zeros((0, jacobian.shape[1])) if apart is None else apart
    whole = least_squares_covariance(np.concatenate([jacobian, given]), held)
    kept = np.flatnonzero(whole.identifiable)
    if not kept.size:
        return whole, whole.matrix
    original = loss.original(jnp.asarray(root))
    r, influence, curvature = map(np.asarray, (original, loss.influence(original), loss.curvature(original)))
    slope = np.where(np.abs(root) > 1e-12, influence / np.where(root == 0.0, 1.0, root), 1.0)
    columns, others = jacobian[:, kept] / slope[:, None], given[:, kept]
    norms = np.hypot(np.linalg.norm(columns, axis=0), np.linalg.norm(others, axis=0))
    columns, others = columns / norms, others / norms
    known = others.T @ others
    bread = np.linalg.inv(columns.T @ (curvature[:, None] * columns) + known)
    scores = columns * influence[:, None]
    spread = bread @ (scores.T @ scores * r.size / max(r.size - kept.size, 1) + known) @ bread
    matrices = [np.full_like(whole.matrix, np.nan) for _ in range(2)]
    for matrix, found in zip(matrices, (spread, bread), strict=True):
        matrix[np.ix_(kept, kept)] = found / np.outer(norms, norms)
    return whole._replace(matrix=matrices[0]), matrices[1]
