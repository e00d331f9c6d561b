"""Records that share one compiled function: stacked, so that the compiler sees their integration once."""

from collections.abc import Sequence
from typing import Any, Generic, Protocol, TypeVar

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Bool, Float

from ..drive.base import AbstractDrive

S = TypeVar("S", bound=eqx.Module)
"""How a record is made, without the numbers of the rig: `pdssjax.study.AbstractSetup`."""


class Run(eqx.Module):
    """What is done to the rig in a record."""

    drive: AbstractDrive | None
    """The voltage from t = 0 on; None where nothing is driven."""
    times: Float[Array, " samples"]
    """Sample times [s]."""
    motion: Float[Array, " samples"] | None
    """The relative displacement prescribed [m]; None where it is free."""


class RecordedRun(Protocol):
    """What is asked of a record to put it beside others of its shape."""

    @property
    def drive(self) -> AbstractDrive | None:
        """The voltage from t = 0 on; None where a motion is prescribed."""
        ...

    @property
    def time(self) -> Float[np.ndarray, " samples"]:
        """Sample times [s], strictly increasing."""
        ...

    @property
    def motion(self) -> Float[np.ndarray, " samples"] | None:
        """The relative displacement prescribed [m]; None where it is free."""
        ...

    @property
    def overrides(self) -> frozenset[str]:
        """The drive's fields that the record itself sets."""
        ...

    @property
    def conditions(self) -> frozenset[str]:
        """Under which it was made."""
        ...


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
    places: tuple[int, ...] = eqx.field(static=True)
    """Where the records stand in the study."""
    duration: float = eqx.field(static=True)
    """When the last sample is taken [s]."""
    segments: int = eqx.field(static=True)
    """How many segments of the drive the longest record reaches into."""


def record_groups(
    records: Sequence[RecordedRun], setups: Sequence[S], segments: Sequence[int]
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
    records: Sequence[RecordedRun], setups: Sequence[S], segments: Sequence[int], places: Sequence[int]
) -> RecordGroup[S]:
    longest = max(record.time.size for record in records)

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
        places=tuple(places),
        duration=float(max(record.time[-1] for record in records)),
        segments=max(segments),
    )
