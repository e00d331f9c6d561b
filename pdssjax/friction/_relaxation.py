"""Exponential relaxation: what a linear state does while the velocity is constant."""

import jax.numpy as jnp

from ..core import Scalar, ScalarLike


def relax(begin: Scalar, end: ScalarLike, exponent: ScalarLike) -> Scalar:
    """Relax from `begin` until exp(-exponent) of the distance to `end` is left; exact for small exponents, too."""
    return begin - (end - begin) * jnp.expm1(-jnp.asarray(exponent, float))
