"""The forward pass: every step of a run, found without derivatives.

A bare `while_loop` on a few scalars.  It writes one row for each step to a table; `sensitivities`
expands the rows again, in value and in derivative.
"""

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ..core import Count, Scalar
from .accuracy import Accuracy
from .one_step import one_step, step_control
from .step_table import KNOWN_COLUMNS, LoopState, Table, TakenSteps, initial_loop_state, pack
from .system import AbstractHybridSystem, State, unflattener
from .tiles import BLOCK

_BLOCK = 5
"""Steps written to memory at a time: XLA runs a loop on small buffers two to three times faster."""

Packed: TypeAlias = Float[Array, " scalars"]
"""A carry as one vector."""


class StatesAtTimes(NamedTuple):
    """The result of an integration that kept no steps."""

    x: State
    """The states at the times asked for; every leaf of shape (m,)."""
    steps: Count
    """Accepted."""
    rejected: Count
    failure: Count
    """Index into `accuracy.FAILURES`; 0 where the integration finished."""


def empty_table(system: AbstractHybridSystem, accuracy: Accuracy) -> Table:
    """An empty table with room for all steps that the `accuracy` allows."""
    width = 2 + len(jax.tree.leaves(system.initial())) + KNOWN_COLUMNS
    return jnp.zeros((-(-(accuracy.max_steps + _BLOCK) // BLOCK) * BLOCK, width))


def find_steps(
    system: AbstractHybridSystem, horizon: Scalar, accuracy: Accuracy, table: Table | None = None
) -> TakenSteps:
    """Every step from t = 0 to the `horizon` [s]: the table of steps, and the last carry.

    **Arguments:** `table` is that of another run, to be written over: a loop over runs then clears it only once.
    """
    table = empty_table(system, accuracy) if table is None else table
    control = step_control(accuracy)
    loop = initial_loop_state(system)
    start, unpack = pack(loop)
    blocks = -(-accuracy.max_steps // _BLOCK)
    done = lambda packed: unpack(packed).done > 0

    def add_step(
        carry: tuple[Packed, Count, Float[Array, "block columns"]],
    ) -> tuple[Packed, Count, Float[Array, "block columns"]]:
        packed, filled, block = carry
        moved, row, accepted = one_step(system, horizon, control, unpack(packed), True)
        block = lax.dynamic_update_index_in_dim(block, row, filled, 0)
        return pack(moved)[0], filled + accepted, block

    def add_block(carry: tuple[Packed, Table, Count]) -> tuple[Packed, Table, Count]:
        packed, table, used = carry
        empty = (packed, jnp.zeros((), int), jnp.zeros((_BLOCK, table.shape[1])))
        packed, _, block = lax.while_loop(lambda c: (c[1] < _BLOCK) & ~done(c[0]), add_step, empty)
        return packed, lax.dynamic_update_slice_in_dim(table, block, used * _BLOCK, 0), used + 1

    begin = (start, table, jnp.zeros((), int))
    packed, table, _ = lax.while_loop(lambda c: (c[2] < blocks) & ~done(c[0]), add_block, begin)
    loop = unpack(packed)
    counts = ("count", "rejected", "events", "period", "failure")
    whole = {name: getattr(loop, name).astype(int) for name in counts}
    whole["failure"] = jnp.where(loop.done > 0, whole["failure"], 1)
    return table, loop._replace(**whole, repeats=loop.repeats > 0)


def integrate_to_times(system: AbstractHybridSystem, times: Float[Array, " m"], accuracy: Accuracy) -> StatesAtTimes:
    """The state at each of the ascending `times` [s], shape (m,), without keeping the steps between.

    For sweeps: little memory, no derivatives, no repetition of periods.
    """
    start, advance, unpack = time_stepper(system, accuracy)

    def go(packed: Packed, time: Scalar) -> tuple[Packed, Float[Array, " components"]]:
        packed = advance(packed, time, accuracy.max_steps)
        return packed, jnp.stack(unpack(packed).x)

    packed, states = lax.scan(go, start, times)
    loop = unpack(packed)
    failure = jnp.where((loop.done == 0) & (loop.failure == 0), 1.0, loop.failure).astype(int)
    return StatesAtTimes(unflattener(system)(states.T), loop.count.astype(int), loop.rejected.astype(int), failure)


def time_stepper(
    system: AbstractHybridSystem, accuracy: Accuracy
) -> tuple[Packed, Callable[[Packed, Scalar, int | Count], Packed], Callable[[Packed], LoopState]]:
    """The carry before the first step, a function that takes a carry to a later time [s], and one that unpacks it.

    The first function takes a maximum of steps, counted from the start of the run; after a failure it takes none.
    """
    control = step_control(accuracy)
    start, unpack = pack(initial_loop_state(system))

    def advance(packed: Packed, time: Scalar, most: int | Count) -> Packed:
        loop = unpack(packed)
        packed = pack(loop._replace(done=jnp.where(loop.failure > 0, 1.0, 0.0)))[0]
        running = lambda packed: (unpack(packed).done == 0) & (unpack(packed).count < most)
        step = lambda packed: pack(one_step(system, time, control, unpack(packed), False)[0])[0]
        return lax.while_loop(running, step, packed)

    return start, advance, unpack
