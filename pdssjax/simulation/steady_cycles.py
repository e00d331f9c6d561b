"""The steady motion of an actuator: what is left of it when the transient has died out."""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ..actuator import Actuator
from ..core import ScalarLike, need_double_precision
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

    **Raises:** `ValueError` for a drive that never repeats.
    """
    need_double_precision()
    frequency = drive.cycle_frequency()
    if frequency is None or drive.period() is None:
        raise ValueError("Expected a drive that repeats, but its cycle has no frequency.")
    fine = Accuracy(max_steps=_STEPS) if accuracy is None else accuracy
    system = StickSlip(actuator, drive)
    nearness = partial(grazing, lax.stop_gradient(system))
    return steady_state(system, 1.0 / jnp.asarray(frequency, float), fine, tolerance, nearness)


def steady_system(
    actuator: Actuator, drive: AbstractDrive, accuracy: Accuracy
) -> tuple[AbstractHybridSystem, SteadyState]:
    """The actuator from the opening of a steady cycle on, and that cycle; the end-effector is at 0 then."""
    found = steady_cycle(actuator, drive, dataclasses.replace(accuracy, max_steps=min(accuracy.max_steps, _STEPS)))
    system = StickSlip(actuator, drive)
    x = found.x if actuator.stop is not None else found.x.at[0].set(_platform(system, found.x))
    return restarted(system, x), found


def _platform(system: StickSlip, x: Float[Array, " components"]) -> Array:
    state = jax.tree.unflatten(jax.tree.structure(system.initial()), list(x))
    return system.actuator.driven_platform.platform(state.driven)[0]
