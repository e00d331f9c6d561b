"""Levenberg-Marquardt with scaled columns and bounds, as an optimistix solver.

Against optimistix's own: the damping acts on columns of unit norm (J. J. Moré, Lecture
Notes in Mathematics 630, 1978), parameters may be bounded (projected step; a parameter held
at its bound leaves the linear problem), a trial that is not finite is an ordinary rejection,
nothing is linearised again on a rejection, and the fit ends where another step could not
change the cost by a statistically visible amount.  Steps are bent along the curved valleys
that poorly determined parameters make (geodesic acceleration: M. K. Transtrum and J. P.
Sethna, arXiv:1201.5885), at the price of one more evaluation each.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jax import lax
from jaxtyping import Array, Float

_PROBE = 0.1
"""Share of the step at which the curvature of the residuals is probed."""
_BEND = 0.75
"""Longest bend of a step relative to the step itself; a larger one means the step is too long."""


_NEXT_TO_NOTHING = 1e-13
"""Damping that only keeps directions without information out of the undamped step."""


class LMState(NamedTuple):
    """The carry between iterations."""

    residual: Float[Array, " n"]
    jacobian: Float[Array, "n p"]
    aux: Any
    aux_jacobian: Any
    """Of the function's auxiliary output, which costs nothing extra."""
    size: Float[Array, " p"]
    """Largest norm seen of each column."""
    damping: Float[Array, ""]
    growth: Float[Array, ""]
    expected: Float[Array, ""]
    """Relative decrease of the sum of squares that an undamped step promises."""
    fresh: Any
    """Nothing has been evaluated yet: the first step takes the start as it is."""
    accepted: Any
    iterations: Any
    """Linearisations after the first."""
    rejected: Any
    """Trials rejected in a row."""
    crawls: Any
    """Accepted steps in a row that hardly lowered the sum of squares."""


class BoundedLevenbergMarquardt(optx.AbstractLeastSquaresSolver):
    """`options = {"lower": ..., "upper": ...}`; a parameter with equal bounds is held.

    The first step only evaluates the start, so that one compiled function does it all.
    """

    rtol: float = 1e-8
    """Ends where an undamped step promises to lower the sum of squares by less than this share."""
    atol: float = 0.0
    """Ends also where it promises to lower the sum of squares by less than this."""
    norm: Any = eqx.field(static=True, default=optx.max_norm)
    crawl: float = 0.0
    """A step that lowers the sum of squares by less than this share crawls."""
    most_crawls: int = eqx.field(static=True, default=5)
    """In a row; then the fit has come as far as it gets: a valley flat beyond the data's power to tell."""
    most_rejections: int = eqx.field(static=True, default=12)
    """In a row; then the fit has stalled."""

    def init(self, fn, y, args, options, f_struct, aux_struct, tags) -> LMState:
        blank = lambda s: jnp.zeros(s.shape, s.dtype)
        columns = lambda s: jnp.zeros((*s.shape, y.size), s.dtype)
        one, none = jnp.ones(()), jnp.zeros((), int)
        return LMState(
            residual=blank(f_struct),
            jacobian=columns(f_struct),
            aux=jax.tree.map(blank, aux_struct),
            aux_jacobian=jax.tree.map(columns, aux_struct),
            size=jnp.zeros_like(y),
            damping=1e-4 * one,
            growth=2.0 * one,
            expected=jnp.inf * one,
            fresh=jnp.array(True),
            accepted=jnp.array(False),
            iterations=none,
            rejected=none,
            crawls=none,
        )

    def step(self, fn, y, args, options, state, tags):
        velocity, promised, solve = _damped_step(state, y, options)

        def evaluate(carry, probing):
            """First a probe a little way along the step, then the trial, bent as the probe says."""
            step, _ = carry
            at = jnp.where(probing, y + _PROBE * velocity, y + step)
            at = jnp.where(state.fresh, y, jnp.clip(at, options["lower"], options["upper"]))
            found = fn(at, args)[0]
            turn = (found - state.residual) / _PROBE - state.jacobian @ velocity
            bend = -solve(jnp.where(jnp.isfinite(turn), turn, 0.0) / _PROBE)
            fits = _length(bend, state) <= _BEND * _length(velocity, state)
            bent = jnp.where(probing & fits, velocity + bend, step)
            return (bent, found), None

        (step, residual), _ = lax.scan(evaluate, (velocity, state.residual), jnp.array([True, False]))
        trial = jnp.where(state.fresh, y, jnp.clip(y + step, options["lower"], options["upper"]))
        before, after = jnp.sum(state.residual**2), jnp.sum(residual**2)
        ratio = jnp.where(state.fresh, 0.5, (before - after) / jnp.where(promised > 0, promised, 1.0))
        worth = state.fresh | ((promised > 0) & (ratio > 1e-4))
        accepted = jnp.isfinite(after) & worth

        def move(state):
            moved = _linearised(fn, trial, args, state)
            shrink = jnp.maximum(0.1, 1.0 - (2.0 * ratio - 1.0) ** 3)
            moved = moved._replace(
                damping=jnp.where(state.fresh, state.damping, jnp.maximum(state.damping * shrink, 1e-14)),
                growth=2.0 * jnp.ones(()),
                rejected=jnp.zeros_like(state.rejected),
                crawls=jnp.where(~state.fresh & (before - after < self.crawl * after), state.crawls + 1, 0),
            )
            return moved._replace(expected=_promise(moved, trial, options))

        def stay(state):
            return state._replace(
                damping=state.damping * state.growth, growth=2.0 * state.growth, rejected=state.rejected + 1
            )

        iterations = state.iterations + (accepted & ~state.fresh)
        state = lax.cond(accepted, move, stay, state)
        # A start that cannot be simulated stays fresh: there is nothing to go on from.
        state = state._replace(accepted=accepted, iterations=iterations, fresh=state.fresh & ~accepted)
        return jnp.where(accepted, trial, y), state, state.aux

    def terminate(self, fn, y, args, options, state, tags):
        begun = ~(state.fresh & (state.rejected == 0))
        lost = begun & state.fresh
        stalled = state.rejected >= self.most_rejections
        # Near the optimum rounding in the simulation can deny what a tiny step promises.
        enough = jnp.maximum(self.rtol, self.atol / jnp.maximum(jnp.sum(state.residual**2), 1e-300))
        done = (state.expected <= enough) | (stalled & (state.expected <= 1e3 * enough))
        done = ~state.fresh & (done | (state.crawls >= self.most_crawls))
        failed = optx.RESULTS.where(lost, optx.RESULTS.nonlinear_divergence, optx.RESULTS.nonlinear_max_steps_reached)
        over = done | lost | stalled
        return over, optx.RESULTS.where(over & ~done, failed, optx.RESULTS.successful)

    def postprocess(self, fn, y, aux, args, options, state, tags, result):
        return y, aux, {"state": state}


