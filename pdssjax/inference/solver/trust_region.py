"""Steps of a bounded Levenberg-Marquardt run: the best one within bounds and a radius, its bend, the next radius.

`state` is the run's carry.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jax.scipy.linalg import solve_triangular
from jaxtyping import Array, Float

from ...core import InputError, Scalar, ScalarLike, Tree, Truth
from .box_least_squares import BoxSolution, solve_in_ball_and_box
from .lm_state import LMState, Vector

PROBE = 0.1
"""Share of the step at which the curvature of the residuals is probed."""

_SMALLEST_SHARE = 0.1
"""Least ratio of the radius after a bad step to the one before."""

Bounds: TypeAlias = Mapping[str, Float[Array | np.ndarray, " p"]]
"""Bounds of the parameters: "lower" and "upper"."""


class Proposal(NamedTuple):
    """A step of the linear model within the bounds, in the parameters' own units."""

    step: Vector
    predicted: Float[Array, ""]
    """Decrease of the sum of squares that the linear model predicts for it."""
    norm: Float[Array, ""]
    """In columns of unit norm."""
    slope: Float[Array, ""]
    """Derivative of the sum of squares along it."""
    solution: BoxSolution
    """The box problem's solution that the step comes from."""


def best_step(state: LMState, y: Vector, options: Bounds, size: Vector, radius: Scalar) -> Proposal:
    """The best step of the linear model within the bounds and a trust region, columns divided by `size`."""
    held = (options["lower"] >= options["upper"]) | (size == 0)
    size = jnp.where(size > 0, size, 1.0)
    upper = state.upper / size
    low, high = (jnp.where(held, 0.0, (options[end] - y) * size) for end in ("lower", "upper"))
    found = solve_in_ball_and_box(upper, state.projected, radius, low, high)
    change = upper @ found.x
    slope = 2.0 * state.projected @ change
    return Proposal(found.x / size, -slope - change @ change, jnp.linalg.norm(found.x), slope, found)


def first_radius(state: LMState, y: Vector) -> Scalar:
    """The first radius: steps are no longer than the parameters themselves."""
    norm = jnp.linalg.norm(state.size * y)
    return jnp.where(norm > 0, norm, jnp.maximum(jnp.linalg.norm(state.size), 1e-300))


def next_radius(state: LMState, proposal: Proposal, gained: Scalar, squares: Scalar, ratio: Scalar) -> Scalar:
    """The next radius by MINPACK's rule: twice a good step, a tenth to a half of a bad one."""
    before = jnp.sum(state.residual**2)
    # The minimum of the parabola through both values with the slope at the start.
    turning = 0.5 * proposal.slope / jnp.where(proposal.slope + gained < 0, proposal.slope + gained, -jnp.inf)
    shorter = jnp.where(gained >= 0.0, 0.5, jnp.clip(turning, _SMALLEST_SHARE, 0.5))
    shorter = jnp.where(jnp.isfinite(squares) & (squares < 100.0 * before), shorter, _SMALLEST_SHARE)
    reduced = shortened(state, proposal, shorter)
    grown = jnp.where(ratio >= 0.75, jnp.maximum(state.radius, 2.0 * proposal.norm), state.radius)
    return jnp.where(ratio > 0.25, grown, reduced)


def shortened(state: LMState, proposal: Proposal, factor: ScalarLike = _SMALLEST_SHARE) -> Scalar:
    """The radius after a bad step: a part of the step's length, by default the least."""
    return factor * jnp.minimum(state.radius, 10.0 * proposal.norm)


def bend(state: LMState, proposal: Proposal, probed: Float[Array, " n"]) -> Vector:
    """The second-order correction of a step, by the curvature that a probe along it shows."""
    size, solution = jnp.where(state.size > 0, state.size, 1.0), proposal.solution
    turn = (probed - state.residual) / PROBE - state.jacobian @ proposal.step
    turn = jnp.where(jnp.isfinite(turn), turn, 0.0) / PROBE
    right = (state.jacobian.T @ turn) / size * ~(solution.at_low | solution.at_high)
    bent = -solve_triangular(solution.factor, solve_triangular(solution.factor, right, trans=1)) / size
    norm = lambda step: jnp.linalg.norm(step * state.size)
    # A larger bend means that the step is too long.
    return jnp.where(norm(bent) <= 0.75 * norm(proposal.step), bent, 0.0)


