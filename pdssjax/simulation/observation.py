"""What a sensor shows of a system and what moves inside it, from one integration."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..drive.base import AbstractDrive
from ..integration import FAILURES, Accuracy, Visited, exact_states_at, integrate_steps, is_closed, states_at
from .sensor_output import Output, System, from_rest
from .systems.platform_only import PlatformOnly
from .systems.prescribed_motion import PrescribedMotion


class Inside(NamedTuple):
    """What moves within a system; arrays of shape (k,), SI, NaN where the system has no such part."""

    voltage: Float[Array, " k"]
    """The command [V]."""
    platform: Float[Array, " k"]
    """[m]"""
    platform_velocity: Float[Array, " k"]
    relative: Float[Array, " k"]
    """Displacement of the contact, y - x_e [m]: of the platform relative to the end-effector."""
    relative_velocity: Float[Array, " k"]
    friction: Float[Array, " k"]
    """Friction force on the end-effector [N]."""


class Observation(NamedTuple):
    """What the sensor shows of one run, and what moves inside."""

    shown: Float[Array, " m"]
    """What the sensor shows, in the unit of the record."""
    between: Float[Array, " k"]
    """The same at the instants at which the inside is looked at."""
    inside: Inside
    steps: Int[Array, ""]
    """Accepted; 0 where nothing was integrated."""
    failure: Int[Array, ""]
    """0, or an index into `pdssjax.integration.FAILURES`; all is NaN then."""

    @property
    def message(self) -> str:
        """Why the run did not finish; empty where it did.  Not under jit."""
        return FAILURES[int(self.failure)]


def observe(
    system: System,
    output: Output,
    times: Float[Array, " m"],
    instants: Float[Array, " k"],
    accuracy: Accuracy,
    segments: int,
) -> Observation:
    """What `output` shows of `system` at `times` [s], and what moves inside at `instants` [s], both ascending.

    **Arguments:** no instant is later than the last of the `times`; `segments` is how many segments of the drive the
    times may reach into.  Works under `jit` and `vmap`.  A run that cannot finish is NaN.
    """
    seen = times - output.delay(system)
    if is_closed(system):
        at = lambda when: exact_states_at(system, jnp.maximum(when, 0.0), segments)
        steps = failure = jnp.zeros((), int)
    else:
        run = integrate_steps(system, times[-1], accuracy)
        at, steps, failure = partial(states_at, system, run), run.count, run.failure
    sensed = lambda visited: jax.vmap(partial(output.shown, system))(visited[1], visited[2], visited[0], visited[3])
    late = instants - output.delay(system)
    return Observation(
        from_rest(seen, failure)(sensed(at(seen))),
        from_rest(late, failure)(sensed(at(late))),
        _inside(system, at(instants), instants, failure),
        steps,
        failure,
    )


def _inside(system: System, states: Visited, instants: Float[Array, " k"], failure: Int[Array, ""]) -> Inside:
    x, segment, t_local, mode = states
    show, none = from_rest(instants, failure), jnp.full_like(instants, jnp.nan)
    if isinstance(system, PrescribedMotion):
        force = jax.vmap(system.force)(segment, t_local, x, mode)
        return Inside(none, none, none, show(x[0]), show(segment.slope), show(force))
    y, w = jax.vmap(_driven_platform(system).platform)(x.driven)
    drive: AbstractDrive = system.drive
    platform = drive.at(instants), show(y), show(w)
    if isinstance(system, PlatformOnly):
        return Inside(*platform, none, none, none)
    force = jax.vmap(system.force)(segment, t_local, x, mode)
    return Inside(*platform, show(x.d), show(x.v), show(force))


def _driven_platform(system: System) -> System:
    return system.driven_platform if isinstance(system, PlatformOnly) else system.actuator.driven_platform
