"""The states of a motion at given times, cheaper than by `integrate_steps`, with the same derivatives.

`integrate_steps` keeps the polynomials of every step.  Here they are made block by block (`tiles`), and only their
values at the times are kept.
"""

from collections.abc import Callable
from typing import Generic, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float, Int

from ..core import Count, Scalar, ScalarLike, Tree, Truth
from .accuracy import Accuracy
from .differentiated_run import RunExtent, Starts, differentiable_run, time_since_starts
from .solution import End, StepStarts, end_of_run, sampled_states
from .step_table import Row, TakenSteps
from .system import AbstractHybridSystem, SampledStates, State
from .tiles import PART
from .tracing import zeros_of

Observed = TypeVar("Observed")


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
        start = StepStarts(steps.index, steps.mode, starts[1], starts[2:])
        return look(sampled_states(system, start, elapsed, values, [each * laps for each in gain], keep))

    rows = facts.steps, of_times, laps, times, values
    observed = observe(*rows) if wanted is None else _in_parts(observe, wanted, *rows)
    counts = loop.count, loop.rejected, loop.events, loop.repeats, loop.failure
    return SampledRun(observed, end_of_run(end, loop), *counts)