def _linearised(fn, y, args, state):
    def both(y):
        out = fn(y, args)
        return out, out

    (jacobian, aux_jacobian), (residual, aux) = jax.jacfwd(both, has_aux=True)(y)
    usable = jnp.all(jnp.isfinite(jacobian))
    jacobian = jnp.where(usable, jacobian, state.jacobian)
    size = jnp.maximum(jnp.linalg.norm(jacobian, axis=0), state.size)
    return state._replace(residual=residual, jacobian=jacobian, aux=aux, aux_jacobian=aux_jacobian, size=size)


def _scaled(state, y, options):
    """Gradient and normal matrix in columns of unit norm, without the parameters that are held."""
    size = jnp.where(state.size > 0, state.size, 1.0)
    jacobian = state.jacobian / size
    gradient = jacobian.T @ state.residual
    held = (options["lower"] >= options["upper"]) | (state.size == 0)
    held |= (y <= options["lower"]) & (gradient > 0) | (y >= options["upper"]) & (gradient < 0)
    free = jnp.where(held, 0.0, 1.0)
    matrix = (jacobian.T @ jacobian) * free[:, None] * free[None, :]
    return gradient * free, matrix, free, size


def _bounded_step(gradient, matrix, free, damping, low, high):
    """The damped step of the linear model within bounds, and which parameters were free to take part.

    Where a step leads out, that parameter goes to its bound and the others are solved for
    anew, as often as there are parameters.
    """

    def again(_, carry):
        step, loose = carry
        out = (step < low) | (step > high)
        loose = loose * jnp.where(out, 0.0, 1.0)
        fixed = jnp.where(loose > 0, 0.0, jnp.clip(step, low, high))
        damped = matrix * loose[:, None] * loose[None, :] + jnp.diag(1.0 - loose + damping)
        return fixed - jnp.linalg.solve(damped, (gradient + matrix @ fixed) * loose) * loose, loose

    step, loose = lax.fori_loop(0, gradient.size + 1, again, (jnp.zeros_like(gradient), free))
    return jnp.clip(step, low, high), loose


def _damped_step(state, y, options):
    """The step, the decrease of the sum of squares that the linear model promises for it,
    and the damped pseudo-inverse that it came from."""
    gradient, matrix, free, size = _scaled(state, y, options)
    low, high = (options["lower"] - y) * size, (options["upper"] - y) * size
    step, loose = _bounded_step(gradient, matrix, free, state.damping, low, high)
    damped = matrix * loose[:, None] * loose[None, :] + jnp.diag(1.0 - loose + state.damping)

    def solve(residual):
        return jnp.linalg.solve(damped, loose * (state.jacobian.T @ residual / size)) * loose / size

    return step / size, _decrease(gradient, matrix, step), solve


def _decrease(gradient, matrix, step):
    return -(2.0 * gradient @ step + step @ matrix @ step)


def _length(step, state):
    return jnp.linalg.norm(step * state.size)


def _promise(state, y, options):
    """Relative decrease of the sum of squares by an undamped step in the directions that matter."""
    gradient, matrix, free, size = _scaled(state, y, options)
    low, high = (options["lower"] - y) * size, (options["upper"] - y) * size
    step, _ = _bounded_step(gradient, matrix, free, _NEXT_TO_NOTHING, low, high)
    return _decrease(gradient, matrix, step) / jnp.maximum(jnp.sum(state.residual**2), 1e-300)
