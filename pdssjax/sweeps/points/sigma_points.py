"""Points about an estimate, for bands to first order and for whether first order does.

With f+ and f- a metric at +h and -h standard deviations along each of the p principal axes of the covariance,

    slope = (f+ - f-) / (2 h),        variance = sum over axes of slope^2

to first order.  Whether that holds is asked as far away as draws lie: at +r and -r along p random directions at right
angles to each other, r = sqrt(p), over which the mean square of the linear change is the variance itself.  With the odd
part o = (f+ - f-) / 2 and the even part e = (f+ + f-) / 2 - f of the change that is found there, what first order
misses of the variance is

    mean of (o^2 + e^2) - variance.

Products of parameters show there as well as squares and breaks: along principal axes alone products do not.
Positive parameters are taken in their logarithm.
"""

import numpy as np
from jaxtyping import Float

from .base import AbstractPoints, Scatter
from .covariance_draws import CovarianceDraws

STEP = 0.5
"""h, in standard deviations."""

_SEED = 0
"""Of the random directions, which are the same in every sweep."""


class SigmaPoints(AbstractPoints):
    """The estimate, both points of every principal axis that has a variance, then those of every random direction."""

    def __init__(self, draws: CovarianceDraws):
        """About the means of `draws`, with their covariance."""
        self.draws = draws

    @property
    def paths(self) -> tuple[str, ...]:
        return self.draws.paths

    def dimensions(self) -> dict[str, int]:
        return {"sigma_point": 1 + 4 * len(self.paths)}

    def scattered(self) -> dict[str, Scatter]:
        return self.draws.scattered()

    def values(self) -> Float[np.ndarray, "points paths"]:
        axes = self.draws.root().T
        count = len(axes)
        directions = np.linalg.qr(np.random.default_rng(_SEED).standard_normal((count, count)))[0]
        out = np.concatenate([STEP * axes, np.sqrt(count) * directions @ axes])
        away = np.concatenate([np.zeros((1, len(self.paths))), np.repeat(out, 2, axis=0)])
        away[2::2] *= -1.0
        return self.draws.moved(away)
