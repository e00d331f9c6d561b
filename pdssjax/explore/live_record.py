"""One record of a study, predicted while its numbers are turned: compiled once, then a few milliseconds a time.

Room for steps is what an integration costs most, so there is as much of it as the record takes, found by a run
without output.  Numbers that need more are given more, which compiles anew; those that do not keep what they had.
"""

from collections.abc import Mapping
from typing import NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import Count, InputError
from ..integration import Accuracy, integrate, is_closed
from ..simulation import Observation, observe
from ..study import AbstractSetup, Models, Record, Run, Study, Values, drive_with, under_conditions, with_room

Tree = TypeVar("Tree")
"""Of numbers."""

ACCURACY = 1e-11
"""Error of a step [m]: 3e-10 m along the records of the example, a thirtieth of their noise."""

_FEWEST = 512
"""Room for steps at least."""

_SPARE = 1.5
"""Of the room, over the steps that the first run took."""

_MOST_SEGMENTS = 1 << 18
"""Segments of a drive within a record at most; twice as many take a minute to compile and gigabytes to hold."""

OUT_OF_STEPS = 1
"""The failure that more room cures."""


class _Room(NamedTuple):
    """For what one compiled function has room."""

    steps: int
    segments: int
    """Of the drive; 0 where nothing depends on their number."""


class LiveRecord:
    """A record of a study, ready to be predicted at any numbers."""

    def __init__(self, study: Study, record: Record, values: Values):
        self.study, self.record = study, record
        self.models = study.models_with(values)
        self.setup: AbstractSetup = _as_arrays(record.measurement.setup(self.models))
        run, numbers = self._asked(record, values)
        self._closed = is_closed(self.setup.system(self.models, numbers, run))
        self._rooms: list[_Room] = []
        """The smallest first: what one extreme number took would slow down all others."""
        self._plan(record, values)

    def run(self, record: Record, values: Values, instants: Float[np.ndarray, " k"]) -> Observation:
        """What the sensor shows at the record's sample times, and what moves inside at the `instants` [s].

        **Arguments:** `record` is this one, its drive with other numbers maybe.  What the run gives is NaN where the
        simulation fails; `message` says why.  Compiles anew where the numbers take more steps than there is room for.
        """
        found = self.run_at_once(record, values, instants)
        return self._observed(record, values, instants, self._plan(record, values)) if found is None else found

    def run_at_once(self, record: Record, values: Values, instants: Float[np.ndarray, " k"]) -> Observation | None:
        """The same without compiling anything; None where the numbers take more steps than there is room for."""
        segments = self._segments_of(record)
        for room in self._rooms:
            if room.segments >= segments:
                found = self._observed(record, values, instants, room)
                if int(found.failure) != OUT_OF_STEPS or room.steps >= self._most(record).max_steps:
                    return found
        return None

    def _observed(self, record: Record, values: Values, instants: Float[np.ndarray, " k"], room: _Room) -> Observation:
        run, numbers = self._asked(record, values)
        accuracy = Accuracy(ACCURACY, ACCURACY, max_steps=room.steps)
        found = observed(self.setup, self.models, run, numbers, instants, accuracy, room.segments)
        return jax.tree.map(np.asarray, found)

    def _segments_of(self, record: Record) -> int:
        """How many segments of its drive a record reaches into; 0 where nothing depends on it."""
        return self._segments_within(record) if self._closed else 0

    def _segments_within(self, record: Record) -> int:
        """How many segments of its drive a record reaches into.

        **Raises:** `InputError` where they are too many to be shown.
        """
        segments = self.setup.segments(record.drive, record.time)
        if segments > _MOST_SEGMENTS:
            raise InputError(
                f'record "{record.name}": found a drive of {segments:.3g} segments within the record, expected '
                f"{_MOST_SEGMENTS} at most on this page: a lower frequency, or a shorter record."
            )
        return segments

    def _most(self, record: Record) -> Accuracy:
        """With room for all the steps that a record may take."""
        segments = self._segments_within(record)
        return with_room(
            Accuracy(ACCURACY, ACCURACY), self.setup, self.models, _power_of_two(segments), float(record.time[-1])
        )

    def _asked(self, record: Record, values: Values) -> tuple[Run, dict[str, Float[np.ndarray, ""]]]:
        """What is done to the rig, and the numbers of the parameters that hold in the record."""
        numbers = {path: float(n) for path, n in _here(record, values).items()}
        drive = None if record.drive is None else drive_with(record, numbers)
        motion = None if record.motion is None else jnp.asarray(record.motion)
        run = Run(_as_arrays(drive), jnp.asarray(record.time), motion)
        return run, {path: np.asarray(n, float) for path, n in numbers.items()}

    def _plan(self, record: Record, values: Values) -> _Room:
        """Finds how much room the record takes at the `values`: more than there is for any other."""
        run, numbers = self._asked(record, values)
        segments = _power_of_two(2 * self._segments_of(record)) if self._closed else 0
        most = self._most(record)
        steps = 0 if self._closed else int(steps_taken(self.setup, self.models, run, numbers, most))
        known = max((room.steps for room in self._rooms), default=0)
        room = _Room(min(most.max_steps, _power_of_two(max(_FEWEST, known + 1, _SPARE * steps))), segments)
        self._rooms = sorted({*self._rooms, room})
        return room


def _here(record: Record, values: Values) -> Values:
    if not any("@" in path for path in values):
        return values
    return under_conditions(values, dict.fromkeys(record.conditions, True))


def _as_arrays(tree: Tree) -> Tree:
    """With numbers as arrays, by which nothing is compiled anew when they change."""
    return jax.tree.map(lambda leaf: np.asarray(leaf, float), tree)


def _power_of_two(number: float) -> int:
    return 1 << (int(np.ceil(number)) - 1).bit_length()


@eqx.filter_jit
def observed(
    setup: AbstractSetup,
    models: Models,
    run: Run,
    values: Mapping[str, Float[Array | np.ndarray, ""]],
    instants: Float[Array | np.ndarray, " k"],
    accuracy: Accuracy,
    segments: int,
) -> Observation:
    """A run of a record, looked at, compiled; `instants` [s] are on the clock of the record."""
    times, shift = setup.times(run), run.times[0] - setup.times(run)[0]
    system = setup.system(models, values, run)
    return observe(system, setup.output, jnp.asarray(times), jnp.asarray(instants) - shift, accuracy, segments)


@eqx.filter_jit
def steps_taken(
    setup: AbstractSetup,
    models: Models,
    run: Run,
    values: Mapping[str, Float[Array | np.ndarray, ""]],
    accuracy: Accuracy,
) -> Count:
    """How many steps a run takes; nothing is made of them, so that it compiles and runs quickly."""
    solution = integrate(setup.system(models, values, run), setup.times(run)[-1], accuracy)
    return solution.count + solution.rejected
