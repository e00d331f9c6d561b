"""How a least-squares estimate follows the samples, to first order: what every covariance of it is made of.

Where the samples are off by e, the estimate is off by H^-1 J' e.  H = J' J + S, S = sum r d2r, is the whole second
derivative of half the sum of squares: where the model does not explain the data, its residuals r do not average out,
and without their curvature S the errors are wrong (H. White, Econometrica 50(1), 1982).  docs/error-models.md says by
how much.

With the pseudo-inverse L U' of J, U' U = 1 and L L' = (J' J)^-1, it is H^-1 J' = L (1 + L' S L)^-1 U'.  The columns of
L are principal directions, each as long as its standard error: along them S is found by differences of the Jacobian
that neither rounding nor a narrow valley spoils.
"""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from ..covariance import NO_INFORMATION
from ..parameter_transform import Box

LEAST_CURVATURE, MOST_CURVATURE = 0.2, 5.0
"""Least and most curvature of the sum of squares that is believed, as a share of that of J' J; beyond, the picture is
too far from quadratic for any covariance."""

LONGEST = 0.1
"""Longest step along a principal direction, in any parameter, on the fit's scale: ten per cent of a positive one."""


def influence_of(
    jacobian: Float[np.ndarray, "n p"], curvature: Float[np.ndarray, "p k"] | None = None
) -> Float[np.ndarray, "n p"]:
    """H^-1 J', transposed: the effect of each sample on each parameter, all of them fitted at once.

    **Arguments:** `curvature` S L, along the principal directions; None: none.  A direction without information is
    left out.
    """
    left, spread = pseudo_inverse(jacobian)
    if curvature is None:
        return left @ spread.T
    return left @ np.linalg.solve(relative_curvature(spread, curvature), spread.T)


def principal_directions(jacobian: Float[np.ndarray, "n p"]) -> Float[np.ndarray, "p k"]:
    """L: as columns, the steps that change the whitened residuals by 1, in directions at right angles there."""
    return pseudo_inverse(jacobian)[1]


def curvature_of(
    jacobian_at: Callable[[Float[np.ndarray, " p"]], Float[np.ndarray, "n p"]],
    free: Float[np.ndarray, " p"],
    residual: Float[np.ndarray, " n"],
    jacobian: Float[np.ndarray, "n p"],
    directions: Float[np.ndarray, "p k"],
    groups: Sequence[slice],
    bounds: Box,
) -> list[Float[np.ndarray, "p k"]]:
    """S along `directions`, of each group of samples, by differences of the Jacobian.

    **Arguments:** `jacobian_at`, the Jacobian at a point; `residual` and `jacobian` at the point `free`; `bounds`,
    lower and upper, that no step crosses.

    **Returns:** a matrix a group; column j is (J(free + h v_j) - J)' r / h, with h = 1 or less; 0 where the Jacobian
    is not finite there.
    """
    out = [np.zeros(directions.shape) for _ in groups]
    for j, direction in enumerate(directions.T):
        step = min(1.0, LONGEST / float(np.max(np.abs(direction))))
        step = _inside(free, direction, step, bounds)
        there = jacobian_at(free + step * direction)
        if not np.isfinite(there).all():
            continue
        for matrix, rows in zip(out, groups, strict=True):
            matrix[:, j] = (there[rows] - jacobian[rows]).T @ residual[rows] / step
    return out


def _inside(
    free: Float[np.ndarray, " p"],
    direction: Float[np.ndarray, " p"],
    step: float,
    bounds: Box,
) -> float:
    """`step`, or the other way, or a shorter one, so that no bound is crossed; tiny where every one crosses one."""
    for _ in range(40):
        for way in (step, -step):
            there = free + way * direction
            moved = direction != 0.0
            if np.all((there >= bounds[0])[moved]) and np.all((there <= bounds[1])[moved]):
                return way
        step *= 0.5
    return step


def pseudo_inverse(jacobian: Float[np.ndarray, "n p"]) -> tuple[Float[np.ndarray, "n k"], Float[np.ndarray, "p k"]]:
    """Factors U and L of the pseudo-inverse J+ = L U'; the columns of L are the principal directions."""
    norms = np.linalg.norm(jacobian, axis=0)
    norms = np.where(norms > 0, norms, np.inf)
    left, singular, rows = np.linalg.svd(jacobian / norms, full_matrices=False)
    known = singular > NO_INFORMATION * np.max(singular, initial=0.0)
    return left[:, known], (rows[known] / singular[known, None] / norms).T


def relative_curvature(
    spread: Float[np.ndarray, "p k"], curvature: Float[np.ndarray, "p k"]
) -> Float[np.ndarray, "k k"]:
    """1 + L' S L: H where J' J is the identity, its eigenvalues between `LEAST_CURVATURE` and `MOST_CURVATURE`."""
    relative = spread.T @ curvature
    values, axes = np.linalg.eigh(0.5 * (relative + relative.T))
    return axes * np.clip(1.0 + values, LEAST_CURVATURE, MOST_CURVATURE) @ axes.T
