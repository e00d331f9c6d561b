"""Predicts the records of a study, all that share a shape in one compiled function.

Platform records without friction feedback come from the closed form; the others are
marched.  Records of one waveform are stacked and run one after the other, so that the
compiler sees the march once.
"""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from .actuator import Actuator
from .drive.base import AbstractDrive
from .effector import Effector
from .integration import Accuracy
from .quantity import quantities
from .records import Record
from .simulation import displacements, platform

Values = dict[str, Float[Array, ""]]
"""Parameter paths to numbers in SI."""

_STEPS_PER_PERIOD = 400
_SPARE_STEPS = 1000


class Models(eqx.Module):
    """The chosen family members, without their parameters."""

    piezo: type = eqx.field(static=True)
    friction: type = eqx.field(static=True)
    friction_state: str = eqx.field(static=True)
    feedback: bool = eqx.field(static=True)

    def actuator(self, values: Values) -> Actuator:
        """The actuator with the given `values`; what is left out keeps its nominal value."""
        reading = {"state": self.friction_state} if hasattr(self.friction, "state") else {}
        return Actuator(
            self.piezo(**_fields("piezo", self.piezo, values)),
            self.friction(**_fields("friction", self.friction, values), **reading),
            Effector(**_fields("effector", Effector, values)),
            self.feedback,
        )


class _Group(eqx.Module):
    """Records that share one compiled function: same waveform, same way to compute."""

    drives: AbstractDrive
    """Stacked: every leaf has one entry a record."""
    own: dict[str, Array]
    """For each quantity of the drive, whether the record sets it itself."""
    times: Array
    """Shape (records, samples), each row filled up with its last time."""
    on_platform: Array
    places: tuple[int, ...] = eqx.field(static=True)
    """Where the records stand in the study."""
    samples: tuple[int, ...] = eqx.field(static=True)
    closed: bool = eqx.field(static=True)
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
            closed = record.measures == "platform" and not models.feedback
            kinds.setdefault((type(record.drive), closed), []).append(place)
        self.groups = tuple(
            _group([records[i] for i in places], places, closed) for (_, closed), places in kinds.items()
        )

    def __call__(self, values: Values, accuracy: Accuracy) -> list[Float[Array, " samples"]]:
        """One array a record, in the order of the records, without offsets [m]."""
        found: dict[int, Array] = {}
        actuator = self.models.actuator(values)
        for group in self.groups:
            rows = _predict(group, actuator, values, accuracy)
            for row, place, samples in zip(rows, group.places, group.samples, strict=True):
                found[place] = row[:samples]
        return [found[place] for place in sorted(found)]


def _predict(group: _Group, actuator: Actuator, values: Values, accuracy: Accuracy) -> Array:
    room = _STEPS_PER_PERIOD * math.ceil(group.segments / 2) + _SPARE_STEPS
    roomy = dataclasses.replace(accuracy, max_steps=max(room, accuracy.max_steps))

    def one(drive, own, times, on_platform):
        for field, declared in own.items():
            if (path := f"drive.{field}") in values:
                shared = jnp.where(declared, getattr(drive, field), values[path])
                drive = eqx.tree_at(lambda d, field=field: getattr(d, field), drive, shared)
        if group.closed:
            return platform(actuator.piezo, drive, times, group.segments)
        y, x_e = displacements(actuator, drive, times, roomy)
        return jnp.where(on_platform, y, x_e)

    return lax.map(lambda args: one(*args), (group.drives, group.own, group.times, group.on_platform))


def _group(records: Sequence[Record], places: Sequence[int], closed: bool) -> _Group:
    longest = max(record.time.size for record in records)
    times = [np.pad(record.time, (0, longest - record.time.size), mode="edge") for record in records]
    drives = [jax.tree.map(lambda leaf: jnp.asarray(leaf, float), record.drive) for record in records]
    fields = quantities(type(records[0].drive))
    return _Group(
        drives=jax.tree.map(lambda *leaves: jnp.stack(leaves), *drives),
        own={field: jnp.array([field in r.own or not fields[field].optional for r in records]) for field in fields},
        times=jnp.asarray(np.stack(times)),
        on_platform=jnp.array([record.measures == "platform" for record in records]),
        places=tuple(places),
        samples=tuple(record.time.size for record in records),
        closed=closed,
        segments=max(_segments(record) for record in records),
    )


def _segments(record: Record) -> int:
    """Segments of the drive before the record's last sample, with one to spare."""
    cycle = record.drive.period()
    if cycle is None:
        return 2
    first, every = cycle
    length = sum(float(record.drive.segment(jnp.asarray(float(first + i))).duration) for i in range(every))
    return first + every * (math.ceil(max(float(record.time[-1]), 0.0) / length) + 1)


def _fields(family: str, model: type, values: Values) -> dict[str, Any]:
    named = {field: values.get(f"{family}.{field}") for field in quantities(model)}
    return {field: value for field, value in named.items() if value is not None}
