"""Setups: how a record is made, as the hybrid system of a rig's numbers and what the sensor shows of it.

The leaves of a setup are numbers, so that records whose setups differ in nothing else share what is compiled.
"""

import abc
import dataclasses

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from ..drive.base import AbstractDrive
from ..integration import AbstractHybridSystem, Accuracy
from ..simulation import DISPLACEMENT, FRICTION_FORCE, STOP_FORCE, Output, PlatformOnly, PrescribedMotion, StickSlip
from .models import Models, Values


class Run(eqx.Module):
    """The excitation of the rig in a record, and the times of its samples."""

    drive: AbstractDrive | None
    """The voltage from t = 0 on; None where nothing is driven."""
    times: Float[Array, " samples"]
    """Sample times [s]."""
    motion: Float[Array, " samples"] | None
    """The relative displacement prescribed [m]; None where it is free."""


class AbstractSetup(eqx.Module):
    """One way to make a record, without the numbers of the rig."""

    output: eqx.AbstractVar[Output]
    """Output of the sensor; static."""

    @abc.abstractmethod
    def system(self, models: Models, values: Values, run: Run) -> AbstractHybridSystem:
        """The hybrid system that moves in `run`, with the parameters `values` [SI]."""

    def times(self, run: Run) -> Float[Array, " samples"]:
        """The sample times [s] on the clock of the system, which starts at 0."""
        return run.times

    def segments(self, drive: AbstractDrive | None, times: Float[np.ndarray, " samples"]) -> int:
        """How many segments of the drive, or of the motion prescribed, the `times` [s] reach into; not traced."""
        return times.size if drive is None else drive.segments(float(times[-1]))

    def goes_on_moving(self, models: Models) -> bool:
        """Nothing settles between two corners of the drive, so that steps are many."""
        return not models.piezo.has_steady_state


class PlatformAlone(AbstractSetup):
    """The platform, without an end-effector that it could feel."""

    output: Output = eqx.field(static=True, default=DISPLACEMENT)

    def system(self, models: Models, values: Values, run: Run) -> AbstractHybridSystem:
        return PlatformOnly(models.actuator(values).driven_platform, _driven(run), models.sensor(values))


class FreeActuator(AbstractSetup):
    """Platform and end-effector, which moves freely."""

    output: Output = eqx.field(static=True, default=DISPLACEMENT)
    on_platform: float = 0.0
    """1 where the sensor looks at the platform, 0 at the end-effector."""

    def system(self, models: Models, values: Values, run: Run) -> AbstractHybridSystem:
        return StickSlip(models.actuator(values), _driven(run), models.sensor(values), self.on_platform)


class BlockedActuator(AbstractSetup):
    """Platform and end-effector, which runs against a stop."""

    output: Output = eqx.field(static=True, default=STOP_FORCE)

    def system(self, models: Models, values: Values, run: Run) -> AbstractHybridSystem:
        return StickSlip(models.actuator(values, blocked=True), _driven(run), models.sensor(values))

    def goes_on_moving(self, models: Models) -> bool:
        # Pressed by a platform that creeps on, the stop's force keeps rising.
        return True


class ContactAlone(AbstractSetup):
    """The contact under a prescribed relative motion."""

    output: Output = eqx.field(static=True, default=FRICTION_FORCE)

    def system(self, models: Models, values: Values, run: Run) -> AbstractHybridSystem:
        if run.motion is None:
            raise ValueError("Expected a prescribed motion, but the run has none.")
        return PrescribedMotion(models.contact(values), self.times(run), run.motion)

    def times(self, run: Run) -> Float[Array, " samples"]:
        return run.times - run.times[0]

    def goes_on_moving(self, models: Models) -> bool:
        return False


def sensor_on(on_platform: float, output: Output, models: Models) -> AbstractSetup:
    """A sensor that looks at the platform (`on_platform` 1) or the end-effector (0) of a free actuator.

    A platform that feels no friction moves without the end-effector.
    """
    alone = on_platform == 1.0 and not models.feedback
    return PlatformAlone(output) if alone else FreeActuator(output, on_platform)


def _driven(run: Run) -> AbstractDrive:
    if run.drive is None:
        raise ValueError("Expected a drive, but the run has none.")
    return run.drive


def with_room(accuracy: Accuracy, setup: AbstractSetup, models: Models, segments: int, duration: float) -> Accuracy:
    """`accuracy` with room for the steps that a record of `duration` [s] may take, which reaches into `segments`."""
    # Where there are more than 400 segments each is short and takes a few steps only.
    few = min(segments, 400)
    room = 200 * few + 8 * (segments - few) + 1000
    if setup.goes_on_moving(models):
        # For transients that die out at up to 18 000 a second, by the `span` of a step.
        room += int(6000 * duration)
    return dataclasses.replace(accuracy, max_steps=max(room, accuracy.max_steps))
