"""Quasi-random points in a unit cube: a scrambled Sobol sequence, by SciPy.

A. B. Owen, Journal of Complexity 14(4), 1998.  Best where the number of points is a power of two.
"""

import warnings

import numpy as np
from jaxtyping import Float


def sobol_points(count: int, dimensions: int, seed: int) -> Float[np.ndarray, "count dimensions"]:
    """The first `count` points in [0, 1), scrambled by random numbers of the `seed`."""
    from scipy.stats import qmc

    with warnings.catch_warnings():
        # Of numbers that are no power of two; they are only less even.
        warnings.simplefilter("ignore", UserWarning)
        return qmc.Sobol(dimensions, rng=np.random.default_rng(seed)).random(count)
