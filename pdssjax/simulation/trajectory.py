"""Simulates one actuator under one drive."""

from typing import TYPE_CHECKING, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..actuator import Actuator, DrivenPlatform
from ..core import Figure, InputError, ascending_times, kept_jit, presenter, require_float64
from ..drive.base import AbstractDrive
from ..integration import FAILURES, Accuracy, sample_run
from ..piezo.base import AbstractPiezo
from .sensor_output import from_rest, sensor_samples
from .steady_cycles import check_repeats, checked_arguments, steady_system
from .systems.platform_only import PlatformOnly
from .systems.stick_slip import StickSlip

if TYPE_CHECKING:
    import xarray

TRAJECTORY_UNITS = {
    "voltage": "V",
    "platform": "m",
    "effector": "m",
    "platform_velocity": "m/s",
    "effector_velocity": "m/s",
    "friction": "N",
}
"""SI unit of every channel of a `Trajectory`."""


class Trajectory(NamedTuple):
    """A simulated run; arrays of shape (m,), SI units, one entry a sample time."""

    time: Float[Array, " m"]
    voltage: Float[Array, " m"]
    """The command; an amplifier's output follows it."""
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
    """The steady cycle was reached, and the later ones are copies of it; of a steady motion, that it repeats."""
    failure: Int[Array, ""]
    """0, or an index into `pdssjax.integration.FAILURES`; the motion is then NaN."""
    grazing: Float[Array, ""] | None = None
    """Distance from grazing of the nearest reversal of a steady motion, 0 (it grazes) to 1, NaN where it
    does not repeat.  Below `pdssjax.integration.GRAZES` the motion is the last of many cycles, without derivatives."""

    @property
    def message(self) -> str:
        """Why the run did not finish; empty where it did.  Not under jit."""
        return FAILURES[int(self.failure)]

    def _repr_html_(self) -> str:
        return presenter().as_html(self)

    def plot(self) -> Figure:
        """A figure of matplotlib: voltage, displacements and friction force against time.  Not under jit.

        **Raises:** `InputError` for several runs side by side (of `vmap`).
        """
        return presenter().as_figure(self)

    def to_xarray(self) -> "xarray.Dataset":
        """The run as an `xarray.Dataset`, its channels of shape (m,) over `time` [s], units as attributes, SI.

        The attributes tell `steps`, `events` and, where the run could not finish, `failure` in words.  Not under jit.

        **Raises:** `InputError` for several runs side by side (of `vmap`).
        """
        import xarray

        if np.ndim(self.time) != 1:
            raise InputError(f"to_xarray: found runs of shape {np.shape(self.effector)}, expected a single one.")
        data = {
            name: ("time", np.asarray(getattr(self, name)), {"units": unit, "long_name": name.replace("_", " ")})
            for name, unit in TRAJECTORY_UNITS.items()
        }
        time = ("time", np.asarray(self.time), {"units": "s", "long_name": "time"})
        told = {"steps": int(self.steps), "events": int(self.events), "failure": self.message}
        return xarray.Dataset(data, {"time": time}, told)


def simulate(
    actuator: Actuator,
    drive: AbstractDrive,
    times: Float[Array, " m"],
    accuracy: Accuracy | None = None,
    cycles: Literal["steady"] | None = None,
) -> Trajectory:
    """The motion of `actuator` under `drive`, from rest at t = 0, at `times` [s].

    **Arguments:** `times` ascend, shape (m,); those before 0 see the actuator at rest.  With `cycles="steady"` it is
    the motion that is left when the transient has died out: t = 0 opens one of its cycles, with the end-effector at 0,
    and `repeated` says whether the motion repeats at all, after 1, 2 or 3 cycles (`steady_cycle` tells more), and
    `grazing` whether it has derivatives (else they are NaN).

    Differentiable in every parameter of `actuator` and `drive`; works under `jit`,
    `vmap`, `jvp` and `grad`.  A run that cannot finish gives NaN and says why in `failure`.  The program is compiled
    once per kind of models and number of sample times, whatever the parameter values, under `jit` or not.

    **Raises:** `InputError` that names the argument for one of another kind, for times that are not of shape (m,) or
    descend, for a quantity that is an array of several numbers or outside its legal range, for a drive that never
    repeats with `cycles="steady"`, and where JAX works in single precision.
    """
    require_float64("simulate")
    actuator, drive, fine = checked_arguments(actuator, drive, accuracy or Accuracy())
    if cycles not in (None, "steady"):
        raise InputError(f'cycles: found {cycles!r:.80}, expected "steady", or None for the motion from rest.')
    if cycles == "steady":
        check_repeats(drive)
    return _simulated(actuator, drive, ascending_times("times", times), fine, cycles)


@kept_jit
def _simulated(
    actuator: Actuator,
    drive: AbstractDrive,
    times: Float[Array | np.ndarray, " m"],
    fine: Accuracy,
    cycles: Literal["steady"] | None,
) -> Trajectory:
    """The result of `simulate`, compiled once for all numbers of the models."""
    system, times = StickSlip(actuator, drive), jnp.asarray(times, float)
    if cycles is None:
        run, time_of_drive = sample_run(system, times, fine), times
        repeated, grazing = run.repeats, None
    else:
        in_steady_cycle, steady = steady_system(actuator, drive, fine)
        # A drive repeats from its second cycle on: the first may lack the fast flank.
        time_of_drive = times + 1.0 / jnp.asarray(drive.cycle_frequency(), float)
        run = sample_run(in_steady_cycle, times, fine)
        repeated, grazing = steady.period > 0, steady.grazing
    x, segment, t_local, mode = run.states
    masked = from_rest(times, run.failure)
    friction = jax.vmap(system.force)(segment, t_local, x, mode)
    y, w = jax.vmap(actuator.driven_platform.platform)(x.driven)
    return Trajectory(
        time=times,
        voltage=drive.at(time_of_drive),
        platform=masked(y),
        effector=masked(y - x.d),
        platform_velocity=masked(w),
        effector_velocity=masked(w - x.v),
        friction=masked(friction),
        steps=run.count,
        rejected=run.rejected,
        events=run.events,
        repeated=repeated,
        failure=run.failure,
        grazing=grazing,
    )


def displacements(
    actuator: Actuator, drive: AbstractDrive, times: Float[Array, " m"], accuracy: Accuracy
) -> tuple[Float[Array, " m"], Float[Array, " m"]]:
    """True platform and end-effector displacement [m] only, at less cost than `simulate`."""
    system = StickSlip(actuator, drive)
    keep = system.output_components()
    run = sample_run(system, times, accuracy, keep)
    x = run.states.x
    y, _ = jax.vmap(actuator.driven_platform.platform)(x.driven)
    masked = from_rest(times, run.failure)
    return masked(y), masked(y - x.d)


def platform(
    piezo: AbstractPiezo, drive: AbstractDrive, times: Float[Array, " m"], segments: int
) -> Float[Array, " m"]:
    """Platform displacement [m] of a `closed` piezo without friction feedback.

    **Arguments:** `segments` is how many segments of the drive the times may reach into.
    """
    return sensor_samples(PlatformOnly(DrivenPlatform(piezo), drive), times, Accuracy(), segments=segments)
