"""What a sweep can tell of a point besides the motion of a cycle: each is asked for by its name.

They need every step of the cycle, not only its state at a few phases, and take several times as long as the metrics
that every sweep has.
"""

from typing import cast

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...core import Scalar
from ...drive.base import Segment
from ...integration import SETTLED
from ...metrics import force_metrics
from .base import Course, Metric, timing
from .course import mean_over_cycles, steps_within, visited

SMOOTH = {
    "output_force": Metric("N", "output force against a stop"),
    "peak_friction": Metric("N", "peak of the friction force in a cycle"),
}
"""Those that have derivatives by the parameters."""

COUNTED = {
    "reversals": Metric("1", "reversals of the relative motion in a cycle"),
    "settled": Metric("1", "part of a cycle for which all had settled"),
    "grazing": Metric("1", "nearness of a reversal to grazing; 1: none near"),
    "multiplier": Metric("1", "largest Floquet multiplier"),
}
"""Those that have none."""

FURTHER = SMOOTH | COUNTED
"""By name, all that can be asked for."""

GRAZES = 1e-2
"""`grazing` below this: a small change of the parameters takes a reversal away, and derivatives may break there."""

_SMALL = 1e-9
"""Motions [m] below this graze often, and it does not matter."""

_LINE = 6
"""Samples of the plateau of the output force."""

_PLATEAU = (0.751, 0.949)
"""Where they are on the slow flank; `pdssjax.metrics.force_metrics` takes those from 0.75 to 0.95 of it."""


def counted(course: Course, multiplier: Scalar) -> dict[str, Scalar]:
    """`COUNTED` of a course."""
    return {
        "reversals": reversals(course),
        "settled": settled(course),
        "grazing": grazing(course),
        "multiplier": multiplier,
    }


def reversals(course: Course) -> Scalar:
    """How often in a cycle the relative motion turns or stops, down to where it counts as settled."""
    inside, cycles = steps_within(course)
    return jnp.sum(inside & _turns(course)) / cycles


def settled(course: Course) -> Scalar:
    """The part of a cycle for which nothing is left but the steady creep of the platform; 0: it never settles."""
    inside, cycles = steps_within(course)
    steps, period = course.run.steps, timing(course.system.drive).period
    return jnp.sum(jnp.where(inside & (steps.mode == SETTLED), steps.duration, 0.0)) / (cycles * period)


def grazing(course: Course) -> Scalar:
    """How near the nearest reversal of the cycle is to grazing, between 0 and 1.

    With the relative acceleration a at the reversal and its rate b the velocity is near a t + b t^2 / 2: it would
    turn again after 2 a / b.  That, in units of the slowest oscillation's 1/w, is small where the reversal grazes.
    """
    inside, _ = steps_within(course)
    steps, unit = course.run.steps, course.system.state_scale().v
    ends = jnp.roll(steps.x, -1, axis=0)

    def nearness(index: Scalar, mode: Scalar, at: Scalar, x: Float[Array, " components"]) -> Scalar:
        segment = cast(Segment, course.moving.segment(index))

        def acceleration(after: Scalar) -> Scalar:
            state = jax.tree.unflatten(jax.tree.structure(course.system.initial()), list(x))
            rates = course.system.field(segment, at, state, mode)
            moved = jax.tree.map(lambda value, rate: value + after * jnp.asarray(rate, float), state, rates)
            return jnp.asarray(course.system.field(segment, at + after, moved, mode).v, float)

        a, b = jax.jvp(acceleration, (jnp.zeros(()),), (jnp.ones(()),))
        matters = jnp.maximum(jnp.abs(a) * unit**2, jnp.abs(b) * unit**3) > _SMALL
        near = 2.0 * jnp.abs(a) / jnp.maximum(jnp.abs(b) * unit, 1e-300)
        return jnp.where(matters, jnp.minimum(near, 1.0), 1.0)

    found = jax.vmap(nearness)(steps.index, steps.mode, steps.t_local + steps.duration, ends)
    # A corner may turn the motion, too; there it has no velocity of zero.
    located = inside & _turns(course) & (jnp.roll(steps.origin, -1) == steps.origin)
    return jnp.min(jnp.where(located, found, 1.0))


def output_force(blocked: Course) -> Scalar:
    """The force [N] on the stop at the end of the slow flank, of an actuator that runs against it; differentiable."""
    when = timing(blocked.system.drive)
    sticks = when.period - when.fall
    phases = when.fall + sticks * jnp.linspace(*_PLATEAU, _LINE)
    pushed = jax.vmap(lambda x: jnp.asarray(blocked.system.shown_force(x), float))(
        visited(blocked, phases, blocked.most).x
    )
    times = (jnp.arange(blocked.most)[:, None] * when.period + phases).ravel()
    found = force_metrics(times, pushed, when.frequency, 0.0, blocked.most, when.fall)
    return mean_over_cycles(blocked, found.output)


def _turns(course: Course) -> Array:
    """Whether the relative motion turns or stops where a step ends, shape (room,)."""
    mode = course.run.steps.mode
    following = jnp.roll(mode, -1)
    last = jnp.arange(mode.shape[0]) >= course.run.count - 1
    return (jnp.abs(mode) == 1.0) & ((following == -mode) | (following == 0.0)) & ~last
