"""Predicts the records of a study, all that share a shape in one compiled function.

A system known in closed form is not integrated.  Records of one waveform and of one setup are
stacked and run one after the other, so that the compiler sees the integration once.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from ..core import Count, Truth
from ..drive.base import AbstractDrive
from ..integration import Accuracy
from ..simulation import measured, why_failed
from .conditions import under_conditions
from .models import Models, Values
from .record import Record
from .setups import AbstractSetup, Run
from .shared_drive import shared_fields

_STEPS_PER_SEGMENT = 200

_MANY = 400
"""Segments of a drive from which on each is short and takes a few steps only."""

_SPARE_STEPS = 1000

_STEPS_WHERE_MANY = 8

_STEPS_A_SECOND = 6000
"""Where nothing settles: for transients that die out at up to 18 000 a second, by the `span` of a step."""


class _Group(eqx.Module):
    """Records that share one compiled function: same waveform, same setup."""

    setups: AbstractSetup
    """Stacked: every leaf has one entry a record."""
    runs: Run
    """Stacked in the same way; times are filled up with the last of each record."""
    overrides: dict[str, Bool[np.ndarray, " records"]]
    """For each quantity of the drive, whether the record sets it itself."""
    conditions: dict[str, Bool[np.ndarray, " records"]]
    """For each condition, whether the record was made under it."""
    places: tuple[int, ...] = eqx.field(static=True)
    """Where the records stand in the study."""
    duration: float = eqx.field(static=True)
    """When the last sample is taken [s]."""
    segments: int = eqx.field(static=True)
    """How many segments of the drive the longest record reaches into."""


class Lowered(Protocol):
    """A function that has been traced."""

    def compile(self) -> object:
        """Compiles it, for all that call it afterwards."""
        ...


class Predictor(eqx.Module):
    """Sample values of every record as a function of the parameters."""

    models: Models
    groups: tuple[_Group, ...]
    samples: tuple[int, ...] = eqx.field(static=True)
    """How many each record has."""

    def __init__(self, models: Models, records: Sequence[Record]):
        self.models = models
        self.samples = tuple(record.time.size for record in records)
        setups = [record.measurement.setup(models) for record in records]
        grouped: dict[Any, list[int]] = {}
        for place, (record, setup) in enumerate(zip(records, setups, strict=True)):
            # Leaves of different sizes (sampled drives) cannot be stacked.
            shapes = tuple(np.shape(leaf) for leaf in jax.tree.leaves(record.drive))
            key = (type(record.drive), jax.tree.structure(setup), jax.tree.structure(record.drive), shapes)
            grouped.setdefault(key, []).append(place)
        # What is known of the records is numbers, also where a prediction that is being traced needs them first.
        with jax.ensure_compile_time_eval():
            self.groups = tuple(
                _group([records[i] for i in places], [setups[i] for i in places], places) for places in grouped.values()
            )

    def __call__(
        self, values: Values, accuracy: Accuracy, used: Bool[Array | np.ndarray, " records"] | None = None
    ) -> list[Float[Array, " samples"]]:
        """One array a record, in the order of the records, without offsets, in its unit.

        Those that are not `used` are not simulated, and zero; None for all.
        """
        rows = _of_each_record(measured, self, values, accuracy, used)
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
    """What `ask`, `measured` or `why_failed`, gives of each record, in the order of the records; 0 if not `used`."""
    found: dict[int, Array] = {}
    for group in predictor.groups:
        asked = None if used is None else jnp.asarray(used)[jnp.asarray(group.places)]
        found |= dict(zip(group.places, _of_group(ask, group, predictor.models, values, accuracy, asked), strict=True))
    return [found[place] for place in sorted(found)]


def _of_group(
    ask: Callable[..., Array],
    group: _Group,
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


def _group(records: Sequence[Record], setups: Sequence[AbstractSetup], places: Sequence[int]) -> _Group:
    longest = max(record.time.size for record in records)

    def padded(values: Float[np.ndarray, " samples"] | None) -> Any:
        return None if values is None else np.pad(values, (0, longest - values.size), mode="edge")

    stacked = lambda trees: jax.tree.map(lambda *leaves: np.stack([np.asarray(leaf, float) for leaf in leaves]), *trees)
    first = records[0].drive
    fields = {} if first is None else first.declared()
    return _Group(
        setups=stacked(setups),
        runs=stacked([Run(record.drive, padded(record.time), padded(record.motion)) for record in records]),
        overrides={field: np.array([field not in shared_fields(r) for r in records]) for field in fields},
        conditions={
            name: np.array([name in record.conditions for record in records])
            for name in sorted(set().union(*(record.conditions for record in records)))
        },
        places=tuple(places),
        duration=float(max(record.time[-1] for record in records)),
        segments=max(setup.segments(r.drive, r.time) for setup, r in zip(setups, records, strict=True)),
    )
