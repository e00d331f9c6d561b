"""A Latin hypercube over a box (McKay, Beckman and Conover, Technometrics 21(2), 1979), by SciPy.

Each range is cut into as many slices as there are points, and every slice holds one.
"""

import numpy as np
from jaxtyping import Float

from ._sample import AbstractSample


class LatinHypercube(AbstractSample):
    """`count` points, one in every slice of every range."""

    def unit_cube(self, paths: int) -> Float[np.ndarray, "points paths"]:
        from scipy.stats import qmc

        return qmc.LatinHypercube(paths, rng=np.random.default_rng(self.seed)).random(self.count)
