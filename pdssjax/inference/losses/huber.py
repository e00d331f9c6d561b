"""Huber's loss: squares for small residuals, straight lines for large ones (Ann. Math. Statist. 35, 1964)."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .base import AbstractLoss

_BEND = 1.345
"""Standard deviations where the line begins: 95 % of the efficiency of least squares at normal noise."""


class Huber(AbstractLoss):
    """rho = r^2 where |r| <= 1.345, else 2.69 |r| - 1.345^2.

    A glitch pulls like a residual of 1.345 standard deviations, whatever its size.  Convex: it makes no new optima.
    """

    def root(self, r: Float[Array, "*n"]) -> Float[Array, "*n"]:
        far = jnp.abs(r) > _BEND
        size = jnp.where(far, jnp.abs(r), _BEND)
        return jnp.where(far, jnp.sign(r) * jnp.sqrt(2.0 * _BEND * size - _BEND**2), r)

    def original(self, root: Float[Array, "*n"]) -> Float[Array, "*n"]:
        far = jnp.abs(root) > _BEND
        return jnp.where(far, jnp.sign(root) * (root**2 + _BEND**2) / (2.0 * _BEND), root)

    def influence(self, r: Float[Array, "*n"]) -> Float[Array, "*n"]:
        return jnp.clip(r, -_BEND, _BEND)

    def curvature(self, r: Float[Array, "*n"]) -> Float[Array, "*n"]:
        return jnp.where(jnp.abs(r) > _BEND, 0.0, 1.0)
