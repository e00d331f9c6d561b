"""Predicts the records of a study, all that share a shape in one compiled function.

Platform records of a closed piezo without friction feedback come from the closed form; the
others are integrated.  Records of one waveform are stacked and run one after the other, so that
the compiler sees the integration once.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from ..drive.base import AbstractDrive
from ..integration import Accuracy, integrate
from ..simulation import PlatformOnly, PrescribedMotion, StickSlip, contact_force, measured, platform
from .models import Models, Values
from .record import Record
from .shared_drive import shared_fields

_STEPS_PER_SEGMENT = 200

_MANY = 400
"""Segments of a drive from which on each is short and takes a few steps only."""

_SPARE_STEPS = 1000

_STEPS_WHERE_MANY = 8

_STEPS_A_SECOND = 6000
"""Where nothing settles: for transients that die out at up to 18 000 a second, by the `span` of a step."""


class _Group(eqx.Module):
    """Records that share one compiled function: same waveform, same way to compute."""

    drives: AbstractDrive | None
    """Stacked: every leaf has one entry a record; a prescribed motion needs none."""
    overrides: dict[str, np.ndarray]
    """For each quantity of the drive, whether the record sets it itself."""
    times: np.ndarray
    """Shape (records, samples), each row filled up with its last time."""
    motion: np.ndarray | None
    """Prescribed relative displacement [m], shaped like `times`; of friction records only."""
    on_platform: np.ndarray
    places: tuple[int, ...] = eqx.field(static=True)
    """Where the records stand in the study."""
    samples: tuple[int, ...] = eqx.field(static=True)
    kind: str = eqx.field(static=True)
    """How it is computed: "closed", "unloaded", "stick-slip", "blocked" or "friction"."""
    duration: float = eqx.field(static=True)
    """When the last sample is taken [s]."""
    segments: int = eqx.field(static=True)
    """How many segments of the drive the longest record reaches into."""


class Predictor(eqx.Module):
    """Sample values of every record as a function of the parameters."""

    models: Models
    groups: tuple[_Group, ...]

    def __init__(self, models: Models, records: Sequence[Record]):
        self.models = models
        kinds: dict[Any, list[int]] = {}
        for place, record in enumerate(records):
            # Leaves of different sizes (sampled drives) cannot be stacked.
            shapes = tuple(np.shape(leaf) for leaf in jax.tree.leaves(record.drive))
            key = (type(record.drive), _kind(models, record), jax.tree.structure(record.drive), shapes)
            kinds.setdefault(key, []).append(place)
        # What is known of the records is numbers, also where a prediction that is being traced needs them first.
        with jax.ensure_compile_time_eval():
            self.groups = tuple(
                _group([records[i] for i in places], places, kind) for (_, kind, *_), places in kinds.items()
            )

    def __call__(self, values: Values, accuracy: Accuracy) -> list[Float[Array, " samples"]]:
        """One array a record, in the order of the records, without offsets [m or N]."""
        found: dict[int, Array] = {}
        for group in self.groups:
            rows = _predict(group, self.models, values, accuracy)
            for row, place, samples in zip(rows, group.places, group.samples, strict=True):
                found[place] = row[:samples]
        return [found[place] for place in sorted(found)]


@eqx.filter_jit
def predicted(predictor: Predictor, values: Values, accuracy: Accuracy) -> list[Array]:
    """What `predictor` gives, compiled."""
    return predictor(values, accuracy)


def _kind(models: Models, record: Record) -> str:
    if record.measures == "friction":
        return "friction"
    if record.measures == "force":
        return "blocked"
    if record.measures == "platform" and not models.feedback:
        return "closed" if models.closed else "unloaded"
    return "stick-slip"


def _predict(group: _Group, models: Models, values: Values, accuracy: Accuracy) -> Array:
    roomy = _roomy(group, models, accuracy)
    if group.kind == "friction":
        force = lambda args: contact_force(PrescribedMotion(models.contact(values), *args), args[0], roomy)
        return lax.map(force, _prescribed(group))

    def one(drive, overrides, times, on_platform):
        system = _system(group, models, values, _shared(drive, overrides, values), on_platform)
        if group.kind == "closed":
            return platform(system.driven_platform.piezo, system.drive, times - system.sensor.delay, group.segments)
        return measured(system, times, roomy)

    return lax.map(lambda args: one(*args), (group.drives, group.overrides, group.times, group.on_platform))


@eqx.filter_jit
def failures(predictor: Predictor, values: Values, accuracy: Accuracy) -> list[Array]:
    """For each record an index into `solution.FAILURES`: why it cannot be predicted; 0 where it can."""
    found: dict[int, Array] = {}
    for group in predictor.groups:
        found |= dict(zip(group.places, _failures(group, predictor.models, values, accuracy), strict=True))
    return [found[place] for place in sorted(found)]


def _failures(group: _Group, models: Models, values: Values, accuracy: Accuracy) -> Array:
    if group.kind == "closed":
        return jnp.zeros(len(group.places))
    roomy = _roomy(group, models, accuracy)
    if group.kind == "friction":
        ends = lambda args: integrate(PrescribedMotion(models.contact(values), *args), args[0][-1], roomy).failure
        return lax.map(ends, _prescribed(group))

    def one(drive, overrides, times, on_platform):
        system = _system(group, models, values, _shared(drive, overrides, values), on_platform)
        return integrate(system, times[-1], roomy, system.output_components()).failure

    return lax.map(lambda args: one(*args), (group.drives, group.overrides, group.times, group.on_platform))


def _roomy(group: _Group, models: Models, accuracy: Accuracy) -> Accuracy:
    """`accuracy` with room for the steps that the longest record may take."""
    few = min(group.segments, _MANY)
    room = _STEPS_PER_SEGMENT * few + _STEPS_WHERE_MANY * (group.segments - few) + _SPARE_STEPS
    if group.kind == "blocked" or (group.kind != "friction" and not models.piezo.has_steady_state):
        room += int(_STEPS_A_SECOND * group.duration)
    return dataclasses.replace(accuracy, max_steps=max(room, accuracy.max_steps))


def _prescribed(group: _Group) -> tuple[Any, Any]:
    """Times from 0 on [s] and motions [m] of friction records."""
    return group.times - group.times[:, :1], group.motion


def _shared(drive: Any, overrides: dict[str, Any], values: Values) -> Any:
    """`drive` with the study's numbers in place of those that the record does not set itself."""
    numbers = drive.numbers()
    paths = {field: path for field in overrides if (path := f"drive.{field}") in values}
    return drive.with_numbers({f: jnp.where(overrides[f], numbers[f], values[path]) for f, path in paths.items()})


