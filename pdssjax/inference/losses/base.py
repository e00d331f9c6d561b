"""The interface of a loss: the cost rho(r) of a residual r that is divided by its noise.

A fit minimises the sum of rho as a sum of squares of root(r) = sign(r) sqrt(rho(r)), so that any least-squares solver
does it.  All losses are r^2 for small residuals; robust ones grow slower (P. J. Huber, Robust Statistics, Wiley 1981).
"""

import abc
import math
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from ...core import Scalar

_ROUNDS = 30
"""Rounds of reweighting; each leaves a twentieth of the error."""


class AbstractLoss(eqx.Module):
    """The cost of a residual."""

    is_robust: ClassVar[bool] = True
    """Whether large residuals cost less than their squares."""

    scatter_efficiency: ClassVar[float] = 0.3675
    """Efficiency of `scatter` at normal noise, relative to the sum of squares; this is that of the median."""

    @abc.abstractmethod
    def root(self, r: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """sign(r) sqrt(rho(r)): what is squared and summed; differentiable, with slope 1 at 0.

        The residuals r are divided by their noise, and have no unit.
        """

    @abc.abstractmethod
    def original(self, root: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """The residual, divided by its noise, with that root."""

    @abc.abstractmethod
    def influence(self, r: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """rho'(r) / 2: how much a residual, divided by its noise, pulls; r for a sum of squares."""

    @abc.abstractmethod
    def curvature(self, r: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """rho''(r) / 2 of residuals divided by their noise: 1 for a sum of squares."""

    def scatter(self, roots: Float[np.ndarray, " n"], freedom: float) -> float:
        """The standard deviation of the noise over the assumed one, by `roots` of residuals divided by the latter.

        This is by the median of absolute residuals, which glitches hardly move.  Only losses that sum use `freedom`,
        the degrees of freedom of the residuals.
        """
        # The standard deviation of normal noise is 1.4826 times the median of its absolute values.
        return 1.4826 * float(np.median(np.abs(self.original(jnp.asarray(roots)))))

    def log_volume(self) -> float:
        """Logarithm of the integral of exp(-rho(r) / 2) over all r: what makes a loss a likelihood."""
        from scipy.integrate import quad

        density = lambda r: math.exp(-0.5 * float(self.root(jnp.asarray(r))) ** 2)
        return math.log(2.0 * quad(density, 0.0, math.inf, limit=200)[0])

    def location(self, difference: Float[Array, " n"], weight: Float[Array, "*n"]) -> Scalar:
        """The z at which the loss of (difference - z) weight is least; differentiable in `difference`.

        z has the unit of `difference`; a `weight`, one for all or one each, is one over the noise, and 0 leaves out.
        Iterative reweighting starts from the median; one Newton step follows, which carries the derivative (implicit
        function theorem).  If all weights are 0 all differences count, so that z is finite.
        """
        counts, inside = counted(difference, weight), lax.stop_gradient(difference)

        def reweighted(_: int, z: Scalar) -> Scalar:
            r = (inside - z) * weight
            size = jnp.where(jnp.abs(r) > 1e-12, self.influence(r) / jnp.where(r == 0.0, 1.0, r), 1.0)
            size = jnp.where(counts, size, 0.0)
            return jnp.sum(size * inside) / jnp.sum(size)

        middle = jnp.nanmedian(jnp.where(counts, inside, jnp.nan))
        z = lax.stop_gradient(lax.fori_loop(0, _ROUNDS, reweighted, middle))
        curvature = jnp.where(counts, lax.stop_gradient(self.curvature((inside - z) * weight)), 0.0)
        total = jnp.sum(curvature)
        pull = self.influence((inside - z) * weight) / jnp.where(weight > 0.0, weight, 1.0)
        value = lax.stop_gradient(jnp.where(weight > 0.0, pull, inside - z))
        # First order in a change of `difference`; its value is zero up to the error of reweighting.
        steps = jnp.where(counts, value + curvature * (difference - inside), 0.0)
        return z + jnp.sum(steps) / jnp.where(total > 0.0, total, 1.0)


def counted(difference: Float[Array, " n"], weight: Float[Array, "*n"]) -> Bool[Array, " n"]:
    """Which of the differences have a `weight`, one for all or one each; all of them where none has."""
    weighed = jnp.broadcast_to(weight > 0.0, difference.shape)
    return weighed | ~jnp.any(weighed)
