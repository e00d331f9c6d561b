"""Levenberg-Marquardt with scaled columns, between bounds, as an optimistix solver that checks itself.

Each step minimises the linear model exactly within the bounds and a trust region (`box_least_squares`),
whose radius follows the ratio of the decrease found to the decrease predicted as in MINPACK (J. J. Moré,
Lecture Notes in Mathematics 630, 1978).  As the radius shrinks the step turns into a short projected
gradient step, so that every limit is a point where the projected gradient vanishes (A. R. Conn, N. I. M.
Gould and P. L. Toint, Trust-Region Methods, SIAM 2000, chapter 12).  Columns are scaled to unit norm and
factored by QR.  A step to where the residual or its Jacobian is not finite is an ordinary rejection, and nothing is
linearised again on a rejection; after a step that found less than was predicted, or was rejected, the next ones are
bent along the curvature that a probe finds (geodesic acceleration: M. K. Transtrum and J. P. Sethna, arXiv:1201.5885).

It has converged where two things are small, and only there: the cosine between the residual and every
column that is free to move (MINPACK's test of the gradient), and the decrease that the linear model
predicts for its best step within the bounds.  The square of a cosine times the sum of squares is what the
best step in that one parameter would gain, so one threshold serves both.  At the end the Jacobian is
compared with differences of the residual (`derivative_check`).  Where they show a jump it has converged only if
that is too small to matter and leaves no more to be gained beyond it.
Every way to end has its own `Ending`.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jax import lax
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from ...core import Count, Scalar, ScalarLike, Tree, Truth, require_float64
from .box_least_squares import triangle
from .derivative_check import (
    AGREES,
    CHECKS,
    DIRECTIONS,
    DISCONTINUOUS,
    SIZES,
    WRONG,
    is_kink,
    jump_of,
    next_check,
    noise_scale,
    random_direction,
    scaled_direction,
)
from .lm_state import STOPPED, SUCCESSES, Auxiliary, Ending, LMState, Vector
from .trust_region import (
    Bounds,
    Trial,
    best_step,
    first_point,
    first_radius,
    flat_bounds,
    flat_function,
    next_radius,
    second_point,
    shortened,
    trial_point,
)

_AT_BOUND = 1e-9
"""So near to a bound, by the effect on the residual relative to that, a parameter counts as on it."""

_ROUNDING = 1e-13
"""Relative decrease of the sum of squares that rounding may hide."""

_STRAIGHT = 1e-6
"""Predicted decrease, relative to the sum of squares, below which steps are short enough to be straight."""

Point: TypeAlias = Any
"""The caller's parameters, a pytree of floating-point arrays; of a fit a `Vector`."""

ResidualFunction: TypeAlias = Callable[[Any, Any], tuple[Any, Auxiliary]]
"""(point, args) to the residuals and what goes with them."""

Arguments: TypeAlias = Any
"""Handed on to the function, a pytree; of a fit the weights of the records."""


class Judgement(NamedTuple):
    """The outcome of a trial step."""

    state: LMState
    """The state after it, if it is not accepted."""
    proposed: Vector
    accepted: Truth
    radius: Scalar
    gained: Scalar
    """Decrease of the sum of squares."""
    ratio: Scalar
    """Ratio of that decrease to the predicted one."""
    squares: Scalar


