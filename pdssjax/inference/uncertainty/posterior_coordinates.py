"""The coordinates in which a posterior is drawn: the scale of the fit, but values where zero is near.

Where a damping may be zero its logarithm goes to minus infinity, and the likelihood with it to what it is at zero: no
polynomial follows that, and at an optimum at zero residuals have no derivative by it.  By the value itself, in standard
errors, they are as smooth as they are elsewhere.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .posterior_model import principal_axes
from .profile_likelihood import Box, Evaluate
from .second_order import Linearisation

_NEAR = 3.0
"""Standard errors from zero below which a value is drawn itself, and not its logarithm."""

_LEAST = 1e-6
"""Of a value, in standard errors: at zero a logarithm is not finite."""


class PosteriorCoordinates(eqx.Module):
    """Coordinates y of p parameters, in place of the fit's x."""

    by_value: Bool[np.ndarray, " p"]
    """Where x is the logarithm of a value and y the value."""
    unit: Float[np.ndarray, " p"]
    """Of such a value [SI], its standard error; 1 elsewhere."""

    def to_fit(self, y: Float[Array | np.ndarray, "*n p"]) -> Float[Array, "*n p"]:
        """x at y."""
        return jnp.where(self.by_value, jnp.log(jnp.where(self.by_value, y * self.unit, 1.0)), y)

    def of_fit(self, x: Float[np.ndarray, " p"]) -> Float[np.ndarray, " p"]:
        """y at x, a little above zero where that is zero."""
        return np.where(self.by_value, np.maximum(np.exp(np.where(self.by_value, x, 0.0)) / self.unit, _LEAST), x)

    def slopes(self, y: Float[Array | np.ndarray, " p"]) -> Float[Array, " p"]:
        """dx/dy."""
        return jnp.where(self.by_value, 1.0 / jnp.where(self.by_value, y, 1.0), 1.0)

    def bounds(self, bounds: Box) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]]:
        """Those on y that are `bounds` on x."""
        low, high = bounds
        return self.of_fit(np.asarray(low, float)), self.of_fit(np.asarray(high, float))

    def linearised(self, point: Linearisation) -> Linearisation:
        """What is known at a `point` of the fit."""
        at = self.of_fit(point.at)
        return Linearisation(at, point.residual, point.jacobian * np.asarray(self.slopes(at)))


class InCoordinates(eqx.Module):
    """Residuals and their Jacobian by y."""

    evaluate: Evaluate
    """The same by x."""
    coordinates: PosteriorCoordinates

    def __call__(self, y: Float[Array | np.ndarray, " p"]) -> tuple[Float[Array, " n"], Float[Array, "n p"]]:
        residual, jacobian = self.evaluate(self.coordinates.to_fit(y))
        return jnp.asarray(residual), jnp.asarray(jacobian) * self.coordinates.slopes(y)


def posterior_coordinates(
    optimum: Linearisation,
    moving: Int[np.ndarray, " q"],
    bounds: Box,
    factor: float,
    logarithmic: Bool[np.ndarray, " p"],
) -> PosteriorCoordinates:
    """Those around an `optimum` of the fit, of which some parameters are `logarithmic`; see `posterior_model`.

    A value is near zero where the linear model has it there within three standard errors, unless it is nearer to its
    upper bound: what the data do not tell from infinity.
    """
    errors = np.linalg.norm(principal_axes(optimum, moving, factor), axis=1)  # of logarithms: relative
    low, high = bounds
    near = logarithmic & (errors > 1.0 / _NEAR) & ~(high - optimum.at < optimum.at - low)
    unit = np.where(near, np.exp(np.where(near, optimum.at, 0.0)) * errors, 1.0)
    return PosteriorCoordinates(near, unit)
