"""The table of steps, a tile of rows at a time: what is found of every step, or what is read off them block by block.

A table has room to spare, and what is found of a step is large: of every step kept, the room that no step took would
cost a run of few steps more than its steps do.  So the loops end with the last step, and what is wanted at few times
is read off a block of the table before the next is begun.  Nothing here is differentiated: derivatives are among what
is found.
"""

from collections.abc import Callable
from functools import partial
from typing import TypeAlias, TypeVar

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from ..core import Count
from .step_table import Table

_TILE = 32
"""Steps expanded or linearised side by side."""

BLOCK = 512
"""Rows in a block of tiles; a table has a whole number of blocks."""

PART = 128
"""Times at which a block is read side by side."""

Carry = TypeVar("Carry")
Found = TypeVar("Found")
Read = TypeVar("Read")

Tile: TypeAlias = Callable[[Carry, Float[Array, "rows columns"], Bool[Array, " rows"]], tuple[Carry, Found]]
"""Takes a carry through the rows of a tile, of which some are real, and tells what it found of each."""


def tiled(tile: Tile[Carry, Found], carry: Carry, table: Table, count: Count) -> tuple[Carry, Found]:
    """The carry behind the first `count` rows of the table, and what `tile` found of each; zeros for the rest."""
    tiles = len(table) // _TILE
    tile = jax.jit(tile, inline=True)  # traced once, for its shapes and for the loop
    shapes = jax.eval_shape(tile, carry, table[:_TILE], jnp.ones(_TILE, bool))[1]
    blank = jax.tree.map(lambda s: jnp.zeros((tiles * _TILE, *s.shape[1:]), s.dtype), shapes)

    def next_tile(number: Count, both: tuple[Carry, Found]) -> tuple[Carry, Found]:
        carry, so_far = both
        first = number * _TILE
        real = first + jnp.arange(_TILE) < count
        # Rows without a step are computed like the first one: finite, and never used.
        rows = jnp.where(real[:, None], lax.dynamic_slice_in_dim(table, first, _TILE), table[0])
        carry, found = tile(carry, rows, real)
        put = lambda all_rows, these: lax.dynamic_update_slice_in_dim(all_rows, these, first, 0)
        return carry, jax.tree.map(put, so_far, found)

    taken = jnp.minimum(-(-count // _TILE), tiles)
    return lax.fori_loop(0, taken, next_tile, (carry, blank))


def read_by_blocks(
    tile: Tile[Carry, Found],
    carry: Carry,
    table: Table,
    count: Count,
    read: Callable[..., Read],
    rows: Int[Array, " m"],
    wanted: Count,
    *of_times: Float[Array, " m"],
) -> tuple[Carry, Read]:
    """The carry behind the first `count` rows of the table, and what `read` makes of those in `rows`.

    **Arguments:** `read(found, rows, *of_times)` takes what `tile` found of the rows of a block, some rows by their
    numbers in it, which may lie outside, and what is `of_times`, the arrays with an entry for each of the `rows`.  Of
    these only the first `wanted` are read.

    **Returns:** the carry; an entry for each of the `rows`, zeros for those that are not wanted.
    """
    blocks = len(table) // BLOCK
    part = min(PART, rows.size)
    parts = -(-wanted // part)

    def next_block(number: Count, both: tuple[Carry, Read]) -> tuple[Carry, Read]:
        begin = number * BLOCK
        carry, found = tiled(tile, both[0], lax.dynamic_slice_in_dim(table, begin, BLOCK), count - begin)

        def next_part(number: Count, so_far: Read) -> Read:
            first = jnp.minimum(number * part, rows.size - part)
            cut = lambda array: lax.dynamic_slice_in_dim(array, first, part)
            here, before = cut(rows) - begin, jax.tree.map(cut, so_far)
            inside = (here >= 0) & (here < BLOCK)
            added = lambda: jax.tree.map(partial(_where, inside), read(found, here, *map(cut, of_times)), before)
            new = lax.cond(jnp.any(inside), added, lambda: before)
            put = lambda array, values: lax.dynamic_update_slice_in_dim(array, values, first, 0)
            return jax.tree.map(put, so_far, new)

        return carry, lax.fori_loop(0, parts, next_part, both[1])

    shapes = jax.eval_shape(
        lambda: read(tiled(tile, carry, table[:BLOCK], count)[1], rows[:part], *[a[:part] for a in of_times])
    )
    nothing = jax.tree.map(lambda s: jnp.zeros((rows.size, *s.shape[1:]), s.dtype), shapes)
    return lax.fori_loop(0, jnp.minimum(-(-count // BLOCK), blocks), next_block, (carry, nothing))


def _where(is_new: Bool[Array, " rows"], new: Array, old: Array) -> Array:
    return jnp.where(is_new.reshape(-1, *(1,) * (new.ndim - 1)), new, old)
