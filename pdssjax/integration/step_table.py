"""The table of steps that the forward pass writes and the sensitivities read: its columns, and the code of a step."""

from typing import NamedTuple, TypeAlias

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ..core import Count, Scalar, Truth
from .loop_state import LoopState

CORNER, BECAME_SETTLED, EVENT, WHICH = 1, 2, 4, 8
"""Bits of the code of a step, how it ended; the number of the guard that ended it follows from `WHICH` on."""

KNOWN_COLUMNS = 5
"""Columns of the table behind the time and the state: index, mode, reach, length, code."""

Table: TypeAlias = Float[Array, "room columns"]
"""A row a step: time and state at its begin, then the `KNOWN_COLUMNS`; room to spare."""


def written(loop: LoopState, step_radius: Scalar, duration: Scalar, code: Scalar) -> Float[Array, " columns"]:
    """The row of a step that begins where the `loop` is, of which the code is a sum of bits."""
    return jnp.stack([loop.origin, loop.t_local, *loop.x, loop.index, loop.mode, step_radius, duration, code])


class Row(NamedTuple):
    """A row of the table: what can be differentiated by, then what is known."""

    origin: Scalar
    t_local: Scalar
    begin: tuple[Scalar, ...]
    """The components of the state."""
    index: Scalar  # pyright: ignore[reportIncompatibleMethodOverride]
    mode: Scalar
    step_radius: Scalar
    duration: Scalar
    corner: Truth
    becomes_settled: Truth
    event: Truth
    which: Count

    @property
    def at(self) -> Scalar:
        """Local time at the end, before it moves [s]."""
        return self.t_local + self.duration


def read(row: Float[Array, " columns"]) -> Row:
    """A row of the table, by name."""
    size = row.shape[0] - KNOWN_COLUMNS
    origin, t_local, *begin = row[:size]
    index, mode, step_radius, duration, code = lax.stop_gradient(row[size:])
    code = code.astype(int)
    corner, settled, event = (code & bit > 0 for bit in (CORNER, BECAME_SETTLED, EVENT))
    known = (index, mode, step_radius, duration, corner, settled, event, code // WHICH)
    return Row(origin, t_local, tuple(begin), *known)
