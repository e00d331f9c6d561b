"""Points about an estimate, two along every principal axis of its covariance, for bands to first order.

With f+ and f- a metric at +h and -h standard deviations along a principal axis, and f at the estimate,

    variance = sum over axes ((f+ - f-) / (2 h))^2,        bend = sum over axes (f+ + f- - 2 f) / (2 h^2)

to first order; the bend is what the second order adds to the mean.  Positive parameters are taken in their logarithm.
"""

import numpy as np
from jaxtyping import Float

from .base import AbstractPoints
from .covariance_draws import CovarianceDraws

STEP = 0.5
"""h, in standard deviations."""


class SigmaPoints(AbstractPoints):
    """The estimate, then both points of every principal axis that has a variance."""

    def __init__(self, draws: CovarianceDraws):
        """About the means of `draws`, with their covariance."""
        self.draws = draws

    @property
    def paths(self) -> tuple[str, ...]:
        return self.draws.paths

    def dimensions(self) -> dict[str, int]:
        return {"sigma_point": 1 + 2 * len(self.paths)}

    def values(self) -> Float[np.ndarray, "points paths"]:
        axes = STEP * self.draws.root().T
        away = np.concatenate([np.zeros((1, len(self.paths))), np.repeat(axes, 2, axis=0)])
        away[2::2] *= -1.0
        return self.draws.moved(away)
