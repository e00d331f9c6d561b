"""Grazing reversals of the relative motion, which a small change of the parameters takes away.

Derivatives and Floquet multipliers may break there.
"""

from typing import cast

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..core import Scalar
from ..drive.base import Segment
from ..integration import AbstractHybridSystem, SteppedRun
from .systems.stick_slip import StickSlip

_SMALL = 1e-9
"""Motions [m] below this graze often, and it does not matter."""


def grazing(
    system: StickSlip, integrated: AbstractHybridSystem, run: SteppedRun, inside: Bool[Array, " room"] | None = None
) -> Scalar:
    """Distance of the nearest reversal of a `run` from grazing, between 0 (it grazes) and 1 [1].

    With the relative acceleration a at the reversal and its rate b the velocity is near a t + b t^2 / 2: it would
    turn again after 2 a / b.  That, in units of the slowest oscillation's 1/w, is small where the reversal grazes.

    **Arguments:** `integrated` is the system of the run: the `system`, or the system from a later time on.  Only the
    steps `inside` count, all of them by default.
    """
    steps, unit = run.steps, system.state_scale().v
    ends = jnp.roll(steps.x, -1, axis=0)

    def nearness(index: Scalar, mode: Scalar, at: Scalar, x: Float[Array, " components"]) -> Scalar:
        segment = cast(Segment, integrated.segment(index))

        def acceleration(after: Scalar) -> Scalar:
            state = jax.tree.unflatten(jax.tree.structure(system.initial()), list(x))
            rates = system.field(segment, at, state, mode)
            moved = jax.tree.map(lambda value, rate: value + after * jnp.asarray(rate, float), state, rates)
            return jnp.asarray(system.field(segment, at + after, moved, mode).v, float)

        a, b = jax.jvp(acceleration, (jnp.zeros(()),), (jnp.ones(()),))
        matters = jnp.maximum(jnp.abs(a) * unit**2, jnp.abs(b) * unit**3) > _SMALL
        near = 2.0 * jnp.abs(a) / jnp.maximum(jnp.abs(b) * unit, 1e-300)
        return jnp.where(matters, jnp.minimum(near, 1.0), 1.0)

    found = jax.vmap(nearness)(steps.index, steps.mode, steps.t_local + steps.duration, ends)
    # A corner may turn the motion, too; there it has no velocity of zero.
    located = turns(run) & (jnp.roll(steps.origin, -1) == steps.origin)
    return jnp.min(jnp.where(located if inside is None else inside & located, found, 1.0))


def turns(run: SteppedRun) -> Bool[Array, " room"]:
    """Whether the relative motion turns or stops where a step ends."""
    mode = run.steps.mode
    following = jnp.roll(mode, -1)
    last = jnp.arange(mode.shape[0]) >= run.count - 1
    return (jnp.abs(mode) == 1.0) & ((following == -mode) | (following == 0.0)) & ~last
