"""Integrates period after period of the input until the motion repeats: in every one, or in every second or third.

How far a cycle is from its limit is told by how it approaches it: where the distance from one cycle to the next
shrinks by a factor r, what is still to come is r / (1 - r) of the last distance.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ..core import Count, Scalar, ScalarLike
from .accuracy import Accuracy
from .forward_pass import Packed, time_stepper
from .system import AbstractHybridSystem, State, unflattener

PERIODS = 3
"""Cycles after which a motion may repeat: 1, 2 or 3."""

_SHRINKS = 0.9
"""A motion that repeats after 2 or 3 cycles only is as far from that a cycle earlier as it was 2 or 3 cycles ago."""

_FLOOR = 0.25
"""A distance of this part of the tolerance counts as none: rounding and the error of steps do not shrink."""


class Cycles(NamedTuple):
    """The last cycles of a motion, and whether it repeats."""

    x: State
    """The states at the phases of the last cycles, oldest first; every leaf of shape (PERIODS + 1, m)."""
    remaining: Float[Array, " periods"]
    """How far [m] the motion is from one that repeats after 1, 2, 3 cycles."""
    period: Count
    """After how many cycles it repeats; 0 where it does not."""
    cycles: Count
    """How many were integrated."""
    ratio: Scalar
    """Factor by which the distance between cycles has shrunk in the last one."""
    steps: Count
    failure: Count
    """Index into `accuracy.FAILURES`; 0 where the integration went well."""


class _Carry(NamedTuple):
    packed: Packed
    seen: Float[Array, "cycles phases components"]
    """The last cycles, oldest first."""
    apart: Float[Array, "memory periods"]
    """How far the last cycles, oldest first, were from those 1, 2, 3 cycles earlier."""
    cycles: Count


def integrate_cycles(
    system: AbstractHybridSystem,
    duration: ScalarLike,
    phases: Float[Array, " m"],
    accuracy: Accuracy,
    tolerance: ScalarLike,
    most: int | Count,
) -> Cycles:
    """Integrate `system` from its initial state until a cycle repeats to within `tolerance` [m], `most` at most.

    **Arguments:** a cycle takes `duration` [s]; the `phases` [s], ascending, shape (m,), lie within one, and are
    where cycles are compared.  The accuracy has room for the steps of one cycle.
    """
    start, advance, read = time_stepper(system, accuracy)
    unflatten, count = unflattener(system), len(read(start).x)
    distance = lambda a, b: system.state_distance(unflatten(list(a)), unflatten(list(b)))

    def cycle(carry: _Carry) -> _Carry:
        room = (carry.cycles + 1) * accuracy.max_steps

        def go(packed: Packed, time: Scalar) -> tuple[Packed, Float[Array, " components"]]:
            packed = advance(packed, time, room)
            return packed, jnp.stack(read(packed).x)

        packed, now = lax.scan(go, carry.packed, carry.cycles * duration + phases)
        seen = jnp.concatenate([carry.seen[1:], now[None]])
        apart = jnp.stack([jax.vmap(distance)(now, seen[-1 - n]).max() for n in range(1, PERIODS + 1)])
        # Only what was integrated can repeat.
        apart = jnp.where(carry.cycles >= jnp.arange(1, PERIODS + 1), apart, jnp.inf)
        return _Carry(packed, seen, jnp.concatenate([carry.apart[1:], apart[None]]), carry.cycles + 1)

    def goes_on(carry: _Carry) -> Scalar:
        loop = read(carry.packed)
        failed = (carry.cycles > 0) & ((loop.failure > 0) | (loop.done == 0))
        return (carry.cycles < most) & ~failed & (_remaining(carry.apart, tolerance).min() >= tolerance)

    empty = jnp.zeros((PERIODS + 1, len(phases), count))
    begin = _Carry(start, empty, jnp.full((PERIODS + 1, PERIODS), jnp.inf), jnp.zeros((), int))
    last = lax.while_loop(goes_on, cycle, begin)
    loop, remaining = read(last.packed), _remaining(last.apart, tolerance)
    repeats = remaining < tolerance
    period = jnp.where(repeats.any(), jnp.argmax(repeats) + 1, 0)
    failure = jnp.where((loop.done == 0) & (loop.failure == 0), 1.0, loop.failure).astype(int)
    x = jax.vmap(jax.vmap(lambda row: unflatten(list(row))))(last.seen)
    ratio = last.apart[-1, 0] / last.apart[-2, 0]
    return Cycles(x, remaining, period, last.cycles, ratio, loop.count.astype(int), failure)


def _remaining(apart: Float[Array, "memory periods"], tolerance: ScalarLike) -> Float[Array, " periods"]:
    """How far [m] the cycle before the last is from one that repeats after 1, 2, 3 cycles, by the last distances.

    Net steps are differences of the last two.
    """
    before, last, now = apart[-3:]
    # The slower of the two: where multipliers are complex the distance shrinks by fits and starts.
    ratio = jnp.maximum(now / last, last / before)
    ratio = jnp.where(jnp.isfinite(ratio), ratio, 1.0)
    limit = jnp.where(ratio < 1.0, now / jnp.where(ratio < 1.0, 1.0 - ratio, 1.0), jnp.inf)
    limit = jnp.where(now < _FLOOR * tolerance, now, limit)
    # What approaches a motion that repeats in every cycle repeats in every second and third nearly, too.
    ago = apart[::-1, 0][jnp.arange(1, PERIODS + 1)]
    later = (jnp.arange(PERIODS) > 0) & ~(now[0] > _SHRINKS * ago)
    return jnp.where(later, jnp.inf, limit)
