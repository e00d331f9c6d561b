"""The carry of the loop over the steps, and the table of steps that it writes and `sensitivities` reads."""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias, TypeVar

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ..core import Count, Scalar, Truth, require_float64
from .system import AbstractHybridSystem, initial_state_and_mode

Scalars = TypeVar("Scalars")
"""A pytree of scalars."""


class LoopState(NamedTuple):
    """The carry of the loop, scalars only, so that the loop is fast; at the end its result."""

    index: Scalar  # pyright: ignore[reportIncompatibleMethodOverride]
    origin: Scalar
    t_local: Scalar
    x: tuple[Scalar, ...]
    mode: Scalar
    proposed_step: Scalar
    count: Scalar  # pyright: ignore[reportIncompatibleMethodOverride]
    rejected: Scalar
    events: Scalar
    failure: Scalar
    done: Scalar
    period_start: tuple[Scalar, ...]
    """State at the start of the drive's last period."""
    period_start_settled: Scalar
    """Whether that state was settled."""
    period: Scalar
    repeats: Scalar


def initial_loop_state(system: AbstractHybridSystem) -> LoopState:
    """The carry before the first step of a run; **raises** `InputError` in single precision."""
    require_float64("pdssjax.integration")
    zero = jnp.zeros(())
    first, mode = initial_state_and_mode(system)
    leaves = tuple(jax.tree.leaves(first))
    nothing: Any = zero
    blank = LoopState(*[nothing] * len(LoopState._fields))
    return blank._replace(x=leaves, period_start=leaves, mode=mode, proposed_step=zero + 1e-6)


def pack(tree: Scalars) -> tuple[Float[Array, " scalars"], Callable[[Float[Array, " scalars"]], Scalars]]:
    """The scalars of `tree` as one vector, and the way back."""
    leaves, structure = jax.tree.flatten(tree)
    return jnp.stack(leaves), lambda packed: jax.tree.unflatten(structure, [packed[i] for i in range(len(leaves))])


def barrier(tree: Scalars, opaque_one: Scalar) -> Scalars:
    """`tree`, computed once: XLA repeats cheap scalars in every consumer, but no division.

    `opaque_one` is 1 in a way that the compiler cannot know.
    """
    packed, unpack = pack(tree)
    return unpack(packed / opaque_one)


CORNER, BECAME_SETTLED, EVENT, WHICH = 1, 2, 4, 8
"""Bits of the code that says how a step ended; the bits from `WHICH` on are the number of the guard that ended it."""

KNOWN_COLUMNS = 5
"""Columns of the table behind the time and the state: index, mode, radius, length, code."""

Table: TypeAlias = Float[Array, "room columns"]
"""One row for each step: time and state at its start, then the `KNOWN_COLUMNS`; room to spare."""


def table_row(loop: LoopState, step_size: Scalar, duration: Scalar, code: Scalar) -> Float[Array, " columns"]:
    """The row of a step that starts where the `loop` is, of which the code is a sum of bits."""
    return jnp.stack([loop.origin, loop.t_local, *loop.x, loop.index, loop.mode, step_size, duration, code])


TakenSteps: TypeAlias = tuple[Table, LoopState]
"""The steps of a run, and the last carry of the loop that found them."""


class Row(NamedTuple):
    """A row of the table: first the numbers with which the step starts, which have derivatives, then the others."""

    origin: Scalar
    t_local: Scalar
    x: tuple[Scalar, ...]
    """The components of the state."""
    index: Scalar  # pyright: ignore[reportIncompatibleMethodOverride]
    mode: Scalar
    step_size: Scalar
    duration: Scalar
    corner: Truth
    becomes_settled: Truth
    event: Truth
    which: Count

    @property
    def end(self) -> Scalar:
        """Local time at the end, which does not vary [s]."""
        return self.t_local + self.duration


def read(row: Float[Array, " columns"]) -> Row:
    """A row by names; of the transposed table every value has the axis of the rows."""
    size = row.shape[0] - KNOWN_COLUMNS
    origin, t_local, *x = row[:size]
    index, mode, step_size, duration, code = lax.stop_gradient(row[size:])
    code = code.astype(int)
    corner, settled, event = (code & bit > 0 for bit in (CORNER, BECAME_SETTLED, EVENT))
    known = (index, mode, step_size, duration, corner, settled, event, code // WHICH)
    return Row(origin, t_local, tuple(x), *known)
