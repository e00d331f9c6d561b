"""The states that a motion goes through at given times, with the derivatives of `integrate` at a fraction of its cost.

`integrate` keeps every step and its polynomials, for whoever looks between them.  Here they are made block by block
(`tiles`) and only what the times show of them is kept.
"""

from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float, Int

from ..core import Count, Scalar, ScalarLike, Truth
from .accuracy import Accuracy
from .forward_pass import find_steps
from .loop_state import LoopState
from .polynomials import horner
from .sensitivities import Keep, Tangents, end_of, tangents_of, values
from .solution import Begun, End, ended, places, since_begin, visited
from .step_table import KNOWN_COLUMNS, Table, read
from .system import AbstractHybridSystem, Visited
from .tiles import read_by_blocks


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


class _Seen(NamedTuple):
    """What of it has derivatives."""

    begins: Float[Array, "m+1 begin"]
    """Origin, local time and state where the steps of the times begin; last, where the repeated period opened."""
    end: Float[Array, " begin"]
    """The same where the run stopped."""
    elapsed: Float[Array, " m"]
    """Of the times, since their steps began [s]."""
    shown: Float[Array, "m kept"]
    """By the polynomials, then."""


class _Known(NamedTuple):
    """What of it has none."""

    index: Float[Array, " m"]  # pyright: ignore[reportIncompatibleMethodOverride]
    mode: Float[Array, " m"]
    laps: Float[Array, " m"]
    loop: LoopState


def visit(
    system: AbstractHybridSystem,
    times: Float[Array, " m"],
    accuracy: Accuracy,
    keep: tuple[int, ...] | None = None,
    horizon: ScalarLike | None = None,
) -> Visit:
    """Integrates `system` from its initial state at t = 0, and tells the states at the ascending `times` [s].

    As `integrate` and `states_at` do together, differentiable in every floating-point leaf of `system` and in `times`.

    **Arguments:** `keep` names the components of the state that are wanted, all by default; the others are those of a
    step's beginning unless the system knows them in closed form.  The run ends at the `horizon` [s], the last of the
    times by default; it has no derivative.
    """
    components = tuple(range(len(jax.tree.leaves(system.initial())))) if keep is None else keep
    times = jnp.asarray(times, float)
    horizon = lax.stop_gradient(jnp.asarray(times[-1] if horizon is None else horizon, float))
    seen, known = _differentiable_visit((system, times), horizon=horizon, accuracy=accuracy, keep=components)
    begins, opening, loop = seen.begins[:-1], seen.begins[-1], known.loop
    at_begin = Begun(known.index, known.mode, begins[:, 1], begins[:, 2:])
    gained = (seen.end[2:] - opening[2:]) * known.laps[:, None]
    states = visited(system, at_begin, seen.elapsed, seen.shown, keep, gained)
    return Visit(states, ended(seen.end, loop), loop.count, loop.rejected, loop.events, loop.repeats, loop.failure)


@eqx.filter_custom_jvp
def _differentiable_visit(
    asked: tuple[AbstractHybridSystem, Float[Array, " m"]], *, horizon: Scalar, accuracy: Accuracy, keep: Keep
) -> tuple[_Seen, _Known]:
    system, times = asked
    table, loop = find_steps(system, horizon, accuracy)
    rows, begins, elapsed, known = _located(table, loop, times)
    look = lambda polynomials, first: _at(_those(rows[:-1] - first, polynomials), elapsed)
    nothing = jnp.zeros((len(times), len(keep)))
    _, shown = read_by_blocks(values(system, accuracy, keep), None, table, loop.count, look, nothing)
    return _Seen(begins, end_of(loop), elapsed, shown), known


@_differentiable_visit.def_jvp
def _differentiable_visit_jvp(
    primals: tuple[tuple[AbstractHybridSystem, Float[Array, " m"]]],
    tangents: tuple[tuple[Any, Any]],
    *,
    horizon: Scalar,
    accuracy: Accuracy,
    keep: Keep,
) -> tuple[tuple[_Seen, _Known], tuple[_Seen, Any]]:
    ((system, times),), ((system_dot, times_dot),) = primals, tangents
    times_dot = jnp.zeros_like(times) if times_dot is None else times_dot
    table, loop = find_steps(system, horizon, accuracy)
    rows, begins, elapsed, known = _located(table, loop, times)

    def look(found: Tangents, first: Count) -> tuple[Array, Array, Array, Array]:
        begins_dot, polynomials, polynomials_dot = found
        here = _those(rows[:-1] - first, polynomials)
        shown, rates = jax.jvp(partial(_at, here), (elapsed,), (jnp.ones_like(elapsed),))
        shown_dot = _at(_those(rows[:-1] - first, polynomials_dot), elapsed)
        return _those(rows - first, begins_dot), shown, rates, shown_dot

    first_dot, tile = tangents_of(system, system_dot, accuracy, keep, begins.shape[1])
    blank = jnp.zeros((len(times), len(keep)))
    end_dot, (begins_dot, shown, rates, shown_dot) = read_by_blocks(
        tile, first_dot, table, loop.count, look, (jnp.zeros_like(begins), blank, blank, blank)
    )
    end = end_of(loop)
    since = lambda begins, end, times: _since_begin(begins, end, known.laps, times)
    _, elapsed_dot = jax.jvp(since, (begins, end, times), (begins_dot, end_dot, times_dot))
    seen_dot = _Seen(begins_dot, end_dot, elapsed_dot, shown_dot + rates * elapsed_dot[:, None])
    return (_Seen(begins, end, elapsed, shown), known), (seen_dot, jax.tree.map(lambda _: None, known))


def _located(
    table: Table, loop: LoopState, times: Float[Array, " m"]
) -> tuple[Int[Array, " m+1"], Float[Array, "m+1 begin"], Float[Array, " m"], _Known]:
    """The steps of the times and, last, of the period's opening; their begins; the times since; what else is known."""
    size, end = table.shape[1] - KNOWN_COLUMNS, end_of(loop)
    real = jnp.arange(len(table)) < loop.count
    begins = jnp.where(real, table[:, 0] + table[:, 1], jnp.inf)
    row, laps = places(begins, table[loop.period, 0], end[0] + end[1], loop.repeats, times)
    rows = jnp.append(row, loop.period)
    begun, steps = table[rows, :size], read(table[row].T)
    return rows, begun, _since_begin(begun, end, laps, times), _Known(steps.index, steps.mode, laps, loop)


def _since_begin(
    begins: Float[Array, "m+1 begin"], end: Float[Array, " begin"], laps: Float[Array, " m"], times: Float[Array, " m"]
) -> Float[Array, " m"]:
    return since_begin(begins[:-1, 0] + begins[:-1, 1], begins[-1, 0], end[0] + end[1], laps, times)


def _those(rows: Int[Array, " m"], block: Float[Array, "rows *shape"]) -> Float[Array, "m *shape"]:
    """Of a block the given rows, zeros for those of another block."""
    inside = (rows >= 0) & (rows < len(block))
    found = block[jnp.clip(rows, 0, len(block) - 1)]
    return jnp.where(inside.reshape(-1, *(1,) * (found.ndim - 1)), found, 0.0)


def _at(polynomials: Float[Array, "m kept coefficients"], elapsed: Float[Array, " m"]) -> Float[Array, "m kept"]:
    return horner([polynomials[:, :, k] for k in range(polynomials.shape[-1])], elapsed[:, None])
