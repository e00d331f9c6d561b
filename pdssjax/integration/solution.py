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

`integrate_steps` keeps the polynomials of every step, and `states_at` evaluates them.  `sample_run` has the states at
given times for less: it makes the polynomials block by block (`tiles`) and keeps only their values.
"""

from collections.abc import Callable, Sequence
from typing import Generic, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from ..core import Count, Scalar, ScalarLike, Tree, Truth
from .accuracy import Accuracy
from .differentiated_run import RunExtent, Starts, differentiable_run, locate_times, time_since_starts
from .polynomials import horner
from .step_table import LoopState, Row, TakenSteps
from .system import AbstractHybridSystem, SampledStates, State, unflattener
from .tiles import PART
from .tracing import zeros_of

Observed = TypeVar("Observed")


class Steps(NamedTuple):
    """The steps of a run, in order; the first axis has room to spare."""

    index: Float[Array, " room"]  # pyright: ignore[reportIncompatibleMethodOverride]
    """Segment of the drive, counted from 0."""
    mode: Float[Array, " room"]
    step_size: Float[Array, " room"]
    """Length over which the polynomials are accurate [s]."""
    duration: Float[Array, " room"]
    """Length over which they are used: up to an event, a corner or the end of that length [s]."""
    origin: Float[Array, " room"]
    """Time at which the segment begins [s]."""
    t_local: Float[Array, " room"]
    """Local time at which the step begins, from the corner on [s]."""
    x: Float[Array, "room components"]
    """State at the beginning."""
    polynomials: Float[Array, "room kept coefficients"]
    """Polynomials of the components kept, in the time since the step's start [s], lowest power first."""
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


def _end(end: Float[Array, " start"], loop: LoopState) -> End:
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
    return SteppedRun(steps, _end(end, loop), *counts)


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
    start = _StepStarts(steps.index[row], steps.mode[row], steps.t_local[row], list(steps.x[row].T))
    shift = [gain * laps for gain in end.x - steps.x[run.period]]
    return _sampled_states(system, start, elapsed, values, shift, keep)


class SampledRun(NamedTuple, Generic[Observed]):
    """The result of a run of which only the states at some times were asked for."""

    states: Observed
    """The states at the times, or the values that `look` returned for them."""
    end: End
    count: Count  # pyright: ignore[reportIncompatibleMethodOverride]
    """Steps accepted."""
    rejected: Count
    events: Count
    """Switches of the mode that were located."""
    repeats: Truth
    """Whether, from some period of the drive on, the motion repeats that period."""
    failure: Count
    """Index into `accuracy.FAILURES`; 0 where the integration finished."""


def sample_run(
    system: AbstractHybridSystem,
    times: Float[Array, " m"],
    accuracy: Accuracy,
    keep: tuple[int, ...] | None = None,
    horizon: ScalarLike | None = None,
    look: Callable[[SampledStates], Observed] = lambda states: states,
    wanted: Count | None = None,
    steps: TakenSteps | None = None,
) -> SampledRun[Observed]:
    """Integrate `system` from its initial state at t = 0, and return the states at the ascending `times` [s].

    As `integrate_steps` and `states_at` do together, differentiable in every floating-point leaf of `system` and in
    `times`.

    **Arguments:**

    - `keep`: the components of the state that are wanted, all by default; the others are those of a step's start unless
      the system knows them in closed form
    - `horizon`: when the run ends [s], the last of the times by default; it has no derivative
    - `look`: a function of some of the states, whose values are returned in their place
    - `wanted`: only the states at so many of the times are computed, all by default; later times repeat the last
    - `steps`: those that `find_steps` finds to this horizon; None: they are found here
    """
    components = tuple(range(len(jax.tree.leaves(system.initial())))) if keep is None else keep
    times = jnp.asarray(times, float)
    horizon = lax.stop_gradient(jnp.asarray(times[-1] if horizon is None else horizon, float))
    extent = RunExtent(horizon, jnp.asarray(times.size if wanted is None else wanted), steps)
    starts, end, values, facts = differentiable_run(system, times, extent, accuracy, components)
    loop, laps = facts.loop, facts.laps
    opening, of_times = [number[:1] for number in starts], [number[1:] for number in starts]
    gain = [stop - start[0] for stop, start in zip(end[2:], opening[2:], strict=True)]

    def observe(steps: Row, starts: Starts, laps: Array, times: Array, values: Array) -> Observed:
        whole = [jnp.concatenate(both) for both in zip(opening, starts, strict=True)]
        elapsed = time_since_starts(whole, end, times, laps)
        start = _StepStarts(steps.index, steps.mode, starts[1], starts[2:])
        return look(_sampled_states(system, start, elapsed, values, [each * laps for each in gain], keep))

    rows = facts.steps, of_times, laps, times, values
    observed = observe(*rows) if wanted is None else _in_parts(observe, wanted, *rows)
    counts = loop.count, loop.rejected, loop.events, loop.repeats, loop.failure
    return SampledRun(observed, _end(end, loop), *counts)


