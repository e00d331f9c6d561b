"""Pieces of a drive whose cycle is a slow and a fast flank, and the progress of a time within them."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Num

from ..core import Scalar, ScalarLike, Truth


class FlankPiece(NamedTuple):
    """A piece of a drive of two flanks a cycle."""

    duration: Scalar
    """[s]"""
    start: Scalar
    """Voltage just after the corner that opens it [V]."""
    change: Scalar
    """Change of the voltage over the piece [V]."""
    fast: Truth
    """Whether the piece is the fast flank."""


def flank(
    index: Scalar, period: ScalarLike, fall: ScalarLike, voltage: ScalarLike, direction: ScalarLike
) -> FlankPiece:
    """The piece `index` of a drive of two flanks a cycle: a fast one, over `fall` [s], then a slow one.

    Forward (`direction` 1) the slow flank rises, and the first cycle has no fast one, since it
    starts at 0 V; backward (-1) the fast flank rises, from the first cycle on.
    """
    fast = index % 2 == 0
    fall = first_fall(index, period, fall, direction)
    duration = jnp.where(fast, fall, period - fall)
    falls = fast == (direction > 0)
    change = jnp.where(falls, -1.0, 1.0) * voltage
    # There is no jump before the first forward cycle: a piezo that remembers must not see one.
    jump = jnp.where((index == 0) & (direction > 0), 0.0, 0.5) * voltage
    start = jnp.where(duration > 0, jnp.where(falls, voltage, 0.0), jump)
    return FlankPiece(duration, start, change, fast)


def first_fall(
    index: Num[Array, "*n"], period: ScalarLike, fall: ScalarLike, direction: ScalarLike
) -> Float[Array, "*n"]:
    """Duration [s] of the fast flank of the cycle that holds the piece `index`."""
    # A fit may try a fall longer than the cycle; time must not run backwards then.
    fall = jnp.minimum(jnp.asarray(fall, float), period)
    return jnp.where((index < 2) & (direction > 0), 0.0, fall)


def progress(
    time: Float[Array, " n"], period: ScalarLike, fall: ScalarLike, direction: ScalarLike
) -> tuple[Float[Array, " n"], Bool[Array, " n"]]:
    """How far `time` [s] is into its flank, from 0 to 1, and whether that is the fast one."""
    phase = jnp.mod(time, period)
    fall = first_fall(jnp.where(time < period, 0, 2), period, fall, direction)
    fast = phase < fall
    return jnp.where(fast, phase / jnp.where(fast, fall, 1.0), (phase - fall) / (period - fall)), fast


def too_long(flank: float, room: float, whole: str) -> str:
    """Say that a `flank` [s] must be shorter than the `room` [s] of its `whole`."""
    return f"{flank:g} s, expected less than {whole}, {room:g} s"