def _system(group: _Group, models: Models, values: Values, drive: Any, on_platform: Any) -> Any:
    """What moves in a record of the `group`."""
    actuator, sensor = models.actuator(values, group.kind == "blocked"), models.sensor(values)
    if group.kind in ("closed", "unloaded"):
        return PlatformOnly(actuator.driven_platform, drive, sensor)
    return StickSlip(actuator, drive, sensor, on_platform)


def _group(records: Sequence[Record], places: Sequence[int], kind: str) -> _Group:
    longest = max(record.time.size for record in records)
    padded = lambda a: np.pad(a, (0, longest - a.size), mode="edge")
    drives = [jax.tree.map(lambda leaf: np.asarray(leaf, float), record.drive) for record in records]
    first = records[0].drive
    fields = {} if first is None else first.declared()
    motions = [record.motion for record in records if record.motion is not None]
    return _Group(
        drives=None if first is None else jax.tree.map(lambda *leaves: np.stack(leaves), *drives),
        overrides={field: np.array([field not in shared_fields(r) for r in records]) for field in fields},
        times=np.stack([padded(record.time) for record in records]),
        motion=np.stack([padded(motion) for motion in motions]) if motions else None,
        on_platform=np.array([1.0 * (record.measures == "platform") for record in records]),
        places=tuple(places),
        samples=tuple(record.time.size for record in records),
        kind=kind,
        duration=float(max(record.time[-1] for record in records)),
        segments=_segments(records, kind),
    )


def _segments(records: Sequence[Record], kind: str) -> int:
    """Segments of the drive, or of the prescribed motion, in the longest record."""
    if kind == "friction":
        return max(record.time.size for record in records)
    return max(record.drive.segments(float(record.time[-1])) for record in records if record.drive is not None)
