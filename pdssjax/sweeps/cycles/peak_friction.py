"""The largest magnitude of the friction force in a cycle, where it lies, and its derivative.

Within a step the force is smooth.  It is sampled there, and the highest of the samples' peaks are refined to the root
of the force's rate, or to an end of the step.  At a peak between events the rate is zero, so that the peak changes as
the force at a fixed time does.  At an event or a corner it changes with the time of that, too: where a step begins
and ends has that derivative already, so the force is looked at a fixed part of the way between the two.
"""

from typing import NamedTuple, cast

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array

from ...core import Scalar
from ...drive.base import Segment
from .base import Course
from .course import steps_within

_PARTS = 8
"""Parts of a step at whose ends the force is sampled."""

_PEAKS = 8
"""Of so many of the highest samples it is seen what peak is next to them."""

_HALVINGS = 54
"""Of the interval in which a peak lies: to rounding."""


class _Place(NamedTuple):
    """A part of the way through a step, which holds a peak."""

    step: Array
    low: Scalar
    high: Scalar


def peak_friction(course: Course) -> Scalar:
    """The largest magnitude of the friction force [N] in a cycle.

    Differentiable in all that the course is; where two peaks are equally high the derivative is that of one of them.
    """
    still = lax.stop_gradient(course)
    slope_at = jax.grad(lambda part, step: _magnitude(still, step, part))

    def refined(place: _Place) -> Scalar:
        """The part of the way through the step at which the peak lies; an end of it where the force rises to there."""

        def halved(_: int, ends: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar]:
            low, high = ends
            middle = 0.5 * (low + high)
            rises = slope_at(middle, place.step) > 0
            return jnp.where(rises, middle, low), jnp.where(rises, high, middle)

        low, high = lax.fori_loop(0, _HALVINGS, halved, (place.low, place.high))
        return jnp.where(high == place.high, high, jnp.where(low == place.low, low, 0.5 * (low + high)))

    places = _places(still)
    parts = jax.vmap(refined)(places)
    heights = jax.vmap(lambda step, part: _magnitude(still, step, part))(places.step, parts)
    highest = jnp.argmax(jnp.where(jnp.isfinite(heights), heights, -jnp.inf))
    return _magnitude(course, places.step[highest], lax.stop_gradient(parts[highest]))


def _places(course: Course) -> _Place:
    """Where the highest samples are that exceed their neighbours in the same step; each with the interval to those."""
    inside, _ = steps_within(course)
    parts = jnp.linspace(0.0, 1.0, _PARTS + 1)
    sampled = jax.vmap(lambda step: jax.vmap(lambda part: _magnitude(course, step, part))(parts))
    heights = sampled(jnp.arange(inside.shape[0]))
    known = jnp.where(inside[:, None] & jnp.isfinite(heights), heights, -jnp.inf)
    left = jnp.concatenate([jnp.full_like(known[:, :1], -jnp.inf), known[:, :-1]], axis=1)
    right = jnp.concatenate([known[:, 1:], jnp.full_like(known[:, :1], -jnp.inf)], axis=1)
    tops = jnp.where((known >= left) & (known >= right), known, -jnp.inf)
    step, part = jnp.divmod(lax.top_k(tops.ravel(), _PEAKS)[1], _PARTS + 1)
    return _Place(step, parts[jnp.maximum(part - 1, 0)], parts[jnp.minimum(part + 1, _PARTS)])


def _magnitude(course: Course, step: Array, part: Scalar) -> Scalar:
    """The magnitude of the friction force [N] `part` of the way through a step."""
    steps, following = (jax.tree.map(lambda column, i=i: column[i], course.run.steps) for i in (step, step + 1))
    moved = following.origin + following.t_local - steps.origin - steps.t_local
    # In value the step's own length, free of the rounding of times; in derivative how the two ends move apart.
    moved = jnp.where(step + 1 < course.run.count, moved, steps.duration)
    elapsed = part * (steps.duration + moved - lax.stop_gradient(moved))
    x = jnp.polyval(steps.polynomials.T[::-1], elapsed)
    restored = lambda leaves: jax.tree.unflatten(jax.tree.structure(course.system.initial()), list(leaves))
    segment = cast(Segment, course.moving.segment(steps.index))
    state = course.system.exact(segment, steps.t_local, restored(steps.x), elapsed, restored(x))
    return jnp.abs(course.system.force(segment, steps.t_local + elapsed, state, steps.mode))
