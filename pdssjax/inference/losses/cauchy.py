"""Cauchy's loss: far residuals hardly pull at all."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .base import AbstractLoss

_SCALE = 2.3849
"""Standard deviations: 95 % of the efficiency of least squares at normal noise."""


class Cauchy(AbstractLoss):
    """rho = c^2 ln(1 + (r/c)^2), c = 2.385: minus twice the log-likelihood of Cauchy's distribution, but for factors.

    The pull of a glitch falls as one over its size; the loss is not convex, so starts matter more.
    """

    def root(self, r: Float[Array, "*n"]) -> Float[Array, "*n"]:
        q = (r / _SCALE) ** 2
        small = q < 1e-8
        part = jnp.where(small, 1.0 - 0.5 * q, jnp.log1p(q) / jnp.where(small, 1.0, q))
        return r * jnp.sqrt(part)

    def original(self, root: Float[Array, "*n"]) -> Float[Array, "*n"]:
        return jnp.sign(root) * _SCALE * jnp.sqrt(jnp.expm1((root / _SCALE) ** 2))

    def influence(self, r: Float[Array, "*n"]) -> Float[Array, "*n"]:
        return r / (1.0 + (r / _SCALE) ** 2)

    def curvature(self, r: Float[Array, "*n"]) -> Float[Array, "*n"]:
        q = (r / _SCALE) ** 2
        return (1.0 - q) / (1.0 + q) ** 2