class BoundedLevenbergMarquardt(optx.AbstractLeastSquaresSolver[Tree, Tree, Auxiliary, LMState]):
    """Levenberg-Marquardt between bounds, for any residual, as a solver of `optimistix.least_squares`.

        solver = pdssjax.BoundedLevenbergMarquardt(rtol=1e-12)
        bounds = {"lower": 0.0, "upper": jnp.array([3.0, jnp.inf])}
        found = optimistix.least_squares(residual, solver, y0, args, options=bounds)
        found.value, Ending(int(found.stats["state"].ending))

    The point and the residuals are pytrees of floating-point arrays.  `options` may have "lower" and "upper", each a
    number or a pytree like the point; a parameter with equal bounds is held, and a start outside is moved to the
    bound.  Columns are scaled, so that the parameters' units do not matter.  `found.stats["state"]` has residual and
    Jacobian at the end, over the flattened point, and its `ending` (`pdssjax.inference.Ending`).

    The first step only evaluates the start, so that one compiled function does it all: proposed steps, the
    Jacobian, and the differences that it is compared with at the end.

    **Raises:** `InputError` for bounds that are not like the point, and where JAX works in single precision.
    """

    rtol: float = 1e-8
    """Converged where cosine squared and predicted reduction, relative to the sum of squares, are below this."""
    atol: float = 0.0
    """Decrease of the sum of squares below which a run has converged, too."""
    norm: Callable[[Vector], Scalar] = eqx.field(static=True, default=optx.max_norm)
    slow: float = 0.0
    """A step that lowers the sum of squares by less than this share, or than rounding may, is slow."""
    invisible: float = 0.0
    """Predicted reduction, relative to the sum of squares, that the data could not show."""
    small_jump: float = 0.0
    """Jump, relative to the sum of squares, that does not matter where a run ends at it."""
    most_slow_steps: int = eqx.field(static=True, default=20)
    """Slow steps in a row after which the run ends."""
    most_rejections: int = eqx.field(static=True, default=12)
    """Rejected steps in a row after which the run ends."""
    self_check: bool = eqx.field(static=True, default=True)
    """Compare the Jacobian with differences at the end."""

    def init(
        self,
        fn: ResidualFunction,
        y: Point,
        args: Arguments,
        options: Mapping[str, Tree],
        f_struct: Tree,
        aux_struct: Auxiliary,
        tags: frozenset[object],
    ) -> LMState:
        require_float64("BoundedLevenbergMarquardt")
        flat_bounds(y, options)  # says at once what is wrong with them
        y, _ = ravel_pytree(y)
        structs = jax.tree.leaves(f_struct)
        f_struct = jax.ShapeDtypeStruct((sum(s.size for s in structs),), jnp.result_type(*(s.dtype for s in structs)))
        blank = lambda s: jnp.zeros(s.shape, s.dtype)
        columns = lambda s: jnp.zeros((*s.shape, y.size), s.dtype)
        one, zero = jnp.ones(()), jnp.zeros((), int)
        return LMState(
            residual=blank(f_struct),
            jacobian=columns(f_struct),
            aux=jax.tree.map(blank, aux_struct),
            aux_jacobian=jax.tree.map(columns, aux_struct),
            upper=jnp.zeros((y.size, y.size)),
            projected=jnp.zeros_like(y),
            size=jnp.zeros_like(y),
            radius=jnp.inf * one,
            proposed_step=jnp.zeros_like(y),
            predicted_reduction=jnp.inf * one,
            cosine=one,
            rounding=0.0 * one,
            unevaluated=jnp.array(True),
            accepted=jnp.array(False),
            iterations=zero,
            evaluations=zero,
            rejected=zero,
            slow_steps=zero,
            ending=zero,
            curved=jnp.array(False),
            checked=zero,
            discrepancies=jnp.full((DIRECTIONS, len(SIZES)), jnp.inf),
            jump=0.0 * one,
            across=jnp.stack([y, y]),
        )

    def step(
        self,
        fn: ResidualFunction,
        y: Point,
        args: Arguments,
        options: Mapping[str, Tree],
        state: LMState,
        tags: frozenset[object],
    ) -> tuple[Point, LMState, Auxiliary]:
        bounds = flat_bounds(y, options)
        vector, unravel = ravel_pytree(y)
        vector = jnp.clip(vector, bounds["lower"], bounds["upper"])
        flat = flat_function(fn, unravel)
        trial = self.trial(vector, bounds, state)
        step, ends = _evaluated(flat, vector, args, bounds, state, trial)
        judged = self.judge(vector, bounds, state, trial, step, ends)
        move = lambda: self.moved_state(bounds, state, trial, judged, *linearised(flat, judged.proposed, args))
        after = lax.cond(judged.accepted, move, lambda: judged.state)
        return unravel(jnp.where(after.accepted, judged.proposed, vector)), after, after.aux

    def trial(self, y: Vector, options: Bounds, state: LMState) -> Trial:
        """The points that an iteration is about to evaluate."""
        # A straight step costs one evaluation; where one fell short, a bent one may be worth two, and those after it.
        checking = state.ending != Ending.RUNNING
        bending = ~checking & ~state.unevaluated & ((state.rejected > 0) | state.curved)
        proposal = best_step(state, y, options, state.size, state.radius)
        return Trial(proposal, jnp.stack(_difference_ends(state, y, options, self.atol)), checking, bending)

    def judge(
        self, y: Vector, options: Bounds, state: LMState, trial: Trial, step: Vector, ends: Float[Array, "2 n"]
    ) -> Judgement:
        """What the evaluations of a `trial` say of its `step`: the residuals at its probe and its end, or apart."""
        proposal, residual = trial.proposal, ends[1]
        proposed = jnp.where(state.unevaluated, y, trial_point(y, step, proposal, options))
        squares, predicted = jnp.sum(residual**2), proposal.predicted
        # Near the end the difference of two sums of squares would be lost in rounding.
        gained = jnp.sum((state.residual - residual) * (state.residual + residual))
        ratio = jnp.where(state.unevaluated, 0.5, gained / jnp.where(predicted > 0, predicted, 1.0))
        accepted = ~trial.checking & jnp.isfinite(squares) & (state.unevaluated | ((predicted > 0) & (ratio > 1e-4)))
        radius = next_radius(state, proposal, gained, squares, ratio)
        before = _counted(state, trial)
        after = lax.cond(
            trial.checking,
            lambda: self._with_comparison(before, ends, trial.apart, y),
            lambda: self._with_ending(_with_rejection(before, radius)),
        )
        return Judgement(after, proposed, accepted, radius, gained, ratio, squares)

    def moved_state(
        self, options: Bounds, state: LMState, trial: Trial, judged: Judgement, out: Tree, slopes: Tree
    ) -> LMState:
        """`state` after the step of a `trial` that was accepted, to where the function gives `out` with `slopes`."""
        proposal, before = trial.proposal, _counted(state, trial)

        def moved_with_slopes() -> LMState:
            slow = ~state.unevaluated & (judged.gained < jnp.maximum(self.slow * judged.squares, state.rounding))
            curved = (trial.bending | (judged.ratio < 0.75)) & (proposal.predicted > _STRAIGHT * judged.squares)
            moved = _with_slopes(before, judged.proposed, out, slopes)
            moved = moved._replace(
                radius=jnp.where(state.unevaluated, first_radius(moved, judged.proposed), judged.radius),
                accepted=jnp.array(True),
                rejected=jnp.zeros_like(state.rejected),
                slow_steps=jnp.where(slow, state.slow_steps + 1, 0),
                curved=~state.unevaluated & curved,
                iterations=state.iterations + ~state.unevaluated,
                unevaluated=jnp.array(False),
            )
            return _with_prediction(moved, judged.proposed, options)

        # A point without finite slopes is rejected like one without a finite value: no step can be planned from there.
        usable, rejection = jnp.all(jnp.isfinite(slopes[0])), _with_rejection(before, shortened(state, proposal))
        return self._with_ending(lax.cond(usable, moved_with_slopes, lambda: rejection))

    def _with_ending(self, state: LMState) -> LMState:
        squares = jnp.sum(state.residual**2)
        enough = jnp.maximum(self.rtol * squares, self.atol)
        flat = (state.predicted_reduction <= enough) & (state.cosine**2 * squares <= enough)
        insignificant = jnp.maximum(self.invisible, _ROUNDING) * squares
        insignificant = jnp.maximum(jnp.maximum(insignificant, enough), state.rounding)
        steep = state.cosine**2 * squares > insignificant
        invisible = (state.predicted_reduction <= insignificant) & ~steep
        rejected = state.rejected >= self.most_rejections
        slow = state.slow_steps >= self.most_slow_steps
        ending = jnp.where(slow, Ending.SLOW_STEPS, Ending.RUNNING)
        ending = jnp.where(rejected, jnp.where(steep, Ending.REJECTED, Ending.STALLED), ending)
        ending = jnp.where((slow | rejected) & invisible, Ending.WITHIN_ROUNDING, ending)
        ending = jnp.where(flat, Ending.CONVERGED, ending)
        ending = jnp.where(state.unevaluated, jnp.where(state.rejected > 0, Ending.START_FAILED, 0), ending)
        uncheckable = (ending == Ending.START_FAILED) | (not self.self_check)
        return state._replace(
            ending=ending.astype(state.ending.dtype), checked=jnp.where(uncheckable, CHECKS, state.checked)
        )

    def _with_comparison(
        self, state: LMState, ends: Float[Array, "2 n"], apart: Float[Array, "2 p"], y: Vector
    ) -> LMState:
        """`state` after one more comparison of the Jacobian with a difference; agreement skips the smaller size."""
        scale = noise_scale(state.residual, state.jacobian, y, self.atol)
        at = state.checked // len(SIZES), state.checked % len(SIZES)
        squares = jnp.sum(state.residual**2)
        small = jnp.maximum(self.small_jump * squares, self.atol)
        # What stopped a search so near to its end may be a jump that larger differences do not show.
        stopped = jnp.any(jnp.stack([state.ending == ending for ending in STOPPED]))
        thorough = stopped & (state.predicted_reduction <= small)
        linear = state.residual + (apart - y) @ state.jacobian.T
        error, verdict, following = next_check(
            state.checked, state.discrepancies[at[0]], ends[0] - ends[1], linear[0] - linear[1], scale, thorough
        )
        jump = jnp.maximum(state.jump, jnp.where(verdict == DISCONTINUOUS, jump_of(ends, linear), 0.0))
        # A step that promises more than the jump takes would have led over it.
        explained = state.predicted_reduction <= jnp.maximum(jump, self.invisible * squares)
        discontinuous = jnp.where(explained & (jump <= small), Ending.SMALL_JUMP, Ending.DISCONTINUITY)
        kinked = (verdict == WRONG) & is_kink(ends, linear, state.residual)
        verdict_ending = jnp.where(verdict == DISCONTINUOUS, discontinuous, Ending.WRONG_DERIVATIVE)
        verdict_ending = jnp.where(kinked, Ending.KINK, verdict_ending)
        final = (state.ending == Ending.DISCONTINUITY) | (state.ending == Ending.WRONG_DERIVATIVE)
        return state._replace(
            discrepancies=state.discrepancies.at[at].set(error),
            checked=following,
            jump=jump,
            across=jnp.where(kinked, apart, state.across),
            ending=jnp.where((verdict != AGREES) & ~final, verdict_ending, state.ending).astype(state.ending.dtype),
        )

    def terminate(
        self,
        fn: ResidualFunction,
        y: Point,
        args: Arguments,
        options: Mapping[str, Tree],
        state: LMState,
        tags: frozenset[object],
    ) -> tuple[Truth, optx.RESULTS]:
        over = self.is_over(state.ending, state.checked)
        success = jnp.any(jnp.stack([state.ending == ending for ending in SUCCESSES]))
        start_failed = state.ending == Ending.START_FAILED
        failed = optx.RESULTS.where(
            start_failed, optx.RESULTS.nonlinear_divergence, optx.RESULTS.nonlinear_max_steps_reached
        )
        return over, optx.RESULTS.where(over & ~success, failed, optx.RESULTS.successful)

    @staticmethod
    def is_over(ending: Count, checked: Count) -> Truth:
        """Whether a run has ended and its Jacobian has been compared with all differences."""
        return (ending != Ending.RUNNING) & (checked >= CHECKS)

    def postprocess(
        self,
        fn: ResidualFunction,
        y: Point,
        aux: Auxiliary,
        args: Arguments,
        options: Mapping[str, Tree],
        state: LMState,
        tags: frozenset[object],
        result: optx.RESULTS,
    ) -> tuple[Point, Auxiliary, dict[str, LMState]]:
        return y, aux, {"state": state}


