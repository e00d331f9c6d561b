"""The steady motion of an actuator, after the transient has died out."""

import dataclasses
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jax.core import Tracer

from ..actuator import Actuator
from ..core import InputError, Scalar, ScalarLike, as_single, check_kind, require_float64
from ..drive.base import AbstractDrive
from ..integration import AbstractHybridSystem, Accuracy, SteadyState, restarted, steady_state
from .grazing_reversals import grazing
from .systems.stick_slip import StickSlip

TOLERANCE = 1e-12
"""How far [m] a steady cycle may be from repeating."""

_STEPS = 8192
"""Room for the steps of three cycles."""


def steady_cycle(
    actuator: Actuator, drive: AbstractDrive, accuracy: Accuracy | None = None, tolerance: ScalarLike = TOLERANCE
) -> SteadyState:
    """The motion of `actuator` under a periodic `drive` after the transient, with its multipliers.

    Differentiable in every parameter of `actuator` and `drive`; works under `jit`, `vmap`, `jvp` and `jacfwd`, on a
    CPU.  Where the motion repeats neither in every cycle nor in every second or third, `period` is 0.  Where a
    reversal grazes, the motion is that of integrated cycles, and its derivatives and multipliers are NaN.

    It is compiled once for models of one kind, whatever their numbers.

    **Raises:** `InputError` that names the argument for one of another kind, for a drive that never repeats, for a
    quantity that is an array of several numbers or outside its legal range, and where JAX works in single precision.
    """
    require_float64("steady_cycle")
    fine = Accuracy(max_steps=_STEPS) if accuracy is None else accuracy
    actuator, drive, fine = checked_arguments(actuator, drive, fine)
    check_repeats(drive)
    return _steady_cycle(actuator, drive, fine, jnp.asarray(tolerance, float))


@eqx.filter_jit
def _steady_cycle(actuator: Actuator, drive: AbstractDrive, fine: Accuracy, tolerance: Scalar) -> SteadyState:
    """The result of `steady_cycle`, compiled."""
    frequency = drive.cycle_frequency()
    assert frequency is not None
    system = StickSlip(actuator, drive)
    nearness = partial(grazing, lax.stop_gradient(system))
    return steady_state(system, 1.0 / jnp.asarray(frequency, float), fine, tolerance, nearness)


def checked_arguments(
    actuator: Actuator, drive: AbstractDrive, accuracy: Accuracy
) -> tuple[Actuator, AbstractDrive, Accuracy]:
    """Arguments of a steady cycle, with quantities as one simulation takes them (`pdssjax.core.as_single`).

    **Raises:** `InputError` that names the argument for one of another kind, and the quantity for one that is no
    single number within its legal range, or contradicts another of the drive, as far as they are known: those that
    JAX traces are not.
    """
    check_kind("actuator", actuator, Actuator)
    check_kind("drive", drive, AbstractDrive, "pdssjax.drive.sawtooth.Sawtooth(voltage=64.0)")
    check_kind("accuracy", accuracy, Accuracy)
    actuator, drive = as_single(actuator, "actuator"), as_single(drive, "drive")
    if not any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(drive)):
        for field, clause in drive.broken_conditions().items():
            raise InputError(f"drive.{field}: found {clause}.")
    return actuator, drive, accuracy


def check_repeats(drive: AbstractDrive) -> None:
    """**Raises** `InputError` for a `drive` that has no cycle."""
    if drive.cycle_frequency() is None or drive.period() is None:
        raise InputError(f"drive: found {drive!r:.80}, expected one that repeats, with a frequency.")


def steady_system(
    actuator: Actuator, drive: AbstractDrive, accuracy: Accuracy
) -> tuple[AbstractHybridSystem, SteadyState]:
    """The actuator from the opening of a steady cycle on, and that cycle; the end-effector is at 0 then."""
    found = steady_cycle(actuator, drive, dataclasses.replace(accuracy, max_steps=min(accuracy.max_steps, _STEPS)))
    system = StickSlip(actuator, drive)
    if actuator.stop is not None:
        return restarted(system, found.x), found
    state = jax.tree.unflatten(jax.tree.structure(system.initial()), list(found.x))
    return restarted(system, found.x.at[0].set(actuator.driven_platform.platform(state.driven)[0])), found
