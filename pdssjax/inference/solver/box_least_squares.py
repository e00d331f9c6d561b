"""Linear least squares between bounds and within a radius: what a bounded Levenberg-Marquardt step is made of.

Minimises ||R x + q||^2 + damping ||x||^2 over low <= x <= high with an active set (P. B. Stark and
R. L. Parker, Computational Statistics 10, 129, 1995): the unknowns strictly inside are solved for by QR,
a bound met on the way is kept, one whose multiplier has the wrong sign is released.  Every pass lowers
the objective, so that no set comes twice and the method ends.  R is the triangle of a QR factorisation
of the Jacobian; forming J'J would square its condition number.

The damping that keeps the solution within a radius is found by Newton's method on the reciprocal of its
norm (J. J. Moré, Lecture Notes in Mathematics 630, 1978); the norm falls as the damping grows, with
bounds too, because the set is convex.
"""

from typing import NamedTuple, TypeAlias

import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.scipy.linalg import solve_triangular
from jaxtyping import Array, Bool, Float

from ...core import Count, Scalar, Truth
from .lm_state import Vector

_TOLERANCE = 0.1
"""Relative tolerance of the norm of a solution that the radius limits."""


class BoxSolution(NamedTuple):
    """The minimum of a linear least-squares problem between bounds."""

    x: Vector
    at_low: Bool[Array, " p"]
    """Unknowns held at their lower bound."""
    at_high: Bool[Array, " p"]
    """Unknowns held at their upper bound."""
    factor: Float[Array, "p p"]
    """Upper triangle F, F'F = R'R + damping for the unknowns inside, unit rows for those held."""


Search: TypeAlias = tuple[Scalar, Scalar, Scalar, BoxSolution, Count]
"""The damping, its lower and upper limit so far, its solution, and the number of dampings tried."""


class _Pass(NamedTuple):
    x: Vector
    at_low: Bool[Array, " p"]
    at_high: Bool[Array, " p"]
    factor: Float[Array, "p p"]
    done: Truth
    passes: Count


def triangle(jacobian: Float[Array, "n p"], residual: Float[Array, " n"]) -> tuple[Float[Array, "p p"], Vector]:
    """R, shape (p, p), and q = Q'r, shape (p,), of a Jacobian's QR factorisation; fewer rows will do."""
    n, p = jacobian.shape
    stacked = jnp.pad(jnp.column_stack([jacobian, residual]), ((0, max(p + 1 - n, 0)), (0, 0)))
    upper = jnp.linalg.qr(stacked, mode="r")  # of which the last column is Q'r: Q itself is not needed
    return upper[:p, :p], upper[:p, p]


def solve_in_ball_and_box(
    upper: Float[Array, "p p"], projected: Vector, radius: Scalar, low: Vector, high: Vector
) -> BoxSolution:
    """Solve as `solve_in_box` does, with enough damping to keep ||x|| to within a tenth of `radius`."""
    steepest = jnp.linalg.norm(upper.T @ projected)
    # So small that it only leaves out directions without information (`covariance.NO_INFORMATION`).
    least = 1e-16 * jnp.ones(())

    def is_unfinished(carry: Search) -> Truth:
        damping, _, _, found, count = carry
        norm = jnp.linalg.norm(found.x)
        enough = (norm <= radius * (1.0 + _TOLERANCE)) & ((norm >= radius * (1.0 - _TOLERANCE)) | (damping <= least))
        return ~enough & (count < 20)

    def next_damping(carry: Search) -> Search:
        damping, low_end, high_end, found, count = carry
        norm = jnp.linalg.norm(found.x)
        low_end = jnp.where(norm > radius, jnp.maximum(low_end, damping), low_end)
        high_end = jnp.where(norm < radius, jnp.minimum(high_end, damping), high_end)
        inside = found.x * ~(found.at_low | found.at_high)
        weighted = jnp.linalg.norm(solve_triangular(found.factor, inside, trans=1))
        newton = damping + (norm - radius) / radius * (norm / jnp.maximum(weighted, 1e-300)) ** 2
        safe = (newton > low_end) & (newton < high_end)
        damping = jnp.where(safe, newton, jnp.sqrt(low_end * high_end))
        return damping, low_end, high_end, solve_in_box(upper, projected, damping, low, high), count + 1

    first = solve_in_box(upper, projected, least, low, high)
    # The norm is at most the gradient's over the damping.
    begin = (least, least, jnp.maximum(2.0 * steepest / radius, 4.0 * least), first, jnp.zeros((), int))
    return lax.while_loop(is_unfinished, next_damping, begin)[3]


