"""The contract of a measured cycle: what is found of a system at a point of a sweep."""

import abc
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...core import Count, Scalar
from ...drive.base import AbstractDrive
from ...integration import Accuracy
from ...metrics import FLANK
from ...simulation import StickSlip
from ...simulation.systems.stick_slip import State

_LINE = 6
"""Samples by which the line of a flank is found."""

_INSIDE = 1e-6
"""How far inside the fitted part they stay, in parts of a flank: rounding must not put one outside."""


class Metric(NamedTuple):
    """What is measured at each point."""

    unit: str
    """In SI."""
    says: str
    """In words."""


METRICS = {
    "net_step": Metric("m", "net step of a cycle"),
    "speed": Metric("m/s", "average speed"),
    "efficiency": Metric("1", "step efficiency (3.1)"),
    "stroke": Metric("m", "stroke of the stick phase"),
    "back_slip": Metric("m", "back-slip"),
}
"""What every cycle has, by the names of `pdssjax.metrics.CycleMetrics`."""


class AbstractCycle(eqx.Module):
    """A cycle of a motion, which is to be measured."""

    @property
    def metrics(self) -> dict[str, Metric]:
        """What is found, by name."""
        return METRICS

    @property
    @abc.abstractmethod
    def described(self) -> int | str:
        """As `sweep(cycles=...)` takes it."""

    @property
    @abc.abstractmethod
    def accuracy(self) -> Accuracy:
        """How finely to integrate where nothing else is said."""

    @abc.abstractmethod
    def measure(self, system: StickSlip, accuracy: Accuracy) -> tuple[Float[Array, " metrics"], Count]:
        """The `metrics`, and an index into `pdssjax.integration.solution.FAILURES`; points are side by side."""

    def unfinished(self, found: Float[np.ndarray, "points metrics"]) -> Bool[np.ndarray, " points"]:
        """Which points are worth a `patient` look; none by default."""
        return np.zeros(len(found), bool)

    def patient(self, system: StickSlip, accuracy: Accuracy) -> tuple[Float[Array, " metrics"], Count]:
        """As `measure`, for the few points that are `unfinished`; one after the other."""
        return self.measure(system, accuracy)


class Timing(NamedTuple):
    """When the cycles of a drive are measured."""

    frequency: Scalar
    """Cycles a second [Hz]."""
    fall: Scalar
    """Duration of the fast flank [s], with which a cycle begins."""
    phases: Float[Array, " line"]
    """Sample times [s] within a cycle, on its slow flank."""

    @property
    def period(self) -> Scalar:
        """Of the drive [s]."""
        return 1.0 / self.frequency


def timing(drive: AbstractDrive) -> Timing:
    """When the cycles of a periodic `drive` are measured."""
    frequency, flanks = jnp.asarray(drive.cycle_frequency(), float), drive.flanks()
    period = 1.0 / frequency
    fall = jnp.zeros(()) if flanks is None else jnp.asarray(flanks.fast, float)
    phases = fall + (period - fall) * jnp.linspace(FLANK[0] + _INSIDE, FLANK[1] - _INSIDE, _LINE)
    return Timing(frequency, fall, phases)


def effector_at(system: StickSlip, x: State[Float[Array, " m"]]) -> Float[Array, " m"]:
    """Displacement [m] of the end-effector in many states."""
    y, _ = jax.vmap(system.actuator.driven_platform.platform)(x.driven)
    return y - x.d
