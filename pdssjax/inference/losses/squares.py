"""The sum of squares: rho = r^2, best for normal noise."""

import math
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...core import Scalar
from .base import AbstractLoss, counted


class Squares(AbstractLoss):
    """rho = r^2."""

    is_robust: ClassVar[bool] = False
    scatter_efficiency: ClassVar[float] = 1.0

    def root(self, r: Float[Array, "*n"]) -> Float[Array, "*n"]:
        return r

    def original(self, root: Float[Array, "*n"]) -> Float[Array, "*n"]:
        return root

    def influence(self, r: Float[Array, "*n"]) -> Float[Array, "*n"]:
        return r

    def curvature(self, r: Float[Array, "*n"]) -> Float[Array, "*n"]:
        return jnp.ones_like(r)

    def scatter(self, roots: Float[np.ndarray, " n"], freedom: float) -> float:
        return math.sqrt(float(np.sum(roots**2)) / max(freedom, 1.0))

    def log_volume(self) -> float:
        return 0.5 * math.log(2.0 * math.pi)

    def location(self, difference: Float[Array, " n"], weight: Float[Array, "*n"]) -> Scalar:
        return jnp.mean(difference, where=counted(difference, weight))