def solve_in_box(
    upper: Float[Array, "p p"], projected: Vector, damping: Float[Array, ""], low: Vector, high: Vector
) -> BoxSolution:
    """The minimum of ||upper x + projected||^2 + damping ||x||^2 over low <= x <= high, where low <= 0 <= high.

    Columns of `upper` are expected with norms of order one; `damping` must be positive where one of them
    vanishes.  An unknown with `low` equal to `high` stays at 0.
    """
    gradient = upper.T @ projected
    held = low >= high
    at_low = held | ((low >= 0.0) & (gradient > 0.0))
    begin = _Pass(
        x=jnp.zeros_like(projected),
        at_low=at_low,
        at_high=(high <= 0.0) & (gradient < 0.0) & ~at_low,
        factor=jnp.eye(projected.size, dtype=upper.dtype),
        done=jnp.array(False),
        passes=jnp.zeros((), int),
    )
    # The size of a multiplier, relative to the residual, from which it counts; columns have unit norm.
    tolerance = 1e-12 * jnp.linalg.norm(projected)

    def is_unfinished(state: _Pass) -> Truth:
        # Each pass stops or releases one unknown.
        return ~state.done & (state.passes < 4 * projected.size + 4)

    def one_pass(state: _Pass) -> _Pass:
        inside = ~(state.at_low | state.at_high)
        # The minimum over the unknowns inside, the others staying where they are.
        weight, fixed = jnp.where(inside, 1.0, 0.0), jnp.where(inside, 0.0, state.x)
        rows = jnp.concatenate([upper * weight, jnp.diag(jnp.where(inside, jnp.sqrt(damping), 1.0))])
        basis, factor = jnp.linalg.qr(rows)
        found = -solve_triangular(factor, basis[: projected.size].T @ (projected + upper @ fixed))
        target = jnp.where(inside & jnp.isfinite(found), found, state.x)
        # The largest share of the step that stays between the bounds, and the unknowns that it stops at one.
        step, below, above = target - state.x, inside & (target < low), inside & (target > high)
        safe = jnp.where(step == 0.0, 1.0, step)
        shares = jnp.where(below, (low - state.x) / safe, jnp.where(above, (high - state.x) / safe, 1.0))
        shares = jnp.clip(shares, 0.0, 1.0)
        share = jnp.min(shares)
        blocked_low, blocked_high = below & (shares <= share), above & (shares <= share)
        x = jnp.where(inside, state.x + share * step, state.x)
        x = jnp.where(blocked_low, low, jnp.where(blocked_high, high, x))
        slope = upper.T @ (upper @ x + projected) + damping * x
        wrong = jnp.where(state.at_low & ~held, -slope, jnp.where(state.at_high & ~held, slope, 0.0))
        release = (share >= 1.0) & (wrong == jnp.max(wrong)) & (wrong > tolerance)
        return _Pass(
            x=x,
            at_low=(state.at_low | blocked_low) & ~release,
            at_high=(state.at_high | blocked_high) & ~release,
            factor=factor,
            done=(share >= 1.0) & ~jnp.any(release),
            passes=state.passes + 1,
        )

    end = lax.while_loop(is_unfinished, one_pass, begin)
    return BoxSolution(end.x, end.at_low, end.at_high, end.factor)


def nonnegative_least_squares(
    columns: Float[np.ndarray, "n q"], target: Float[np.ndarray, " n"], signed: Bool[np.ndarray, " q"]
) -> tuple[Float[np.ndarray, " q"], float]:
    """The x that minimises ||columns x - target||^2, nonnegative but where `signed`, and that minimum."""
    from scipy.optimize import lsq_linear  # few runs need it, and its import takes a third of a second

    norms = np.linalg.norm(columns, axis=0)
    norms = np.where(norms > 0.0, norms, 1.0)
    reduced = np.asarray(np.linalg.qr(np.column_stack([columns / norms, target]), mode="r"))
    least = np.where(signed, -np.inf, 0.0)
    found = lsq_linear(reduced[:, :-1], reduced[:, -1], (least, np.inf), method="bvls")
    x = np.maximum(found.x, least) / norms  # rounding may have left one just below
    return x, float(np.sum((columns @ x - target) ** 2))
