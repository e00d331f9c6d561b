"""The states that a motion goes through at given times, cheaper than by `integrate_steps`, with the same derivatives.

`integrate_steps` keeps every step and its polynomials, for whoever looks between them.  Here they are made block by
block (`tiles`) and only what the times show of them is kept.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ..core import Count, ScalarLike, Truth
from .accuracy import Accuracy
from .differentiated_run import seen_at, since_begins
from .solution import Begun, End, ended, visited
from .system import AbstractHybridSystem, Visited


class Visit(NamedTuple):
    """What is left of a run of which only the states at some times were asked for."""

    states: Visited
    end: End
    count: Count  # pyright: ignore[reportIncompatibleMethodOverride]
    """Steps accepted."""
    rejected: Count
    events: Count
    """Switches of the mode that were located."""
    repeats: Truth
    """From some period of the drive on the motion repeats that period."""
    failure: Count
    """Index into `failure.FAILURES`; 0 where the integration finished."""


def visit(
    system: AbstractHybridSystem,
    times: Float[Array, " m"],
    accuracy: Accuracy,
    keep: tuple[int, ...] | None = None,
    horizon: ScalarLike | None = None,
) -> Visit:
    """Integrates `system` from its initial state at t = 0, and tells the states at the ascending `times` [s].

    As `integrate_steps` and `states_at` do together, differentiable in every floating-point leaf of `system` and in
    `times`.

    **Arguments:** `keep` names the components of the state that are wanted, all by default; the others are those of a
    step's beginning unless the system knows them in closed form.  The run ends at the `horizon` [s], the last of the
    times by default; it has no derivative.
    """
    components = tuple(range(len(jax.tree.leaves(system.initial())))) if keep is None else keep
    times = jnp.asarray(times, float)
    horizon = lax.stop_gradient(jnp.asarray(times[-1] if horizon is None else horizon, float))
    begins, end, shown, found = seen_at(system, times, horizon, accuracy, components)
    loop, steps, laps = found.loop, found.steps, found.laps
    at_begin = Begun(steps.index, steps.mode, begins[:-1, 1], begins[:-1, 2:])
    gained = (end[2:] - begins[-1, 2:]) * laps[:, None]
    states = visited(system, at_begin, since_begins(begins, end, laps, times), shown, keep, gained)
    return Visit(states, ended(end, loop), loop.count, loop.rejected, loop.events, loop.repeats, loop.failure)
