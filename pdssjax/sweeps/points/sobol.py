"""A scrambled Sobol sequence over a box (A. B. Owen, Journal of Complexity 14(4), 1998), by SciPy.

Its points fill the box more evenly than chance does; best where their number is a power of two.
"""

import warnings

import numpy as np
from jaxtyping import Float

from ._sample import AbstractSample


class Sobol(AbstractSample):
    """The first `count` points of a scrambled Sobol sequence over the ranges."""

    def unit_cube(self, paths: int) -> Float[np.ndarray, "points paths"]:
        from scipy.stats import qmc

        with warnings.catch_warnings():
            # Of numbers that are no power of two; they are only less even.
            warnings.simplefilter("ignore", UserWarning)
            return qmc.Sobol(paths, rng=np.random.default_rng(self.seed)).random(self.count)
