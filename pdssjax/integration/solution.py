"""Event-located integration of a hybrid system on one-step solvers, with right gradients.

The system is smooth in each of its modes.  A step never leaves the mode it began in: where
the guard falls through zero within a step, the step is cut there, and the next begins in
the mode that follows.  Corners of the drive cut steps in the same way.

Gradients.  The sequence of steps (the forward pass) is found without derivatives.  Its tangents
follow afterwards: every step is linearised about its own start, all of them side by side,
and a linear recurrence joins them.  The end of a step at an event or a corner moves with
the parameters by dt* = -dg / (dg/dt); since the local time is part of the state, the state
moves along the field by that much, and what the field does after the switch follows in the
next step.  This is the saltation matrix, without writing it down (P. C. Müller, Chaos,
Solitons & Fractals 5(9), 1995).  The recurrence is an ordinary linear scan, so forward
and reverse mode both work.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ..core import Count, Scalar, ScalarLike, Truth
from .accuracy import Accuracy
from .polynomials import horner
from .sensitivities import differentiable_steps
from .system import AbstractHybridSystem, State, Visited, unflattener


class Steps(NamedTuple):
    """The steps of a run, in order; the first axis has room to spare."""

    index: Float[Array, " room"]  # pyright: ignore[reportIncompatibleMethodOverride]
    """Segment of the drive, counted from 0."""
    mode: Float[Array, " room"]
    step_radius: Float[Array, " room"]
    """Length for which the polynomials were made [s]."""
    duration: Float[Array, " room"]
    """Length for which they are used: up to an event, a corner or the reach [s]."""
    origin: Float[Array, " room"]
    """Time at which the segment begins [s]."""
    t_local: Float[Array, " room"]
    """Local time at which the step begins, from the corner on [s]."""
    x: Float[Array, "room components"]
    """State at the beginning."""
    polynomials: Float[Array, "room kept coefficients"]
    """Of the components kept, in (time - begin)/step_radius, lowest first."""


class End(NamedTuple):
    """Where the integration stopped."""

    time: Scalar
    """[s]"""
    x: Float[Array, " components"]
    """State."""


class Solution(NamedTuple):
    """All that a run leaves behind."""

    steps: Steps
    end: End
    period: Count
    """Step with which the last period of the drive began."""
    repeats: Truth
    """From `end` on the motion repeats that period."""
    count: Count  # pyright: ignore[reportIncompatibleMethodOverride]
    """Steps accepted."""
    rejected: Count
    events: Count
    """Switches of the mode that were located."""
    failure: Count
    """Index into `failure.FAILURES`; 0 where the integration finished."""


def integrate(
    system: AbstractHybridSystem, horizon: ScalarLike, accuracy: Accuracy, keep: tuple[int, ...] | None = None
) -> Solution:
    """Integrates `system` from its initial state at t = 0 to `horizon` [s].

    Differentiable in every floating-point leaf of `system`, but not in `horizon`.  `keep`
    names the components of the state wanted between the steps, all by default: fewer
    spare memory and time.
    """
    keep = tuple(range(len(jax.tree.leaves(system.initial())))) if keep is None else keep
    horizon = lax.stop_gradient(jnp.asarray(horizon, float))
    begins, end, polynomials, known_and_loop = differentiable_steps(
        system, horizon=horizon, accuracy=accuracy, keep=keep
    )
    known, loop = known_and_loop
    steps = Steps(**known, origin=begins[:, 0], t_local=begins[:, 1], x=begins[:, 2:], polynomials=polynomials)
    return Solution(
        steps,
        End(end[0] + end[1], end[2:]),
        loop.period,
        loop.repeats,
        loop.count,
        loop.rejected,
        loop.events,
        loop.failure,
    )


def states_at(
    system: AbstractHybridSystem, run: Solution, times: Float[Array, " m"], keep: tuple[int, ...] | None = None
) -> Visited:
    """The state at `times` [s], shape (m,), each within the integrated time or its repetition.

    Components outside `keep`, as given to `integrate`, are those of the step's beginning unless the
    system knows them in closed form.
    """
    steps = run.steps
    start = steps.origin[run.period]
    stop, x_stop = run.end
    cycle = jnp.where(run.repeats, stop - start, 1.0)
    laps = jnp.where(run.repeats, jnp.maximum(jnp.floor((times - stop) / cycle) + 1.0, 0.0), 0.0)
    laps = lax.stop_gradient(laps)
    within = times - laps * cycle
    begins = steps.origin + steps.t_local
    real = jnp.arange(begins.shape[0]) < run.count
    ordered = jnp.where(real, lax.stop_gradient(begins), jnp.inf)
    j = jnp.clip(jnp.searchsorted(ordered, lax.stop_gradient(within), side="right") - 1, 0)
    elapsed = jnp.maximum(within - begins[j], 0.0)
    polynomials = steps.polynomials[j]
    unflatten = unflattener(system)
    degree = polynomials.shape[-1]
    shown = horner([polynomials[:, :, k] for k in range(degree)], elapsed[:, None])
    values = shown if keep is None else steps.x[j].at[:, jnp.array(keep)].set(shown)
    gained = (x_stop - steps.x[run.period]) * laps[:, None]

    def finish(
        index: Scalar,
        t_local: Scalar,
        begin: Float[Array, " components"],
        elapsed: Scalar,
        end: Float[Array, " components"],
    ) -> State:
        return system.exact(system.segment(index), t_local, unflatten(begin), elapsed, unflatten(end))

    x = jax.vmap(finish)(steps.index[j], steps.t_local[j], steps.x[j], elapsed, values)
    x = jax.tree.map(jnp.add, x, jax.vmap(unflatten)(gained))
    segment = jax.vmap(system.segment)(steps.index[j])
    return Visited(x, segment, steps.t_local[j] + elapsed, steps.mode[j])
