"""Loops over the table of steps: results for every step, a tile of rows at a time, or values read block by block.

A table has room to spare, and the result for a step, its polynomials and derivatives, is large: results for the unused
rows would cost a run of few steps more than its steps do.  So the loops end with the last step, and values at given
times are read from a block of results before the next block begins.  Nothing here is differentiated: derivatives are
among the results.
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
from .tracing import traced_once

_TILE = 32
"""Steps expanded or linearised at once."""

BLOCK = 512
"""Rows in a block of tiles; a table has a whole number of blocks."""

PART = 128
"""Times at which a block is read at once."""

Carry = TypeVar("Carry")
Results = TypeVar("Results")
Read = TypeVar("Read")

Tile: TypeAlias = Callable[[Carry, Float[Array, "rows columns"], Bool[Array, " rows"]], tuple[Carry, Results]]
"""Takes a carry through the rows of a tile, of which some are real, and gives a result for each."""


def tiled(tile: Tile[Carry, Results], carry: Carry, table: Table, count: Count) -> tuple[Carry, Results]:
    """The carry after the first `count` rows of the table, and the results of `tile` for each; zeros for the rest."""
    tiles = len(table) // _TILE
    tile = traced_once(tile)
    shapes = jax.eval_shape(tile, carry, table[:_TILE], jnp.ones(_TILE, bool))[1]
    blank = jax.tree.map(lambda s: jnp.zeros((tiles * _TILE, *s.shape[1:]), s.dtype), shapes)

    def next_tile(number: Count, both: tuple[Carry, Results]) -> tuple[Carry, Results]:
        carry, so_far = both
        first = number * _TILE
        real = first + jnp.arange(_TILE) < count
        # Rows without a step are computed from the first one: finite, and never used.
        rows = jnp.where(real[:, None], lax.dynamic_slice_in_dim(table, first, _TILE), table[0])
        carry, results = tile(carry, rows, real)
        put = lambda all_rows, these: lax.dynamic_update_slice_in_dim(all_rows, these, first, 0)
        return carry, jax.tree.map(put, so_far, results)

    taken = jnp.minimum(-(-count // _TILE), tiles)
    return lax.fori_loop(0, taken, next_tile, (carry, blank))


def read_by_blocks(
    tile: Tile[Carry, Results],
    carry: Carry,
    table: Table,
    count: Count,
    read: Callable[..., Read],
    rows: Int[Array, " m"],
    wanted: Count,
    *of_times: Float[Array, " m"],
) -> tuple[Carry, Read]:
    """The carry after the first `count` rows of the table, and the values that `read` takes from those in `rows`.

    **Arguments:** `read(results, rows, *of_times)` gets the results of `tile` for a block, the numbers of some rows in
    it, which may lie outside, and the entries of the arrays `of_times` for those rows.  Only the first `wanted` of the
    `rows` are read.

    **Returns:** the carry; a value for each of the `rows`, zeros for those that are not wanted.
    """
    blocks = len(table) // BLOCK
    part = min(PART, rows.size)
    parts = -(-wanted // part)

    def next_block(number: Count, both: tuple[Carry, Read]) -> tuple[Carry, Read]:
        begin = number * BLOCK
        carry, results = tiled(tile, both[0], lax.dynamic_slice_in_dim(table, begin, BLOCK), count - begin)

        def next_part(number: Count, so_far: Read) -> Read:
            first = jnp.minimum(number * part, rows.size - part)
            cut = lambda array: lax.dynamic_slice_in_dim(array, first, part)
            here, before = cut(rows) - begin, jax.tree.map(cut, so_far)
            inside = (here >= 0) & (here < BLOCK)
            added = lambda: jax.tree.map(partial(_where, inside), read(results, here, *map(cut, of_times)), before)
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
