"""What a sweep can tell of a point besides the motion of a cycle: each is asked for by its name.

They need every step of the cycle, not only its state at a few phases, and take several times as long as the metrics
that every sweep has.
"""

import jax
import jax.numpy as jnp

from ...core import Scalar
from ...integration import SETTLED
from ...metrics import force_metrics
from ...simulation import grazing, turns
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

_LINE = 6
"""Samples of the plateau of the output force."""

_PLATEAU = (0.751, 0.949)
"""Where they are on the slow flank; `pdssjax.metrics.force_metrics` takes those from 0.75 to 0.95 of it."""


def counted(course: Course, multiplier: Scalar, near: Scalar) -> dict[str, Scalar]:
    """`COUNTED` of a course, of which the last two are known."""
    return {
        "reversals": reversals(course),
        "settled": settled(course),
        "grazing": near,
        "multiplier": multiplier,
    }


def reversals(course: Course) -> Scalar:
    """How often in a cycle the relative motion turns or stops, down to where it counts as settled."""
    inside, cycles = steps_within(course)
    return jnp.sum(inside & turns(course.run)) / cycles


def settled(course: Course) -> Scalar:
    """The part of a cycle for which nothing is left but the steady creep of the platform; 0: it never settles."""
    inside, cycles = steps_within(course)
    steps, period = course.run.steps, timing(course.system.drive).period
    return jnp.sum(jnp.where(inside & (steps.mode == SETTLED), steps.duration, 0.0)) / (cycles * period)


def nearest_to_grazing(course: Course) -> Scalar:
    """How near the nearest reversal of the cycle is to grazing, between 0 and 1."""
    inside, _ = steps_within(course)
    return grazing(course.system, course.moving, course.run, inside)


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
