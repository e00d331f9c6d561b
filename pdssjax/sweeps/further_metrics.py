"""The further metrics of a point in a sweep, computed where a user asks for them by name.

They need every step of the cycle, not only its state at a few phases, and take several times as long as the metrics
that every sweep has.

The peak of the friction force: within a step the force is smooth.  It is sampled there, and the highest of the samples'
peaks are refined to the root of the force's rate, or to an end of the step.  At a peak between events the rate is zero,
so the derivative of the peak is that of the force at a fixed time.  At an event or a corner the peak moves with it.
The begin and the end of a step carry that derivative, so the force is taken at a fixed fraction between them.
"""

from typing import cast

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array

from ..core import Scalar
from ..drive.base import Segment
from ..integration import SETTLED
from ..metrics import force_metrics
from ..simulation import grazing, turns
from .cycles import Course, Metric, mean_over_cycles, sampled_states, steps_within, timing

SMOOTH = {
    "output_force": Metric("N", "output force against a stop"),
    "peak_friction": Metric("N", "peak of the friction force in a cycle"),
}
"""Further metrics that have derivatives by the parameters."""

COUNTED = {
    "reversals": Metric("1", "reversals of the relative motion in a cycle"),
    "settled": Metric("1", "part of a cycle for which all had settled"),
    "grazing": Metric("1", "nearness of a reversal to grazing; 1: none near"),
    "multiplier": Metric("1", "largest Floquet multiplier"),
}
"""Further metrics without derivatives."""

FURTHER = SMOOTH | COUNTED
"""All further metrics, by name."""

_PLATEAU = (0.751, 0.949, 6)
"""First and last sample of the output force, as fractions of the slow flank, and their number;
`pdssjax.metrics.force_metrics` takes samples from 0.75 to 0.95 of the flank."""


def counted(course: Course, multiplier: Scalar, near: Scalar) -> dict[str, Scalar]:
    """`COUNTED` of a course; the last two, `near` to grazing and `multiplier`, are given."""
    inside, cycles = steps_within(course)
    steps, period = course.run.steps, timing(course.system.drive).period
    # While the motion is settled, only the steady creep of the platform is left.
    settled = jnp.sum(jnp.where(inside & (steps.mode == SETTLED), steps.duration, 0.0))
    return {
        "reversals": jnp.sum(inside & turns(course.run)) / cycles,
        "settled": settled / (cycles * period),
        "grazing": near,
        "multiplier": multiplier,
    }


def nearest_to_grazing(course: Course) -> Scalar:
    """The nearness to grazing of the nearest reversal of the cycle, between 0 and 1."""
    inside, _ = steps_within(course)
    return grazing(course.system, course.moving, course.run, inside)


def output_force(blocked: Course) -> Scalar:
    """The force [N] on the stop at the end of the slow flank, of an actuator that runs against it; differentiable."""
    when = timing(blocked.system.drive)
    phases = when.fall + (when.period - when.fall) * jnp.linspace(*_PLATEAU)
    states = sampled_states(blocked, phases, blocked.most).x
    forces = jax.vmap(lambda x: jnp.asarray(blocked.system.shown_force(x), float))(states)
    times = (jnp.arange(blocked.most)[:, None] * when.period + phases).ravel()
    metrics = force_metrics(times, forces, when.frequency, 0.0, blocked.most, when.fall)
    return mean_over_cycles(blocked, metrics.output)


_PARTS = 8
"""Parts of a step at whose ends the force is sampled."""

_PEAKS = 8
"""Number of the highest samples whose neighbouring peak is looked for."""

_HALVINGS = 54
"""Halvings of the interval in which a peak lies: to rounding."""


def peak_friction(course: Course) -> Scalar:
    """The largest magnitude of the friction force [N] in a cycle.

    Differentiable in all leaves of the course; of two equally high peaks the derivative is that of one.
    """
    still = lax.stop_gradient(course)
    slope_at = jax.grad(lambda part, step: _friction_magnitude(still, step, part))

    def refined(step: Array, first: Scalar, last: Scalar) -> Scalar:
        """The fraction of the step at which the peak lies; an end of the interval where the force rises up to there."""

        def halved(_: int, ends: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar]:
            low, high = ends
            middle = 0.5 * (low + high)
            rises = slope_at(middle, step) > 0
            return jnp.where(rises, middle, low), jnp.where(rises, high, middle)

        low, high = lax.fori_loop(0, _HALVINGS, halved, (first, last))
        return jnp.where(high == last, high, jnp.where(low == first, low, 0.5 * (low + high)))

    steps, lows, highs = _peak_intervals(still)
    parts = jax.vmap(refined)(steps, lows, highs)
    heights = jax.vmap(lambda step, part: _friction_magnitude(still, step, part))(steps, parts)
    highest = jnp.argmax(jnp.where(jnp.isfinite(heights), heights, -jnp.inf))
    return _friction_magnitude(course, steps[highest], lax.stop_gradient(parts[highest]))


def _peak_intervals(course: Course) -> tuple[Array, Array, Array]:
    """Steps of the highest local maxima of the samples, and the fractions of the step that bracket each maximum."""
    inside, _ = steps_within(course)
    parts = jnp.linspace(0.0, 1.0, _PARTS + 1)
    sampled = jax.vmap(lambda step: jax.vmap(lambda part: _friction_magnitude(course, step, part))(parts))
    heights = sampled(jnp.arange(inside.shape[0]))
    known = jnp.where(inside[:, None] & jnp.isfinite(heights), heights, -jnp.inf)
    left = jnp.concatenate([jnp.full_like(known[:, :1], -jnp.inf), known[:, :-1]], axis=1)
    right = jnp.concatenate([known[:, 1:], jnp.full_like(known[:, :1], -jnp.inf)], axis=1)
    tops = jnp.where((known >= left) & (known >= right), known, -jnp.inf)
    step, part = jnp.divmod(lax.top_k(tops.ravel(), _PEAKS)[1], _PARTS + 1)
    return step, parts[jnp.maximum(part - 1, 0)], parts[jnp.minimum(part + 1, _PARTS)]


def _friction_magnitude(course: Course, step: Array, part: Scalar) -> Scalar:
    """The magnitude of the friction force [N] at the fraction `part` of a step."""
    steps, following = (jax.tree.map(lambda column, i=i: column[i], course.run.steps) for i in (step, step + 1))
    moved = following.origin + following.t_local - steps.origin - steps.t_local
    # The value is the step's own duration, free of the rounding of times; the derivative is that of the two times.
    moved = jnp.where(step + 1 < course.run.count, moved, steps.duration)
    elapsed = part * (steps.duration + moved - lax.stop_gradient(moved))
    x = jnp.polyval(steps.polynomials.T[::-1], elapsed)
    restored = lambda leaves: jax.tree.unflatten(jax.tree.structure(course.system.initial()), list(leaves))
    segment = cast(Segment, course.moving.segment(steps.index))
    state = course.system.exact(segment, steps.t_local, restored(steps.x), elapsed, restored(x))
    return jnp.abs(course.system.force(segment, steps.t_local + elapsed, state, steps.mode))
