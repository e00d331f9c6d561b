"""Compares a Jacobian with differences of the residual, and tells a wrong derivative from a discontinuity.

Central differences r(y + h d) - r(y - h d) are taken at sizes h and compared with what J predicts.
The discrepancy left grows with h where the derivative is wrong, with its square or cube where the residual
is only curved, and stays where the residual has a jump.  Sizes are measured in residual noise, so that
h is a part of a standard error and what cannot be seen in the data does not count.  Two of them may both be too
large to tell a wrong derivative from a residual that bends within them; then smaller ones decide.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ...core import Count, Scalar, ScalarLike, Truth
from .lm_state import Vector

SIZES = (4.0, 0.5, 0.06, 0.008)
"""Change of the residual by each half of a difference, in standard deviations of the residual."""

DIRECTIONS = 2
"""Directions in which differences are taken: a random and the proposed one."""

CHECKS = DIRECTIONS * len(SIZES)
"""Largest number of differences."""

TOLERANCE = 0.1
"""Discrepancy that is tolerated, relative to the difference; and absolutely, in standard deviations."""

_LONGEST_MOVE = 0.02
"""Longest move of a parameter along a direction, relative to its size or to one."""

_SMALLEST_CHANGE = 1e-6
"""Least change of the residual, relative to what the parameters themselves amount to: above rounding."""

AGREES, DISCONTINUOUS, WRONG = 0, 1, 2


def noise_scale(residual: Float[Array, " n"], jacobian: Float[Array, "n p"], y: Vector, atol: ScalarLike) -> Scalar:
    """Standard deviation of the residual, or where it vanishes what rounding lets one see and what matters.

    At least so large that a discrepancy counts only where it stands for a sum of squares of more than `atol`: of a
    perfect fit all else is rounding, which does not shrink with the size of a difference and would look like a jump.
    """
    spread = jnp.linalg.norm(residual) / jnp.sqrt(max(residual.size - y.size, 1))
    spread = jnp.maximum(spread, jnp.sqrt(jnp.asarray(atol, y.dtype)) / TOLERANCE)
    norms = jnp.linalg.norm(jacobian, axis=0)
    # The median: one column that is wrong by orders of magnitude must not raise the scale by which it is judged.
    return jnp.maximum(spread, _SMALLEST_CHANGE * jnp.median(norms * jnp.maximum(jnp.abs(y), 1e-3)) + 1e-300)


def random_direction(jacobian: Float[Array, "n p"], y: Vector, free: Bool[Array, " p"], scale: Scalar) -> Vector:
    """A direction in which each free parameter moves the residual alike; a parameter without effect moves a little."""
    norms = jnp.linalg.norm(jacobian, axis=0)
    limit = _LONGEST_MOVE * jnp.maximum(jnp.abs(y), 1.0)
    signs = jax.random.normal(jax.random.key(0), y.shape, y.dtype)
    direction = jnp.where(norms > 0, signs / jnp.where(norms > 0, norms, 1.0), limit * signs) * free
    return scaled_direction(direction, jacobian, y, scale)


def scaled_direction(direction: Vector, jacobian: Float[Array, "n p"], y: Vector, scale: Scalar) -> Vector:
    """The `direction`, scaled to change the residual by `scale`, but to move no parameter far."""
    change = jnp.linalg.norm(jacobian @ direction)
    longest = jnp.max(jnp.abs(direction) / (_LONGEST_MOVE * jnp.maximum(jnp.abs(y), 1.0)))
    factor = jnp.minimum(scale / jnp.maximum(change, 1e-300), 1.0 / (SIZES[0] * jnp.maximum(longest, 1e-300)))
    return direction * jnp.where(jnp.isfinite(factor), factor, 0.0)


def next_check(
    checked: Count,
    earlier: Float[Array, " sizes"],
    difference: Float[Array, " n"],
    predicted: Float[Array, " n"],
    scale: Scalar,
    thorough: Truth,
) -> tuple[Scalar, Count, Count]:
    """What one more difference of the residual says of the derivative.

    **Arguments:** `checked`, the number of this check, along direction `checked // len(SIZES)` with size
    `checked % len(SIZES)`; the discrepancies found `earlier` along that direction; the difference and the one
    `predicted` by the Jacobian; the `scale` of the residual's noise; `thorough`, whether all sizes are tried along the
    proposed direction although a larger one agrees: what stops a search there need not be seen in it.

    **Returns:** the discrepancy, the verdict so far, and the number of the next check.
    """
    error = jnp.linalg.norm(difference - predicted)
    error = jnp.where(jnp.isfinite(error), error, jnp.inf)
    size = checked % len(SIZES)
    # The smallest differences cannot be seen in the data at all; they are compared for what they are.
    visible = (error > TOLERANCE * scale) | (size >= 2)
    far = visible & (error > TOLERANCE * jnp.linalg.norm(predicted))
    sizes = jnp.asarray(SIZES)
    growth = jnp.log(earlier[size - 1] / error) / jnp.log(sizes[size - 1] / sizes[size])
    growth = jnp.where(jnp.isfinite(growth), growth, 0.0)
    jumps, wrong = growth < 0.5, (growth >= 0.5) & (growth < 1.6)
    decisive = (size == 1) & jumps | (size == len(SIZES) - 1)
    verdict = jnp.where(jumps, DISCONTINUOUS, jnp.where(wrong, WRONG, AGREES))
    verdict = jnp.where(far & decisive, verdict, AGREES)
    undecided = far & ((size == 0) | (size == 1) & wrong | (size == 2))
    undecided |= thorough & (checked >= len(SIZES)) & (size < len(SIZES) - 1) & (verdict == AGREES)
    following = jnp.where(undecided, checked + 1, (checked // len(SIZES) + 1) * len(SIZES))
    return error, verdict, following


def is_kink(ends: Float[Array, "2 n"], linear: Float[Array, "2 n"], residual: Float[Array, " n"]) -> Truth:
    """Whether the residual's slope changes between the `ends` of a difference, and explains what the Jacobian misses.

    A Jacobian that is right on one side, or for each sample on some side, lies between the slopes on both sides.  A
    wrong one does not: where the residual is smooth both slopes are equal.
    """
    before, after = residual - ends[1], ends[0] - residual
    predicted = 0.5 * (linear[0] - linear[1])
    outside = predicted - jnp.clip(predicted, jnp.minimum(before, after), jnp.maximum(before, after))
    # A side without a move, at a bound, shows nothing.
    moves = jnp.linalg.norm(linear - residual, axis=-1)
    moved = jnp.min(moves) > 0.5 * jnp.max(moves)
    missed = jnp.maximum(jnp.linalg.norm(after - predicted), jnp.linalg.norm(before - predicted))
    left = jnp.linalg.norm(outside)
    explained = (left <= TOLERANCE * jnp.linalg.norm(predicted)) & (left <= 0.25 * missed)
    return moved & explained & jnp.all(jnp.isfinite(ends))


def jump_of(ends: Float[Array, "2 n"], linear: Float[Array, "2 n"]) -> Scalar:
    """What a jump between a point and the `ends` of a difference amounts to, where the `linear` model is right.

    The larger of two sums of squares: its height, by which the sum of squares jumps, and the square of the residual's
    jump, by the root of which no parameter moves more standard errors.
    """
    left = ends - linear
    height = jnp.abs(jnp.sum(left * (ends + linear), axis=-1))
    jump = jnp.max(jnp.maximum(height, jnp.sum(left**2, axis=-1)))
    return jnp.where(jnp.isfinite(jump), jump, jnp.inf)
