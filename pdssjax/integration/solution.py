"""Event-located integration of a hybrid system on one-step solvers, with right gradients.

The system is smooth in each of its modes.  A step never leaves the mode it began in: where
the guard falls through zero within a step, the step is cut there, and the next begins in
the mode that follows.  Corners of the drive cut steps in the same way.

Gradients.  The sequence of steps (the forward pass) is found without derivatives.  Afterwards every step is
linearised about its own start, and a linear recurrence joins the steps.  The end of a step at an event or a corner
moves with the parameters by dt* = -dg / (dg/dt); since the local time is part of the state, the state
moves along the field by that much, and the field after the switch enters in the
next step (at once, in what is left of a ringing).  This is the saltation matrix, without
writing it down (P. C. Müller, Chaos, Solitons & Fractals 5(9), 1995).
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from ..core import Count, Scalar, ScalarLike, Truth
from .accuracy import Accuracy
from .differentiated_run import RunExtent, differentiable_run, locate_times, time_since_starts
from .polynomials import horner
from .step_table import LoopState
from .system import AbstractHybridSystem, SampledStates, State, unflattener


class Steps(NamedTuple):
    """The steps of a run, in order; the first axis has room to spare."""

    index: Float[Array, " room"]  # pyright: ignore[reportIncompatibleMethodOverride]
    """Segment of the drive, counted from 0."""
    mode: Float[Array, " room"]
    step_size: Float[Array, " room"]
    """Length for which the polynomials were made [s]."""
    duration: Float[Array, " room"]
    """Length for which they are used: up to an event, a corner or the step radius [s]."""
    origin: Float[Array, " room"]
    """Time at which the segment begins [s]."""
    t_local: Float[Array, " room"]
    """Local time at which the step begins, from the corner on [s]."""
    x: Float[Array, "room components"]
    """State at the beginning."""
    polynomials: Float[Array, "room kept coefficients"]
    """Polynomials of the components kept, in (time - begin)/step_size, lowest power first."""
    event: Bool[Array, " room"]
    """Whether an event ended the step."""
    which: Int[Array, " room"]
    """Number of the guard of that event."""


class End(NamedTuple):
    """Where the integration stopped."""

    time: Scalar
    """[s]"""
    x: Float[Array, " components"]
    """State."""
    index: Scalar  # pyright: ignore[reportIncompatibleMethodOverride]
    """Segment of the drive."""
    t_local: Scalar
    """Time in it [s]."""
    mode: Scalar


def end_of_run(end: Float[Array, " start"], loop: LoopState) -> End:
    """The end of a run, from its origin, local time and state, which have derivatives, and the last carry."""
    return End(end[0] + end[1], end[2:], loop.index, end[1], loop.mode)


class SteppedRun(NamedTuple):
    """The steps of a run and how it ended."""

    steps: Steps
    end: End
    period: Count
    """Step with which the last period of the drive began."""
    repeats: Truth
    """Whether the motion repeats that period from `end` on."""
    count: Count  # pyright: ignore[reportIncompatibleMethodOverride]
    """Steps accepted."""
    rejected: Count
    events: Count
    """Switches of the mode that were located."""
    failure: Count
    """Index into `accuracy.FAILURES`; 0 where the integration finished."""


def integrate_steps(
    system: AbstractHybridSystem, horizon: ScalarLike, accuracy: Accuracy, keep: tuple[int, ...] | None = None
) -> SteppedRun:
    """Integrate `system` from its initial state at t = 0 to `horizon` [s].

    Differentiable in every floating-point leaf of `system`, but not in `horizon`.

    **Arguments:** `keep` are the components of the state wanted between the starts of steps, all by default: fewer
    spare memory and time.
    """
    keep = tuple(range(len(jax.tree.leaves(system.initial())))) if keep is None else keep
    extent = RunExtent(lax.stop_gradient(jnp.asarray(horizon, float)), jnp.zeros((), int))
    starts, end, polynomials, facts = differentiable_run(system, None, extent, accuracy, keep)
    loop, row = facts.loop, facts.steps
    steps = Steps(
        index=row.index,
        mode=row.mode,
        step_size=row.step_size,
        duration=row.duration,
        origin=starts[0],
        t_local=starts[1],
        x=jnp.stack(starts[2:], axis=1),
        polynomials=polynomials,
        event=row.event,
        which=row.which,
    )
    counts = loop.period, loop.repeats, loop.count, loop.rejected, loop.events, loop.failure
    return SteppedRun(steps, end_of_run(end, loop), *counts)


def states_at(
    system: AbstractHybridSystem, run: SteppedRun, times: Float[Array, " m"], keep: tuple[int, ...] | None = None
) -> SampledStates:
    """The state at `times` [s], shape (m,), each within the integrated time or its repetition.

    Components outside `keep`, as given to `integrate_steps`, are those of the step's start unless the
    system knows them in closed form.
    """
    steps, end = run.steps, run.end
    begins, opening = steps.origin + steps.t_local, steps.origin[run.period]
    row, laps = locate_times(lambda rows: begins[rows], run.count, len(begins), opening, end.time, run.repeats, times)
    rows = jnp.concatenate([jnp.asarray(run.period)[None], row])
    starts = steps.origin[rows], steps.t_local[rows]
    stop = jnp.concatenate([jnp.stack([end.time - end.t_local, end.t_local]), end.x])
    elapsed = time_since_starts(starts, stop, times, laps)
    polynomials = steps.polynomials[row]
    values = horner([polynomials[:, :, k] for k in range(polynomials.shape[-1])], elapsed[:, None])
    start = StepStarts(steps.index[row], steps.mode[row], steps.t_local[row], list(steps.x[row].T))
    shift = [gain * laps for gain in end.x - steps.x[run.period]]
    return sampled_states(system, start, elapsed, values, shift, keep)


class StepStarts(NamedTuple):
    """The starts of the steps within which some times lie."""

    index: Float[Array, " m"]  # pyright: ignore[reportIncompatibleMethodOverride]
    """Segment of the drive."""
    mode: Float[Array, " m"]
    t_local: Float[Array, " m"]
    """[s]"""
    x: Sequence[Float[Array, " m"]]
    """Each component of the state."""


def sampled_states(
    system: AbstractHybridSystem,
    start: StepStarts,
    elapsed: Float[Array, " m"],
    values: Float[Array, "m kept"],
    shift: Sequence[Float[Array, " m"]],
    keep: tuple[int, ...] | None,
) -> SampledStates:
    """The states `elapsed` [s] after the `start` of their steps.

    **Arguments:** `values` of the components `keep`, from their polynomials; the `shift` of each component by the
    repetitions of the period.
    """
    end = list(start.x)
    for column, component in enumerate(range(len(end)) if keep is None else keep):
        end[component] = values[:, column]
    unflatten = unflattener(system)

    def with_closed_components(start: StepStarts, elapsed: Scalar, end: list[Scalar]) -> State:
        segment = system.segment(start.index)
        return system.exact(segment, start.t_local, unflatten(start.x), elapsed, unflatten(end))

    x = jax.vmap(with_closed_components)(start, elapsed, end)
    x = jax.tree.map(jnp.add, x, jax.vmap(unflatten)(shift))
    return SampledStates(x, jax.vmap(system.segment)(start.index), start.t_local + elapsed, start.mode)
