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
from ...integration import AbstractHybridSystem, Accuracy, SteppedRun, Taylor
from ...metrics import FLANK, CycleMetrics, cycle_metrics
from ...simulation import StickSlip, StickSlipState

SIDE_BY_SIDE = Taylor(16)
"""Steps of points side by side, where all that an order adds is computed: finer series would gain nothing."""

FINE = Accuracy(tolerance=1e-17, settle_tolerance=1e-15)
"""Of a course: derivatives of a net step that is the difference of far longer motions are lost in coarser steps."""

_LINE = 6
"""Samples by which the line of a flank is found."""

_INSIDE = 1e-6
"""How far inside the fitted part they stay, in parts of a flank: rounding must not put one outside."""

_PARTS = np.linspace(FLANK[0] + _INSIDE, FLANK[1] - _INSIDE, _LINE)
"""Of the way that the voltage goes along the flank, where the samples are."""


class Metric(NamedTuple):
    """What is measured at each point."""

    unit: str
    """In SI."""
    says: str
    """In words."""
    by: str = ""
    """Of a derivative, the path by which it is taken."""


METRICS = {
    "net_step": Metric("m", "net step of a cycle"),
    "speed": Metric("m/s", "average speed"),
    "efficiency": Metric("1", "step efficiency (3.1)"),
    "stroke": Metric("m", "stroke of the stick phase"),
    "back_slip": Metric("m", "back-slip"),
}
"""What every cycle has, by the names of `pdssjax.metrics.CycleMetrics`."""


OF_FLANKS = "efficiency", "stroke", "back_slip"
"""Those of a cycle that is a slow and a fast flank."""


class Opening(NamedTuple):
    """Where a course begins."""

    x: Float[Array, " components"]
    """The state; at rest, or just before the corner that opens a cycle that repeats."""
    repeats: Count
    """After how many cycles the motion is there again; 0 where that is not asked, or where it is not."""
    multiplier: Scalar
    """Modulus of the largest Floquet multiplier; NaN: there is no orbit, or it grazes."""
    grazing: Scalar
    """How near a reversal of the orbit that Newton's method found is to grazing; where it grazes, this is the opening
    of integrated cycles instead.  NaN: there is none that attracts."""
    failure: Count
    """Index into `pdssjax.integration.FAILURES`."""


class Course(NamedTuple):
    """One cycle, or all those after which a motion repeats, integrated with room for what tells the last slip."""

    system: StickSlip
    moving: AbstractHybridSystem
    """What was integrated: the system, or the system from the opening of a cycle on."""
    run: SteppedRun
    begin: Scalar
    """When the first of the cycles opens, on the clock of `moving` [s]."""
    span: Count
    """How many there are."""
    most: int
    """How many there may be."""
    failure: Count
    """Index into `pdssjax.integration.FAILURES`."""


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
        """The `metrics`, and an index into `pdssjax.integration.FAILURES`; points are side by side."""

    @abc.abstractmethod
    def opening(self, system: StickSlip) -> Opening:
        """Where the measured motion begins, found finely; not differentiable."""

    @abc.abstractmethod
    def course(self, system: StickSlip, opening: Opening) -> Course:
        """The measured motion with all its steps, finely integrated: for further metrics and for derivatives.

        Differentiable in every floating-point leaf of `system`, and in the state of an `opening` that repeats.
        """

    def moved_opening(
        self,
        system: StickSlip,
        opening: Opening,
        monodromy: Float[Array, "components components"],
        driven: Float[Array, "components by"],
    ) -> Float[Array, "components by"]:
        """Derivatives of the opening's state, given those of the state that ends the course; at rest there are none."""
        return jnp.zeros_like(driven)

    def unfinished(self, found: Float[np.ndarray, "points metrics"]) -> Bool[np.ndarray, " points"]:
        """Which points are worth a `patient` look; none by default."""
        return np.zeros(len(found), bool)

    def patient(self, system: StickSlip, accuracy: Accuracy) -> tuple[Float[Array, " metrics"], Count]:
        """As `measure`, for the few points that are `unfinished`; one after the other.  Fails with `GRAZING`, too."""
        return self.measure(system, accuracy)


class Timing(NamedTuple):
    """When the cycles of a drive are measured."""

    frequency: Scalar
    """Cycles a second [Hz]."""
    fall: Scalar
    """Duration of the fast flank [s], with which a cycle begins."""
    phases: Float[Array, " line"]
    """Sample times [s] within a cycle, on its slow flank: evenly by the voltage."""
    has_flanks: bool
    """The cycle is a slow and a fast flank."""

    @property
    def period(self) -> Scalar:
        """Of the drive [s]."""
        return 1.0 / self.frequency


def timing(drive: AbstractDrive) -> Timing:
    """When the cycles of a periodic `drive` are measured."""
    frequency, flanks = jnp.asarray(drive.cycle_frequency(), float), drive.flanks()
    fall = jnp.zeros(()) if flanks is None else jnp.asarray(flanks.fast, float)
    phases = fall + (1.0 / frequency - fall) * drive.slow_flank_times(_PARTS)
    return Timing(frequency, fall, phases, flanks is not None)


def cycles_at(when: Timing, effector: Float[Array, "flanks line"]) -> CycleMetrics:
    """Of each cycle but the last, from the `effector` [m] at the phases of the slow flanks.

    The stroke is what the end-effector moves with the voltage along the flank, times the flank's whole voltage: as if
    the flank were straight, where it is not.  Without a slow and a fast flank there are no stroke, back-slip and
    efficiency: NaN.
    """
    straight = when.fall + (when.period - when.fall) * _PARTS
    times = (jnp.arange(len(effector))[:, None] * when.period + straight).ravel()
    found = cycle_metrics(times, effector.ravel(), when.frequency, 0.0, len(effector) - 1, when.fall)
    if when.has_flanks:
        return found
    return found._replace(**dict.fromkeys(OF_FLANKS, jnp.full_like(found.stroke, jnp.nan)))


def effector_at(system: StickSlip, x: StickSlipState[Float[Array, " m"]]) -> Float[Array, " m"]:
    """Displacement [m] of the end-effector in many states."""
    y, _ = jax.vmap(system.actuator.driven_platform.platform)(x.driven)
    return y - x.d
