"""A scrambled Sobol sequence over a box: more even than chance, best where the number is a power of two."""

import numpy as np
from jaxtyping import Float

from ...core import sobol_points
from ._sample import AbstractSample


class Sobol(AbstractSample):
    """The first `count` points of a scrambled Sobol sequence over the ranges."""

    def unit_cube(self, paths: int) -> Float[np.ndarray, "points paths"]:
        return sobol_points(self.count, paths, self.seed)
