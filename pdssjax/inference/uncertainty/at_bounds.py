"""Parameters whose optimum lies at a bound: their distance s from the bound as a normal variable e.

    s = +-(x - bound) < S,    (1 - exp(-rho s)) / (1 - exp(-rho S)) = Phi(e)

Chi-square rises from the bound, and the density inside decays exponentially, or as half of a normal distribution where
chi-square has no slope.  Randomized residuals ignore the bound: the steeper chi-square, the fewer of them have a
solution inside.  So s is drawn by itself from an exponential, whose heavier tail keeps the weights bounded.  Its mean
is that of the linear model's exp(-g s - h s^2 / 2):

    1 / rho = (lambda(a) - a) / sqrt(h),    a = g / sqrt(h),    lambda = phi / (1 - Phi)

S is where the other bound lies.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import log_ndtr, ndtri
from jaxtyping import Array, Float, Int

from ..parameter_transform import Box
from .second_order import Linearisation

_STEEP = 30.0
"""Value of a from which the density is an exponential to a thousandth."""


class AtBounds(eqx.Module):
    """The k parameters with their optimum at a bound; all move along q axes, x = x0 + A w."""

    begin: Float[np.ndarray, " k"]
    """s at w = 0."""
    rows: Float[np.ndarray, "k q"]
    """ds/dw."""
    rates: Float[np.ndarray, " k"]
    """rho."""
    ends: Float[np.ndarray, " k"]
    """rho S."""

    def scaled(self, w: Float[Array, " q"]) -> Float[Array, " k"]:
        """rho s at w."""
        return jnp.asarray(self.rates) * (self.begin + self.rows @ w)

    def normal_of(self, scaled: Float[Array, " k"]) -> Float[Array, " k"]:
        """e of rho s: minus infinity at the bound, NaN beyond it and beyond the other one."""
        return _normal_of(scaled, jnp.asarray(self.ends))

    def scaled_of(self, e: Float[Array, " k"]) -> Float[Array, " k"]:
        """rho s of e."""
        return _scaled_of(e, jnp.asarray(self.ends))

    def log_slope(self, e: Float[Array, " k"]) -> Float[Array, " k"]:
        """Logarithm of de/d(rho s)."""
        return _log_slope(e, jnp.asarray(self.ends))

    def middle(self) -> Float[Array, " q"]:
        """The w nearest to zero at which s is half-way: a draw is as likely to be nearer to the bound as farther."""
        if not self.rates.size:
            return jnp.zeros(self.rows.shape[1])
        half = self.scaled_of(jnp.zeros(self.rates.size))
        return jnp.linalg.pinv(jnp.asarray(self.rows)) @ (half / self.rates - self.begin)

    def free_directions(self) -> Float[Array, "q q-k"]:
        """Orthonormal directions in which s does not change."""
        if not self.rates.size:
            return jnp.eye(self.rows.shape[1])
        basis = jnp.linalg.qr(jnp.asarray(self.rows).T, mode="complete")[0]
        return basis[:, self.rates.size :]


def at_bounds(
    optimum: Linearisation,
    axes: Float[np.ndarray, "p q"],
    moving: Int[np.ndarray, " q"],
    bounds: Box,
    factor: float,
    prior_slopes: Float[np.ndarray, " p"],
) -> AtBounds:
    """Which of the parameters at the places `moving` have their `optimum` at one of the `bounds`.

    **Arguments:** the `axes` along which they move, the `factor` by which variances exceed those of the noise given,
    the slopes of the logarithm of the prior.
    """
    below, above = optimum.at - bounds[0], bounds[1] - optimum.at
    errors = np.linalg.norm(axes, axis=1)
    held = np.array([place for place in moving if min(below[place], above[place]) <= 1e-3 * errors[place]], int)
    sides = np.where(below[held] <= above[held], 1.0, -1.0)
    others = optimum.jacobian[:, np.setdiff1d(moving, held)]
    basis = np.linalg.qr(others / np.linalg.norm(others, axis=0))[0]
    columns = optimum.jacobian[:, held] * sides
    columns -= basis @ (basis.T @ columns)
    slopes = columns.T @ optimum.residual / factor - sides * prior_slopes[held]
    bends = np.sum(columns**2, axis=0) / factor
    begin, rates = np.minimum(below, above)[held], _rates(slopes, np.sqrt(bends))
    return AtBounds(begin, sides[:, None] * axes[held], rates, rates * (bounds[1] - bounds[0])[held])


def _rates(slopes: Float[np.ndarray, " k"], roots: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """The rates rho of the exponentials, from g and the root of h."""
    from scipy.special import erfcx

    steep = np.clip(slopes / roots, -_STEEP, _STEEP)
    inside = np.sqrt(2.0 / np.pi) / erfcx(steep / np.sqrt(2.0)) - steep
    return np.where(slopes > _STEEP * roots, slopes, roots / inside)


@jax.custom_jvp
def _normal_of(scaled: Float[Array, " k"], ends: Float[Array, " k"]) -> Float[Array, " k"]:
    whole, left = -jnp.expm1(-ends), jnp.exp(-scaled) - jnp.exp(-ends)
    share = -jnp.expm1(-scaled) / whole
    return jnp.where(share < 0.5, ndtri(share), -ndtri(left / whole))


@_normal_of.defjvp
def _normal_of_jvp(
    primals: tuple[Float[Array, " k"], Float[Array, " k"]], tangents: tuple[Float[Array, " k"], Float[Array, " k"]]
) -> tuple[Float[Array, " k"], Float[Array, " k"]]:
    # The ends are constants.
    scaled, ends = primals
    e = _normal_of(scaled, ends)
    return e, jnp.exp(_log_slope(e, ends)) * tangents[0]


def _scaled_of(e: Float[Array, " k"], ends: Float[Array, " k"]) -> Float[Array, " k"]:
    return -jnp.logaddexp(log_ndtr(-e) + jnp.log(-jnp.expm1(-ends)), -ends)


def _log_slope(e: Float[Array, " k"], ends: Float[Array, " k"]) -> Float[Array, " k"]:
    normal = -0.5 * e**2 - 0.5 * np.log(2.0 * np.pi)
    return -_scaled_of(e, ends) - normal - jnp.log(-jnp.expm1(-ends))