def _in_parts(look: Callable[..., Observed], wanted: Count, *of_times: Tree) -> Observed:
    """`look` of the first `wanted` rows of arrays, a part at a time; later rows repeat the last of them."""
    count = len(jax.tree.leaves(of_times)[0])
    size = min(PART, count)
    rows = jnp.minimum(jnp.arange(-(-count // size) * size), wanted - 1)
    take = lambda rows: jax.tree.map(lambda a: a[rows], of_times)
    nothing = zeros_of(lambda: look(*take(rows[:size])))

    def part(both: tuple[Count, Int[Array, " part"]]) -> Observed:
        return lax.cond(both[0] < wanted, lambda: look(*take(both[1])), lambda: nothing)

    found = lax.map(part, (jnp.arange(0, rows.size, size), rows.reshape(-1, size)))
    return jax.tree.map(lambda a: a.reshape(-1, *a.shape[2:])[rows[:count]], found)


class _StepStarts(NamedTuple):
    """The starts of the steps within which some times lie."""

    index: Float[Array, " m"]  # pyright: ignore[reportIncompatibleMethodOverride]
    """Segment of the drive."""
    mode: Float[Array, " m"]
    t_local: Float[Array, " m"]
    """[s]"""
    x: Sequence[Float[Array, " m"]]
    """Each component of the state."""


def _sampled_states(
    system: AbstractHybridSystem,
    start: _StepStarts,
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

    def with_closed_components(start: _StepStarts, elapsed: Scalar, end: list[Scalar]) -> State:
        segment = system.segment(start.index)
        return system.exact(segment, start.t_local, unflatten(start.x), elapsed, unflatten(end))

    x = jax.vmap(with_closed_components)(start, elapsed, end)
    x = jax.tree.map(jnp.add, x, jax.vmap(unflatten)(shift))
    return SampledStates(x, jax.vmap(system.segment)(start.index), start.t_local + elapsed, start.mode)


def is_closed(system: AbstractHybridSystem) -> bool:
    """Whether states at any time are known without a step: all at once, or on each segment, which no guard ends."""
    return system.has_closed_states() or len(system.closed_components()) == len(jax.tree.leaves(system.initial()))


def exact_states_at(system: AbstractHybridSystem, times: Float[Array, " m"], segments: int) -> SampledStates:
    """The state of a closed `system` at `times` [s], shape (m,), none before 0.

    **Arguments:** `segments` is how many segments of the drive the times may reach into.

    **Returns:** as `states_at` does.
    """
    if system.has_closed_states():
        return system.closed_states(times, segments)

    def pass_segment(
        carry: tuple[Scalar, State, Scalar], index: Scalar
    ) -> tuple[tuple[Scalar, State, Scalar], tuple[Scalar, State, Scalar]]:
        origin, state, mode = carry
        segment = system.segment(index)
        state, mode = system.on_segment_start(segment, state, mode)
        lasts = jnp.isfinite(segment.duration)
        duration = jnp.where(lasts, segment.duration, 0.0)
        ahead = system.exact(segment, 0.0, state, duration, state)
        return (jnp.where(lasts, origin + duration, jnp.inf), ahead, mode), (origin, state, mode)

    zero = jnp.zeros(())
    first = jax.tree.map(lambda x: jnp.asarray(x, float), system.initial())
    _, (origins, states, modes) = lax.scan(pass_segment, (zero, first, zero), jnp.arange(segments) * 1.0)
    j = jnp.clip(jnp.searchsorted(lax.stop_gradient(origins), times, side="right") - 1, 0)

    def inside(j: Count, time: Scalar) -> SampledStates:
        begin, t_local = jax.tree.map(lambda x: x[j], states), time - origins[j]
        segment = system.segment(j * 1.0)
        return SampledStates(system.exact(segment, 0.0, begin, t_local, begin), segment, t_local, modes[j])

    return jax.vmap(inside)(j, times)
