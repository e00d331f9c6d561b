"""Whether a period of the drive repeats the last one: from there on the motion is copied, not stepped."""

import jax.numpy as jnp

from ..core import Scalar, Truth
from .loop_state import LoopState
from .system import SETTLED, AbstractHybridSystem, State, Unflatten


def new_period(
    cycle: tuple[int, int] | None,
    system: AbstractHybridSystem,
    settle_tolerance: Scalar,
    unflatten: Unflatten,
    loop: LoopState,
    ahead: Scalar,
    x: State,
    mode: Scalar,
    corner: Truth,
) -> tuple[Truth | bool, Truth]:
    """Whether a period of the drive opens here, and whether it repeats the last one.

    It does where both began at rest and in the same state but for a shift: a contact may
    also rest while it sticks, each time with another force, or while the platform rings.
    """
    if cycle is None:
        return False, jnp.zeros((), bool)
    first, every = cycle
    opens = corner & (ahead >= first) & ((ahead - first) % every == 0)
    # Each is within `rest` of the steady solution; the factor keeps that from looking like a difference.
    same = system.same_state(x, unflatten(loop.period_start), 4.0 * settle_tolerance)
    return opens, opens & (loop.period_start_settled > 0) & (mode == SETTLED) & same
