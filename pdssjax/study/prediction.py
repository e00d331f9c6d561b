"""The prediction of a record: the system that moves in it, and what the sensor shows of that.

A setup makes the hybrid system of a record out of the numbers of the rig; `pdssjax.simulation.sensor_samples`
integrates it (or takes its closed form) and shows, at the sample times, what its `Output` names: of `DISPLACEMENT`
the system's `shown_displacement`.  Records that share a shape (`record_groups`) are run one after the other in one
compiled function; the leaves of a setup are numbers, so that those whose setups differ in nothing else share it.
"""

import abc
import dataclasses
from collections.abc import Callable, Sequence
from typing import Protocol

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from ..core import Count, Truth
from ..drive.base import AbstractDrive
from ..integration import AbstractHybridSystem, Accuracy
from ..simulation import (
    DISPLACEMENT,
    FRICTION_FORCE,
    STOP_FORCE,
    Output,
    PlatformOnly,
    PrescribedMotion,
    StickSlip,
    sensor_samples,
    why_failed,
)
from .conditions import under_conditions
from .models import Models, Values
from .record_groups import RecordedRun, RecordGroup, Run, record_groups

_STEPS_PER_SEGMENT = 200

_MANY = 400
"""Segments of a drive from which on each is short and takes a few steps only."""

_SPARE_STEPS = 1000

_STEPS_WHERE_MANY = 8

_STEPS_A_SECOND = 6000
"""Where nothing settles: for transients that die out at up to 18 000 a second, by the `span` of a step."""


class AbstractSetup(eqx.Module):
    """One way to make a record, without the numbers of the rig."""

    output: eqx.AbstractVar[Output]
    """What the sensor shows; static."""

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


class HasSetup(Protocol):
    """What is asked of a measurement: `pdssjax.study.AbstractMeasurement` has it."""

    def setup(self, models: Models) -> AbstractSetup:
        """How a record of it is predicted."""
        ...


class PredictedRecord(RecordedRun, Protocol):
    """What is asked of a record: `pdssjax.study.Record` has it."""

    @property
    def measurement(self) -> HasSetup:
        """What was measured."""
        ...


class Lowered(Protocol):
    """A function that has been traced."""

    def compile(self) -> object:
        """Compiles it, for all that call it afterwards."""
        ...


class Predictor(eqx.Module):
    """Sample values of every record as a function of the parameters."""

    models: Models
    groups: tuple[RecordGroup[AbstractSetup], ...]
    samples: tuple[int, ...] = eqx.field(static=True)
    """How many each record has."""

    def __init__(self, models: Models, records: Sequence[PredictedRecord]):
        self.models = models
        self.samples = tuple(record.time.size for record in records)
        setups = [record.measurement.setup(models) for record in records]
        # What is known of the records is numbers, also where a prediction that is being traced needs them first.
        with jax.ensure_compile_time_eval():
            segments = [setup.segments(r.drive, r.time) for setup, r in zip(setups, records, strict=True)]
            self.groups = record_groups(records, setups, segments)

    def __call__(
        self, values: Values, accuracy: Accuracy, used: Bool[Array | np.ndarray, " records"] | None = None
    ) -> list[Float[Array, " samples"]]:
        """One array a record, in the order of the records, without offsets, in its unit.

        Those that are not `used` are not simulated, and zero; None for all.
        """
        rows = _of_each_record(sensor_samples, self, values, accuracy, used)
        return [row[:samples] for row, samples in zip(rows, self.samples, strict=True)]


@eqx.filter_jit
def predicted(predictor: Predictor, values: Values, accuracy: Accuracy) -> list[Float[Array, " samples"]]:
    """What `predictor` gives, compiled."""
    return predictor(values, accuracy)


@eqx.filter_jit
def failures(predictor: Predictor, values: Values, accuracy: Accuracy) -> list[Count]:
    """For each record an index into `pdssjax.integration.FAILURES`: why it cannot be predicted; 0 where it can."""
    return _of_each_record(why_failed, predictor, values, accuracy)


def _of_each_record(
    ask: Callable[..., Array],
    predictor: Predictor,
    values: Values,
    accuracy: Accuracy,
    used: Bool[Array | np.ndarray, " records"] | None = None,
) -> list[Array]:
    """What `ask` (`sensor_samples`, `why_failed`) gives of each record, in the order of the records; 0 if not used."""
    found: dict[int, Array] = {}
    for group in predictor.groups:
        asked = None if used is None else jnp.asarray(used)[jnp.asarray(group.places)]
        found |= dict(zip(group.places, _of_group(ask, group, predictor.models, values, accuracy, asked), strict=True))
    return [found[place] for place in sorted(found)]


def _of_group(
    ask: Callable[..., Array],
    group: RecordGroup[AbstractSetup],
    models: Models,
    values: Values,
    accuracy: Accuracy,
    used: Bool[Array, " records"] | None,
) -> Array:
    """The same of the records of a group, one after the other, stacked."""
    roomy = with_room(accuracy, group.setups, models, group.segments, group.duration)

    def of_record(
        setup: AbstractSetup, run: Run, overrides: dict[str, Truth], conditions: dict[str, Truth], use: Truth | None
    ) -> Array:
        numbers = under_conditions(values, conditions)
        run = dataclasses.replace(run, drive=_shared(run.drive, overrides, numbers))

        def asked() -> Array:
            system = setup.system(models, numbers, run)
            return ask(system, setup.times(run), roomy, setup.output, group.segments)

        # A fit of some records compiles what one of all of them does, and runs no more than it needs.
        return asked() if use is None else lax.cond(use, asked, lambda: jnp.zeros(run.times.shape))

    records = group.setups, group.runs, group.overrides, group.conditions, used
    return lax.map(lambda args: of_record(*args), records)


def with_room(accuracy: Accuracy, setup: AbstractSetup, models: Models, segments: int, duration: float) -> Accuracy:
    """`accuracy` with room for the steps that a record of `duration` [s] may take, which reaches into `segments`."""
    few = min(segments, _MANY)
    room = _STEPS_PER_SEGMENT * few + _STEPS_WHERE_MANY * (segments - few) + _SPARE_STEPS
    if setup.goes_on_moving(models):
        room += int(_STEPS_A_SECOND * duration)
    return dataclasses.replace(accuracy, max_steps=max(room, accuracy.max_steps))


def _shared(drive: AbstractDrive | None, overrides: dict[str, Truth], values: Values) -> AbstractDrive | None:
    """`drive` with the study's numbers in place of those that the record does not set itself."""
    if drive is None:
        return None
    numbers = drive.numbers()
    paths = {field: path for field in overrides if (path := f"drive.{field}") in values}
    return drive.with_numbers({f: jnp.where(overrides[f], numbers[f], values[path]) for f, path in paths.items()})