def trial_point(y: Vector, step: Vector, proposal: Proposal, options: Bounds) -> Vector:
    """Where a step leads, exactly on the bounds that it keeps to."""
    lower, upper = options["lower"], options["upper"]
    to = jnp.clip(y + step, lower, upper)
    moves = proposal.step != 0.0
    to = jnp.where(proposal.solution.at_low & moves, lower, to)
    return jnp.where(proposal.solution.at_high & moves, upper, to)


class Trial(NamedTuple):
    """What an iteration evaluates: the end of its step, before it a probe if the step bends; after a run's end, the two
    points of a difference."""

    proposal: Proposal
    apart: Float[Array, "2 p"]
    """The two points of which the difference is compared with the Jacobian."""
    checking: Truth
    """The run has ended."""
    bending: Truth

    @property
    def has_first(self) -> Truth:
        """Whether there is a first point: a probe or one end of a difference."""
        return self.bending | self.checking


def first_point(y: Vector, options: Bounds, trial: Trial) -> Vector:
    """The point that is evaluated first, where `trial.has_first`."""
    probe = jnp.clip(y + PROBE * trial.proposal.step, options["lower"], options["upper"])
    return jnp.where(trial.checking, trial.apart[0], probe)


def second_point(
    y: Vector, options: Bounds, state: LMState, trial: Trial, first: Float[Array, " n"]
) -> tuple[Vector, Vector]:
    """The step, bent as the `first` residual says, and the point that is evaluated last."""
    proposal = trial.proposal
    bent = jnp.where(trial.bending, proposal.step + bend(state, proposal, first), proposal.step)
    at = jnp.where(trial.checking, trial.apart[1], trial_point(y, bent, proposal, options))
    return bent, jnp.where(state.unevaluated, y, at)


def flat_bounds(y: Tree, options: Mapping[str, Tree]) -> Bounds:
    """The "lower" and "upper" of `options` as vectors; one that is left out is infinite.

    **Arguments:** each is a number for all of the point `y`, or a pytree of the structure of `y` whose leaves
    broadcast to those of `y`.

    **Raises:** `InputError` for another key, and for bounds of another structure or shape.
    """
    if others := set(options) - {"lower", "upper"}:
        raise InputError(f'options: found the key {min(others)!r}, expected "lower" and "upper", the bounds.')
    leaves, structure = jax.tree.flatten(y)
    out = {}
    for name, end in ({"lower": -jnp.inf, "upper": jnp.inf} | dict(options)).items():
        given, form = jax.tree.flatten(end)
        if form != structure and len(given) == 1 and jnp.ndim(given[0]) == 0:
            given, form = given * len(leaves), structure
        if form != structure:
            raise InputError(
                f'options["{name}"]: found the structure {form}, expected a number or {structure}, as of y0.'
            )
        filled = []
        for bound, leaf in zip(given, leaves, strict=True):
            try:
                filled.append(jnp.broadcast_to(jnp.asarray(bound, leaf.dtype), leaf.shape))
            except ValueError:
                expected = f"expected {leaf.shape}, as of y0."
                raise InputError(f'options["{name}"]: found shape {jnp.shape(bound)}, {expected}') from None
        out[name], _ = ravel_pytree(filled)
    return out


def flat_function(fn: Callable[[Tree, Tree], Tree], unravel: Callable[[Tree], Tree]) -> Callable[[Tree, Tree], Tree]:
    """`fn` as a function of the vector that `unravel` makes a point of, with its residuals as one vector."""

    def flat(y: Tree, args: Tree) -> Tree:
        out, aux = fn(unravel(y), args)
        return ravel_pytree(out)[0], aux

    return flat
