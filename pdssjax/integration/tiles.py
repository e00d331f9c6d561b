"""The table of steps, a tile of rows at a time: what is found of every step, or what is read off them block by block.

A table has room to spare, and what is found of a step is large: of every step kept, the room that no step took would
cost a run of few steps more than its steps do.  So what is wanted at few times is read off a block of the table
before the next is begun.
"""

from collections.abc import Callable
from typing import TypeAlias, TypeVar

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

from ..core import Count
from .step_table import Table

_TILE = 32
"""Steps expanded or linearised side by side."""

_BLOCK = 16
"""Tiles in a block."""

Carry = TypeVar("Carry")
Found = TypeVar("Found")
Read = TypeVar("Read")

Tile: TypeAlias = Callable[[Carry, Float[Array, "rows columns"], Bool[Array, " rows"]], tuple[Carry, Found]]
"""Takes a carry through the rows of a tile, of which some are real, and tells what it found of each."""


def tiled(tile: Tile[Carry, Found], carry: Carry, table: Table, count: Count) -> tuple[Carry, Found]:
    """The carry behind the first `count` rows of the table, and what `tile` found of each; zeros for the rest."""
    room, width = table.shape
    tiles = -(-room // _TILE)
    real = jnp.arange(tiles * _TILE) < count
    # Rows without a step are computed like the first one: finite, and never used.
    rows = jnp.concatenate([table, jnp.zeros((tiles * _TILE - room, width))])
    rows = jnp.where(real[:, None], rows, table[0])
    stacked = (real.reshape(tiles, _TILE), rows.reshape(tiles, _TILE, width))
    function = jax.jit(tile, inline=True)  # traced once, for its shapes and for the branch
    shapes = jax.eval_shape(function, carry, stacked[1][0], stacked[0][0])[1]

    def blank(carry: Carry, rows: Float[Array, "rows columns"], real: Bool[Array, " rows"]) -> tuple[Carry, Found]:
        return carry, jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), shapes)

    def next_tile(carry: Carry, args: tuple[Bool[Array, " rows"], Float[Array, "rows columns"]]) -> tuple[Carry, Found]:
        real, rows = args
        return lax.cond(real[0], function, blank, carry, rows, real)

    carry, out = lax.scan(next_tile, carry, stacked)
    return carry, jax.tree.map(lambda a: a.reshape(tiles * _TILE, *a.shape[2:])[:room], out)


def read_by_blocks(
    tile: Tile[Carry, Found],
    carry: Carry,
    table: Table,
    count: Count,
    read: Callable[[Found, Count], Read],
    nothing: Read,
) -> tuple[Carry, Read]:
    """The carry behind the first `count` rows of the table, and the sum of what `read` makes of every block.

    **Arguments:** `read` takes what `tile` found of the rows of a block and the number of the first of them, and adds
    to `nothing`.  In reverse mode a block is computed again, so that its tiles' Jacobians need not be kept.
    """
    room, width = table.shape
    size = _TILE * min(_BLOCK, -(-room // _TILE))
    blocks = -(-room // size)
    rows = jnp.concatenate([table, jnp.zeros((blocks * size - room, width))]).reshape(blocks, size, width)

    @jax.checkpoint
    def passed(carry: Carry, so_far: Read, rows: Table, first: Count) -> tuple[Carry, Read]:
        carry, found = tiled(tile, carry, rows, count - first)
        return carry, jax.tree.map(jnp.add, so_far, read(found, first))

    def skipped(carry: Carry, so_far: Read, rows: Table, first: Count) -> tuple[Carry, Read]:
        return carry, so_far

    def next_block(both: tuple[Carry, Read], args: tuple[Table, Count]) -> tuple[tuple[Carry, Read], None]:
        rows, first = args
        return lax.cond(first < count, passed, skipped, *both, rows, first), None

    both, _ = lax.scan(next_block, (carry, nothing), (rows, jnp.arange(blocks) * size))
    return both