def _evaluated(
    fn: ResidualFunction, y: Vector, args: Arguments, options: Bounds, state: LMState, trial: Trial
) -> tuple[Vector, Float[Array, "2 n"]]:
    """The step of a `trial`, and the residuals at its two points; in a loop, so that `fn` is compiled once."""

    def evaluate(first: Float[Array, " n"], is_last: Truth) -> tuple[Array, tuple[Vector, Array]]:
        step, at = second_point(y, options, state, trial, first)
        at = jnp.where(is_last, at, first_point(y, options, trial))
        found = lax.cond(is_last | trial.has_first, lambda: fn(at, args)[0], lambda: state.residual)
        return found, (step, found)

    _, (steps, ends) = lax.scan(evaluate, state.residual, jnp.array([False, True]))
    return steps[1], ends


def _counted(state: LMState, trial: Trial) -> LMState:
    return state._replace(accepted=jnp.array(False), evaluations=state.evaluations + jnp.where(trial.has_first, 2, 1))


def _with_rejection(state: LMState, radius: Scalar) -> LMState:
    """`state` after a rejection; that of a start that cannot be evaluated stays `unevaluated`."""
    return state._replace(radius=radius, rejected=state.rejected + 1)


def linearised(fn: ResidualFunction, y: Vector, args: Arguments) -> tuple[Tree, Tree]:
    """The outputs of the function, and the Jacobian of each of its two parts."""

    def both(y: Vector) -> tuple[Tree, Tree]:
        out = fn(y, args)
        return out, out

    slopes, out = jax.jacfwd(both, has_aux=True)(y)
    return out, slopes


