"""Compares a Jacobian with differences of the residual, and tells a wrong derivative from a discontinuity.

Central differences r(y + h d) - r(y - h d) are taken at two sizes h and compared with what J predicts.
The discrepancy left grows with h where the derivative is wrong, with its square or cube where the residual
is only curved, and stays where the residual has a jump.  Sizes are measured in residual noise, so that
h is a part of a standard error and what cannot be seen in the data does not count.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

SIZES = (4.0, 0.5)
"""Change of the residual by each half of a difference, in standard deviations of the residual."""

TOLERANCE = 0.1
"""Discrepancy that is let pass, relative to the difference; and absolutely, in standard deviations."""

_FARTHEST = 0.02
"""Longest move of a parameter along a direction, relative to its size or to one."""

_SMALLEST = 1e-6
"""Least change of the residual, relative to what the parameters themselves amount to: above rounding."""

AGREES, DISCONTINUOUS, WRONG = 0, 1, 2


def noise_scale(residual: Float[Array, " n"], jacobian: Float[Array, "n p"], y: Float[Array, " p"]) -> Array:
    """Standard deviation of the residual, or where it vanishes what rounding lets one see."""
    spread = jnp.linalg.norm(residual) / jnp.sqrt(max(residual.size - y.size, 1))
    norms = jnp.linalg.norm(jacobian, axis=0)
    # The median, so that one column that is wrong by orders of magnitude does not hide itself.
    return jnp.maximum(spread, _SMALLEST * jnp.median(norms * jnp.maximum(jnp.abs(y), 1e-3)) + 1e-300)


def random_direction(jacobian: Float[Array, "n p"], y: Float[Array, " p"], free: Array, scale: Array) -> Array:
    """A direction in which each free parameter moves the residual alike; a parameter without effect moves a little."""
    norms = jnp.linalg.norm(jacobian, axis=0)
    limit = _FARTHEST * jnp.maximum(jnp.abs(y), 1.0)
    signs = jax.random.normal(jax.random.key(0), y.shape, y.dtype)
    direction = jnp.where(norms > 0, signs / jnp.where(norms > 0, norms, 1.0), limit * signs) * free
    return _sized(direction, jacobian, y, scale)


def proposed_direction(jacobian: Float[Array, "n p"], y: Float[Array, " p"], step: Array, scale: Array) -> Array:
    """Along a proposed `step`."""
    return _sized(step, jacobian, y, scale)


def _sized(direction, jacobian, y, scale):
    """Scaled to change the residual by `scale`, but to move no parameter far."""
    change = jnp.linalg.norm(jacobian @ direction)
    longest = jnp.max(jnp.abs(direction) / (_FARTHEST * jnp.maximum(jnp.abs(y), 1.0)))
    factor = jnp.minimum(scale / jnp.maximum(change, 1e-300), 1.0 / (SIZES[0] * jnp.maximum(longest, 1e-300)))
    return direction * jnp.where(jnp.isfinite(factor), factor, 0.0)


def discrepancy(difference: Float[Array, " n"], predicted: Float[Array, " n"], scale: Array) -> tuple[Array, Array]:
    """How far a difference of the residual is from the one `predicted`, and whether that is too far."""
    error = jnp.linalg.norm(difference - predicted)
    error = jnp.where(jnp.isfinite(error), error, jnp.inf)
    far = (error > TOLERANCE * jnp.linalg.norm(predicted)) & (error > TOLERANCE * scale)
    return error, far


def verdict(large: Array, small: Array) -> Array:
    """AGREES, DISCONTINUOUS or WRONG from two discrepancies that were both too far."""
    growth = jnp.log(large / small) / jnp.log(SIZES[0] / SIZES[1])
    growth = jnp.where(jnp.isfinite(growth), growth, 0.0)
    return jnp.where(growth < 0.5, DISCONTINUOUS, jnp.where(growth < 1.6, WRONG, AGREES))
