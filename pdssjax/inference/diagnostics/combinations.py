"""Which combinations of parameters the data determine, and how well: eigenvectors of the relative covariance.

With every parameter on a relative scale a direction v is the product of p_i^v_i.  Products along the eigenvectors are
independent of each other, and the square root of the eigenvalue is the relative standard error.
"""

import numpy as np
from jaxtyping import Float

from ...study import Combination, Remedy

TAKES_PART = 0.15
"""Exponent, against the largest, below which a parameter is left out of a product."""

HALVED = 0.5
"""Share of its error below which a parameter has gained from what is known of another."""

WORTH_MENDING = 0.05
"""Relative standard error from which a parameter is worth a remedy."""


def combinations(relative: Float[np.ndarray, "p p"], paths: tuple[str, ...]) -> tuple[Combination, ...]:
    """Of the covariance of relative changes; the worst determined combination first.

    **Arguments:** parameters without information have NaN rows and columns, and are left out.
    """
    known = np.flatnonzero(np.isfinite(np.diag(relative)))
    if not known.size:
        return ()
    values, vectors = np.linalg.eigh(relative[np.ix_(known, known)])
    found = []
    for value, vector in zip(values[::-1], vectors.T[::-1], strict=True):
        exponents = vector / vector[np.argmax(np.abs(vector))]
        parts = {paths[i]: float(e) for i, e in zip(known, exponents, strict=True) if abs(e) >= TAKES_PART}
        ranked = dict(sorted(parts.items(), key=lambda part: -abs(part[1])))
        # The error of the product as it is written, so that the number belongs to what is read.
        powers = np.array([ranked.get(paths[i], 0.0) for i in known])
        spread = powers @ relative[np.ix_(known, known)] @ powers
        found.append(Combination(ranked, float(np.sqrt(max(spread, value, 0.0)))))
    return tuple(found)


def best_remedy(relative: Float[np.ndarray, "p p"], paths: tuple[str, ...]) -> Remedy | None:
    """The one parameter of which knowledge from elsewhere would lower the errors of others most.

    If p_j were known exactly, the variance of p_i would fall by C_ij^2 / C_jj.

    **Returns:** None where no parameter of an error worth it would lose half of that.
    """
    known = np.flatnonzero(np.isfinite(np.diag(relative)) & (np.diag(relative) > 0.0))
    matrix = relative[np.ix_(known, known)]
    errors = np.sqrt(np.diag(matrix))
    best, gained = None, 0.0
    for j in range(known.size):
        left = np.sqrt(np.maximum(errors**2 - matrix[:, j] ** 2 / matrix[j, j], 0.0))
        gains = [i for i in range(known.size) if i != j and errors[i] > WORTH_MENDING and left[i] < HALVED * errors[i]]
        gain = sum(float(np.log(errors[i] / max(left[i], 1e-3 * errors[i]))) for i in gains)
        if gain > gained:
            gained = gain
            best = Remedy(paths[known[j]], {paths[known[i]]: (float(errors[i]), float(left[i])) for i in gains})
    return best
