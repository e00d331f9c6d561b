"""The sum of squares: rho = r^2, best for normal noise."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from ...core import Scalar
from .base import AbstractLoss


class Squares(AbstractLoss):
    """rho = r^2."""

    is_robust: ClassVar[bool] = False

    def root(self, r: Float[Array, "*n"]) -> Float[Array, "*n"]:
        return r

    def original(self, root: Float[Array, "*n"]) -> Float[Array, "*n"]:
        return root

    def influence(self, r: Float[Array, "*n"]) -> Float[Array, "*n"]:
        return r

    def curvature(self, r: Float[Array, "*n"]) -> Float[Array, "*n"]:
        return jnp.ones_like(r)

    def location(self, difference: Float[Array, " n"], weight: Scalar) -> Scalar:
        return jnp.mean(difference)
