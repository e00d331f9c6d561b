"""The prediction of records: what the sensor shows, at the sample times, of the system that moves in each.

A setup makes that system out of the numbers of the rig; `pdssjax.simulation.sensor_samples` integrates it, or takes its
closed form.  Records that share a shape are stacked (`record_groups`) and run one after the other in one compiled
function, so that the compiler sees their integration once.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Generic, TypeAlias, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from ..core import Count, Given, Tree, Truth, as_number, kept_jit
from ..drive.base import AbstractDrive
from ..integration import AbstractHybridSystem, Accuracy
from ..simulation import Scratch, samples_and_slopes, scratch, sensor_samples, why_failed
from .models import Models, Values
from .parameter import under_conditions
from .record import Record
from .setups import AbstractSetup, Run, with_room

S = TypeVar("S", bound=eqx.Module)
"""How a record is made, without the numbers of the rig: `pdssjax.study.AbstractSetup`."""


class RecordGroup(eqx.Module, Generic[S]):
    """Records of one waveform and of setups that differ in numbers only."""

    setups: S
    """Stacked: every leaf has one entry a record."""
    runs: Run
    """Stacked in the same way; times are filled up with the last of each record."""
    overrides: dict[str, Bool[np.ndarray, " records"]]
    """For each quantity of the drive, whether the record sets it itself."""
    conditions: dict[str, Bool[np.ndarray, " records"]]
    """For each condition, whether the record was made under it."""
    samples: Int[np.ndarray, " records"]
    """Number of samples of each record."""
    places: tuple[int, ...] = eqx.field(static=True)
    """Where the records stand in the study."""
    duration: float = eqx.field(static=True)
    """When the last sample is taken [s]."""
    segments: int = eqx.field(static=True)
    """How many segments of the drive the longest record reaches into."""
    early: int = eqx.field(static=True)
    """Samples of which there may be derivatives, and that are read at a time: as many as the longest record that is
    fitted has, or where none is, the longest; in a much longer record more."""


def record_groups(
    records: Sequence[Record], setups: Sequence[S], segments: Sequence[int]
) -> tuple[RecordGroup[S], ...]:
    """All records, in as few groups as there are shapes.

    **Arguments:** of each record its setup, and how many segments of its drive it reaches into.
    """
    grouped: dict[Any, list[int]] = {}
    for place, (record, setup) in enumerate(zip(records, setups, strict=True)):
        # Leaves of different sizes (sampled drives) cannot be stacked.
        shapes = tuple(np.shape(leaf) for leaf in jax.tree.leaves(record.drive))
        key = (type(record.drive), jax.tree.structure(setup), jax.tree.structure(record.drive), shapes)
        grouped.setdefault(key, []).append(place)
    return tuple(
        _group([records[i] for i in places], [setups[i] for i in places], [segments[i] for i in places], places)
        for places in grouped.values()
    )


def _group(
    records: Sequence[Record], setups: Sequence[S], segments: Sequence[int], places: Sequence[int]
) -> RecordGroup[S]:
    longest = max(record.time.size for record in records)
    fitted = [record.time.size for record in records if record.role == "fit"]

    def padded(values: Float[np.ndarray, " samples"] | None) -> Any:
        return None if values is None else np.pad(values, (0, longest - values.size), mode="edge")

    stacked = lambda trees: jax.tree.map(lambda *leaves: np.stack([np.asarray(leaf, float) for leaf in leaves]), *trees)
    fields = {} if records[0].drive is None else records[0].drive.declared()
    return RecordGroup(
        setups=stacked(setups),
        runs=stacked([Run(record.drive, padded(record.time), padded(record.motion)) for record in records]),
        overrides={field: np.array([field in record.overrides for record in records]) for field in fields},
        conditions={
            name: np.array([name in record.conditions for record in records])
            for name in sorted(set().union(*(record.conditions for record in records)))
        },
        samples=np.array([record.time.size for record in records]),
        places=tuple(places),
        duration=float(max(record.time[-1] for record in records)),
        segments=max(segments),
        # In eight parts at most: all steps of a record are expanded for each.
        early=max([*fitted, -(-longest // 8)] if fitted else [longest]),
    )


Directions: TypeAlias = Mapping[str, Float[Array | np.ndarray, " p"]]
"""Of p directions, how the free parameters [SI] move along each, by path."""

SystemOf: TypeAlias = Callable[[Values], AbstractHybridSystem]

Ask: TypeAlias = Callable[..., Any]
"""A question about the system of a record: (`SystemOf`, parameters by path, times, and what `sensor_samples` takes)."""


class Predictor(eqx.Module):
    """Sample values of every record as a function of the parameters."""

    models: Models
    groups: tuple[RecordGroup[AbstractSetup], ...]
    samples: tuple[int, ...] = eqx.field(static=True)
    """How many each record has."""

    def __init__(self, models: Models, records: Sequence[Record]):
        self.models = models
        self.samples = tuple(record.time.size for record in records)
        setups = [record.measurement.setup(models) for record in records]
        # What is known of the records is numbers, also where a prediction that is being traced needs them first.
        with jax.ensure_compile_time_eval():
            segments = [setup.segments(r.drive, r.time) for setup, r in zip(setups, records, strict=True)]
            self.groups = record_groups(records, setups, segments)

    def until(self, ends: Float[np.ndarray, " records"]) -> "Predictor":
        """The predictor of motions that end at the times `ends` [s]: what later samples show is unknown.

        What is compiled is shared.
        """

        def cut(group: RecordGroup[AbstractSetup]) -> RecordGroup[AbstractSetup]:
            times, last = np.asarray(group.runs.times), ends[list(group.places), None]
            early = np.minimum(np.sum(times <= last, axis=1), group.samples)
            runs = dataclasses.replace(group.runs, times=np.minimum(times, last))
            return dataclasses.replace(group, runs=runs, samples=np.maximum(early, 1))

        return eqx.tree_at(lambda p: p.groups, self, tuple(map(cut, self.groups)))

    def __call__(
        self, values: Values, accuracy: Accuracy, used: Bool[Array | np.ndarray, " records"] | None = None
    ) -> list[Float[Array, " samples"]]:
        """Predict each record: an array of its samples, without its offset, in its unit.

        Those that are not `used` are not simulated, and zero; None for all.
        """
        return self._unstack(_map_groups(sensor_samples, self, values, accuracy, used))

    def scratch(self, values: Values, directions: Directions, accuracy: Accuracy) -> list[Scratch]:
        """Memory for `linearised`, of each group of records."""
        (count,) = {len(direction) for direction in directions.values()}

        def of_group(group: RecordGroup[AbstractSetup]) -> Scratch:
            shape = len(group.places), group.early, count
            of_record, records = _per_record(group, self.models, values, accuracy)
            first = jax.tree.map(lambda a: a[0], records)
            return of_record(lambda system, values, times, how, *_: scratch(system(values), how, shape), *first)

        return list(map(of_group, self.groups))

    def linearised(
        self,
        values: Values,
        directions: Directions,
        sloped: Truth,
        accuracy: Accuracy,
        memory: Sequence[Scratch],
        used: Bool[Array | np.ndarray, " records"] | None = None,
    ) -> tuple[list[Float[Array, " samples"]], list[Scratch]]:
        """Predict each record, and where `sloped` leave its derivatives along the `directions` in the `memory`.

        `slopes` reads them.  Compiled it is one function for both.  Records that are not fitted have no derivatives.
        """
        groups = zip(self.groups, memory, strict=True)
        found = [self._linearised(group, values, directions, sloped, accuracy, of, used) for group, of in groups]
        return self._unstack([shown for shown, _ in found]), [of for _, of in found]

    def slopes(self, memory: Sequence[Scratch]) -> list[Float[Array, "samples p"]]:
        """The derivatives that `linearised` left in its `memory`, of each record."""
        return self._unstack([of.slopes for of in memory])

    def _linearised(
        self,
        group: RecordGroup[AbstractSetup],
        values: Values,
        directions: Directions,
        sloped: Truth,
        accuracy: Accuracy,
        memory: Scratch,
        used: Bool[Array | np.ndarray, " records"] | None,
    ) -> tuple[Float[Array, "records samples"], Scratch]:
        moving = {path: values[path] for path in directions}
        of_record, records = _per_record(group, self.models, values, accuracy)
        which = _used_in_group(used, group)
        order = jnp.argsort(~which)  # those that are used come first

        def next_record(place: Count, so_far: tuple[Array, Scratch]) -> tuple[Array, Scratch]:
            i = order[place]

            def ask(system: SystemOf, values: Values, *how: Any) -> tuple[Array, Scratch]:
                of = lambda moving: system({**values, **moving})
                return samples_and_slopes(of, moving, directions, sloped, so_far[1], i, *how)

            row, memory = of_record(ask, *jax.tree.map(lambda a: a[i], records))
            return so_far[0].at[i].set(row), memory

        return lax.fori_loop(0, jnp.sum(which), next_record, (jnp.zeros(group.runs.times.shape), memory))

    def _unstack(self, stacked: list[Float[Array, "records samples ..."]]) -> list[Float[Array, "samples ..."]]:
        """What is `stacked` by group, and filled up to the longest, of each record."""
        rows = {place: (g, row) for g, group in enumerate(self.groups) for row, place in enumerate(group.places)}
        return [stacked[rows[place][0]][rows[place][1], :samples] for place, samples in enumerate(self.samples)]


def predicted(
    predictor: Predictor, values: Values, accuracy: Accuracy, used: Bool[Array | np.ndarray, " records"] | None = None
) -> list[Float[Array, " samples"]]:
    """Predictions by `predictor` of the records that are `used`, by default all, compiled once for all callers."""
    numbers: dict[str, Given] = {path: as_number(number) for path, number in values.items()}
    return _predicted(predictor, numbers, accuracy, np.ones(len(predictor.samples), bool) if used is None else used)


@kept_jit
def _predicted(
    predictor: Predictor, values: Values, accuracy: Accuracy, used: Bool[Array | np.ndarray, " records"]
) -> list[Float[Array, " samples"]]:
    return predictor(values, accuracy, used)


@kept_jit
def failures(predictor: Predictor, values: Values, accuracy: Accuracy) -> list[Count]:
    """Why each record cannot be predicted, as an index into `pdssjax.integration.FAILURES`; 0 where it can."""
    found = dict[int, Count]()
    for group, failed in zip(predictor.groups, _map_groups(why_failed, predictor, values, accuracy), strict=True):
        found |= {place: failed[row] for row, place in enumerate(group.places)}
    return [found[place] for place in sorted(found)]


def _map_groups(
    function: Callable[..., Array],
    predictor: Predictor,
    values: Values,
    accuracy: Accuracy,
    used: Bool[Array | np.ndarray, " records"] | None = None,
) -> list[Array]:
    """The results of `function` (`sensor_samples`, `why_failed`) for the records of each group, stacked; 0 if not used.

    Records are asked one after the other.
    """
    ask = lambda system, values, *how: function(system(values), *how)

    def of_group(group: RecordGroup[AbstractSetup]) -> Array:
        of_record, records = _per_record(group, predictor.models, values, accuracy)
        if used is None:
            return lax.map(lambda record: of_record(ask, *record), records)
        nothing = jnp.zeros(group.runs.times.shape[1:])
        return lax.map(
            lambda both: lax.cond(both[1], lambda: of_record(ask, *both[0]), lambda: nothing),
            (records, _used_in_group(used, group)),
        )

    return [of_group(group) for group in predictor.groups]


def _used_in_group(
    used: Bool[Array | np.ndarray, " records"] | None, group: RecordGroup[AbstractSetup]
) -> Bool[Array, " records"]:
    """Which records of a group are used: a fit of some compiles what one of all does, and runs less."""
    places = jnp.asarray(group.places)
    return jnp.ones(places.shape, bool) if used is None else jnp.asarray(used)[places]


def _per_record(
    group: RecordGroup[AbstractSetup], models: Models, values: Values, accuracy: Accuracy
) -> tuple[Callable[..., Any], Tree]:
    """What asks one record of a group, (ask, *record) to the answer; and the records, stacked."""
    roomy = with_room(accuracy, group.setups, models, group.segments, group.duration)

    def of_record(
        ask: Ask,
        setup: AbstractSetup,
        run: Run,
        overrides: dict[str, Truth],
        conditions: dict[str, Truth],
        samples: Count,
    ) -> Any:
        def system(values: Values) -> AbstractHybridSystem:
            numbers = under_conditions(values, conditions)
            driven = dataclasses.replace(run, drive=_shared(run.drive, overrides, numbers))
            return setup.system(models, numbers, driven)

        return ask(system, values, setup.times(run), roomy, setup.output, group.segments, samples)

    return of_record, (group.setups, group.runs, group.overrides, group.conditions, group.samples)


def _shared(drive: AbstractDrive | None, overrides: dict[str, Truth], values: Values) -> AbstractDrive | None:
    """`drive` with the study's numbers in place of those that the record does not set itself."""
    if drive is None:
        return None
    numbers = drive.numbers()
    paths = {field: path for field in overrides if (path := f"drive.{field}") in values}
    return drive.with_numbers({f: jnp.where(overrides[f], numbers[f], values[path]) for f, path in paths.items()})
