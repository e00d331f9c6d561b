"""Simulates one actuator under one drive."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .actuator import Actuator, StickSlip
from .drive.base import AbstractDrive
from .integration import FAILURES, Accuracy, March, march, states_at


class Trajectory(NamedTuple):
    """A simulated run; arrays of shape (m,), SI units, one entry a sample time."""

    time: Float[Array, " m"]
    voltage: Float[Array, " m"]
    platform: Float[Array, " m"]
    effector: Float[Array, " m"]
    platform_velocity: Float[Array, " m"]
    effector_velocity: Float[Array, " m"]
    friction: Float[Array, " m"]
    """Friction force on the end-effector [N]."""
    steps: Int[Array, ""]
    """Steps accepted; repeated periods are not stepped again."""
    rejected: Int[Array, ""]
    events: Int[Array, ""]
    """Switches of the mode that were located: reversals, sticking, letting go."""
    repeated: Bool[Array, ""]
    """The steady cycle was reached, and the later ones are copies of it."""
    failure: Int[Array, ""]
    """0, or an index into `pdssjax.integration.FAILURES`; the displacements are then NaN."""

    @property
    def message(self) -> str:
        """Why the run did not finish; empty where it did.  Not under jit."""
        return FAILURES[int(self.failure)]


def simulate(
    actuator: Actuator,
    drive: AbstractDrive,
    times: Float[Array, " m"],
    accuracy: Accuracy | None = None,
    *,
    clamped: bool = False,
) -> Trajectory:
    """The motion of `actuator` under `drive`, from rest at t = 0, at `times` [s].

    **Arguments:** `times` ascend; those before 0 see the actuator at rest.  `clamped`
    leaves the end-effector out: the platform alone, exact without friction feedback.

    Differentiable in every parameter of `actuator` and `drive`; works under `jit`,
    `vmap`, `jvp` and `grad`.  A run that cannot finish gives NaN and says why in `failure`.
    """
    system = StickSlip(actuator, drive, clamped)
    times = jnp.asarray(times, float)
    run = march(system, times[-1], accuracy or Accuracy())
    return observe(system, run, times)


def observe(system: StickSlip, run: March, times: Float[Array, " m"]) -> Trajectory:
    """A march seen at sample times."""
    x, segment, after, mode = states_at(system, run, times)
    started = (times >= 0) & (run.failure == 0)
    quiet = jnp.where(run.failure == 0, 0.0, jnp.nan)
    shown = lambda value: jnp.where(started, value, quiet)
    friction = system.force(segment, after, x, mode)
    return Trajectory(
        time=times,
        voltage=system.drive.at(times),
        platform=shown(x.y),
        effector=shown(x.y - x.d),
        platform_velocity=shown(x.w),
        effector_velocity=shown(x.w - x.v),
        friction=shown(friction),
        steps=run.count,
        rejected=run.rejected,
        events=run.events,
        repeated=run.repeats,
        failure=run.failure,
    )