def _with_slopes(state: LMState, y: Vector, out: Tree, slopes: Tree) -> LMState:
    (residual, aux), (jacobian, aux_jacobian) = out, slopes
    # A column that is rounding only would cause huge steps of its parameter, and keep the cosine from vanishing.
    reach = jnp.linalg.norm(jacobian, axis=0) * jnp.maximum(jnp.abs(y), 1.0)
    jacobian = jnp.where(reach > jnp.finfo(y.dtype).eps * jnp.linalg.norm(residual), jacobian, 0.0)
    size = jnp.maximum(jnp.linalg.norm(jacobian, axis=0), state.size)
    upper, projected = triangle(jacobian, residual)
    state = state._replace(residual=residual, jacobian=jacobian, aux=aux, aux_jacobian=aux_jacobian)
    return state._replace(size=size, upper=upper, projected=projected)


def _with_prediction(state: LMState, y: Vector, options: Bounds) -> LMState:
    """`state` with the best step within the bounds, its predicted reduction, and the cosines."""
    norms = jnp.linalg.norm(state.jacobian, axis=0)
    best = best_step(state, y, options, norms, jnp.inf * jnp.ones(()))
    norm = jnp.linalg.norm(state.residual)
    gradient = state.upper.T @ state.projected
    cosines = jnp.abs(gradient) / jnp.maximum(norms * norm, 1e-300)
    near = _AT_BOUND * norm / jnp.maximum(norms, 1e-300)
    blocked = (y - options["lower"] <= near) & (gradient > 0) | (options["upper"] - y <= near) & (gradient < 0)
    blocked |= options["lower"] >= options["upper"]
    return state._replace(
        proposed_step=best.step,
        # Below zero only by rounding; one far below would be that of a step gone wrong, and no sign of an end.
        predicted_reduction=jnp.abs(best.predicted),
        cosine=jnp.max(jnp.where(blocked, 0.0, cosines), initial=0.0),
        # Parameters and residual gather some four relative rounding errors.
        rounding=4.0 * jnp.finfo(y.dtype).eps * norm * jnp.linalg.norm(norms * y),
    )


def _difference_ends(state: LMState, y: Vector, options: Bounds, atol: ScalarLike) -> list[Vector]:
    scale = noise_scale(state.residual, state.jacobian, y, atol)
    free = (y > options["lower"]) & (y < options["upper"]) & (options["lower"] < options["upper"])
    random = random_direction(state.jacobian, y, free, scale)
    proposed = scaled_direction(state.proposed_step, state.jacobian, y, scale)
    size = jnp.asarray(SIZES)[state.checked % len(SIZES)]
    move = size * jnp.where(state.checked < len(SIZES), random, proposed)
    return [jnp.clip(y + way * move, options["lower"], options["upper"]) for way in (1.0, -1.0)]
