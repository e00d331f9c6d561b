"""Coordinates in which a posterior is nearly a standard normal distribution.

    x = fold(x0 + A w),    w_k = u_k - sum_ij B_kij u_i u_j / 2    over i, j before k

A A' is the covariance of the linear model at the optimum x0.  Where the valley of chi-square is narrow and bent, some
axes bend into others, which come last; B, the tangential part of the residual's
second derivatives (D. M. Bates and D. G. Watts, J. Royal Statistical Society B 42(1), 1980), takes that out as a
shear.  A shear has determinant one, whatever B is: what is sampled in u is exact, and B only decides how easily.
Bounds reflect: beyond one the parameter comes back, so that the density has no edge.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .quadratic_end import factors
from .second_order import Point


class Preconditioner(eqx.Module):
    """From u, of order one, to the numbers of the fit; q of p parameters move."""

    centre: Float[np.ndarray, " p"]
    axes: Float[np.ndarray, "p q"]
    """Columns of A, those into which others bend last."""
    shear: Float[np.ndarray, "q q q"]
    """B_kij, zero but for i, j < k."""
    low: Float[np.ndarray, " p"]
    high: Float[np.ndarray, " p"]

    def __call__(self, u: Float[Array, " q"]) -> Float[Array, " p"]:
        w = u - 0.5 * jnp.einsum("kij,i,j->k", self.shear, u, u)
        return self._folded(jnp.asarray(self.centre) + jnp.asarray(self.axes) @ w)

    def sheared(self, residuals: Callable[[Float[Array, " p"]], Float[Array, " m"]]) -> "Preconditioner":
        """The same with its axes turned so that the last are those into which the valley bends, and the shear along
        them; `residuals` may be any with the same sum of squares."""
        along = lambda w: residuals(jnp.asarray(self.centre) + jnp.asarray(self.axes) @ w)
        origin = jnp.zeros(self.axes.shape[1])
        tangents, second = np.asarray(jax.jacfwd(along)(origin)), np.asarray(jax.hessian(along)(origin))
        lengths = np.maximum(np.sum(tangents**2, axis=0), 1e-300)
        bent = np.einsum("mk,mij->kij", tangents, second) / lengths[:, None, None]
        _, turn = np.linalg.eigh(np.einsum("kij,lij->kl", bent, bent))
        bent = np.einsum("kij,ka,ib,jc->abc", bent, turn, turn, turn, optimize=True)
        count = self.axes.shape[1]
        before = np.arange(count)[:, None] > np.arange(count)
        shear = bent * (before[:, :, None] & before[:, None, :])
        return Preconditioner(self.centre, self.axes @ turn, shear, self.low, self.high)

    def _folded(self, x: Float[Array, " p"]) -> Float[Array, " p"]:
        """Reflected at the bounds, as often as it takes; as it is where there are none."""
        low, high = jnp.asarray(self.low), jnp.asarray(self.high)
        two_sided = jnp.isfinite(low) & jnp.isfinite(high) & (high > low)
        start, width = jnp.where(two_sided, low, 0.0), jnp.where(two_sided, high - low, 1.0)
        phase = jnp.mod((x - start) / width, 2.0)
        to_and_fro = start + width * jnp.where(phase > 1.0, 2.0 - phase, phase)
        below, above = x < low, x > high
        once = jnp.where(below, 2.0 * jnp.where(below, low, 0.0) - x, x)
        once = jnp.where(above, 2.0 * jnp.where(above, high, 0.0) - x, once)
        return jnp.where(two_sided & (below | above), to_and_fro, once)


def precondition(
    optimum: Point,
    moving: Float[np.ndarray, " q"],
    factor: float,
    bounds: tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]],
    reach: float = 1.0,
) -> Preconditioner:
    """The coordinates around an `optimum`, not sheared.

    **Arguments:** the places of the parameters that are `moving`; the `factor` by which variances exceed those of the
    noise given; the longest standard error that an axis may have on the scale of the fit, `reach`.
    """
    moving = np.asarray(moving, int)
    _, singular, rows, norms = factors(optimum.jacobian[:, moving])
    inner = np.sqrt(factor) * (rows / singular[:, None]).T / norms[:, None]
    inner = inner * np.minimum(1.0, reach / np.maximum(np.max(np.abs(inner), axis=0), 1e-300))
    axes = np.zeros((optimum.at.size, moving.size))
    axes[moving] = inner
    return Preconditioner(optimum.at, axes, np.zeros((moving.size,) * 3), *(np.asarray(end, float) for end in bounds))
