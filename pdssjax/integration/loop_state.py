"""What the loop over the steps carries: a handful of scalars, packed into one vector."""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import Scalar, require_float64
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
    """That state was settled."""
    period: Scalar
    repeats: Scalar


def initial_loop_state(system: AbstractHybridSystem) -> LoopState:
    """Before the first step of any run; **raises** `InputError` in single precision."""
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


def kept(tree: Scalars, opaque_one: Scalar) -> Scalars:
    """`tree` as computed once: XLA repeats cheap scalars in every consumer, but no division.

    `opaque_one` is 1 in a way that the compiler cannot know.
    """
    packed, unpack = pack(tree)
    return unpack(packed / opaque_one)
