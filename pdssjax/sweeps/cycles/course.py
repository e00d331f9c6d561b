"""A measured motion with all its steps: what the further metrics and the derivatives of a sweep are made of."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ...core import Count, Scalar
from ...integration import SHORT, Visited, states_at
from .base import METRICS, Course, cycles_at, effector_at, timing

_EARLY = 1e-9
"""A step that begins this part of a period before a cycle opens belongs to that cycle."""


def visited(course: Course, phases: Float[Array, " phases"], cycles: int) -> Visited:
    """The states at `phases` [s] of each of the first `cycles` cycles, one after the other."""
    period = timing(course.system.drive).period
    times = course.begin + (jnp.arange(cycles)[:, None] * period + phases).ravel()
    return states_at(course.moving, course.run, times)


def closing(course: Course) -> Float[Array, " components"]:
    """The state just before the corner that ends the cycles."""
    period = timing(course.system.drive).period
    before = (course.begin + course.span * period * (1.0 - SHORT))[None]
    return jnp.stack([leaf[0] for leaf in jax.tree.leaves(states_at(course.moving, course.run, before).x)])


def mean_over_cycles(course: Course, values: Float[Array, " cycles"]) -> Scalar:
    """The mean of what each of `course.most` cycles has, over those that there are."""
    counts = jnp.arange(course.most) < course.span
    return jnp.sum(jnp.where(counts, values, 0.0)) / course.span


def step_metrics(course: Course) -> dict[str, Scalar]:
    """The metrics that every cycle has (`METRICS`), differentiable in all that the course is."""
    when = timing(course.system.drive)
    effector = effector_at(course.system, visited(course, when.phases, course.most + 1).x)
    effector = effector.reshape(course.most + 1, -1)
    found, places = cycles_at(when, effector), effector[:, 0]
    net = (places[course.span] - places[0]) / course.span
    stroke = mean_over_cycles(course, found.stroke)
    by_name = dict(net_step=net, speed=net * when.frequency, efficiency=net / stroke, stroke=stroke)
    by_name |= dict(back_slip=stroke - net)
    return {name: by_name[name] for name in METRICS}


def steps_within(course: Course) -> tuple[Bool[Array, " room"], Count]:
    """Which steps belong to the cycles, and to how many: of a motion that repeats its last period is there once."""
    run, period = course.run, timing(course.system.drive).period
    begins = jax.lax.stop_gradient(run.steps.origin + run.steps.t_local)
    opening = jnp.where(run.repeats, run.steps.origin[run.period], course.begin) - _EARLY * period
    cycles = jnp.where(run.repeats, 1, course.span)
    real = jnp.arange(begins.shape[0]) < run.count
    return real & (begins >= opening) & (begins < opening + cycles * period), cycles
