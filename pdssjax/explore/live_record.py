"""Records of a study, predicted while the user changes numbers: compiled once, then in a few milliseconds each time.

The results are the curves that the page draws of a record, and the score of the prediction.

The room for steps dominates the cost of an integration.  A run without output finds how much a record takes.  Numbers
that need more room compile anew; all others keep the smaller room.
"""

import itertools
import math
import threading
from collections.abc import Mapping
from typing import NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..core import Count, InputError
from ..integration import Accuracy, integrate_steps, is_closed
from ..metrics import scatter_floor
from ..simulation import Inside, Observation, observe
from ..study import (
    AbstractSetup,
    Models,
    Record,
    Run,
    Study,
    Values,
    cycles_a_second,
    drive_with,
    paths_in,
    with_room,
)
from .settings import Settings, study_at

DRAWN = 4000
"""Largest number of samples of a record that are drawn."""

OVERVIEW, ENLARGED = 700, 2000
"""Number of instants of the drawn prediction, over the whole record and over the enlarged stretch."""


class Score(NamedTuple):
    """The agreement of a record with its prediction."""

    rmse: float
    """Root mean square of the residuals, in the unit of the record."""
    chi2: float
    """Chi-square a degree of freedom; NaN where the simulation failed or no noise is known."""
    noise: float
    """Standard deviation of the noise in chi-square."""
    noise_given: bool
    """Whether the study gives the noise; else it is estimated from neighbouring samples."""
    offset: float
    """The zero of the record: given, or the best fit at these numbers."""


class Redraw(NamedTuple):
    """Curves of a record at given parameters, in SI."""

    predicted: Float[np.ndarray, " samples"]
    """Prediction at the record's samples, with the offset."""
    residual: Float[np.ndarray, " samples"]
    """Measured minus predicted."""
    instants: Float[np.ndarray, " k"]
    """Times of `between` and `inside` [s]."""
    between: Float[np.ndarray, " k"]
    """Prediction at the instants, with the offset."""
    inside: Inside
    score: Score
    message: str
    """Reason of a failed simulation, else ""."""


def redraw(record: Record, found: Observation, instants: Float[np.ndarray, " k"]) -> Redraw:
    """Compute the curves of `record` from its simulated observation `found`."""
    shown = np.asarray(found.shown)
    score = score_of(record, shown)
    residual, between = record.measured - shown - score.offset, np.asarray(found.between) + score.offset
    return Redraw(shown + score.offset, residual, instants, between, found.inside, score, found.message)


def score_of(record: Record, shown: Float[np.ndarray, " samples"]) -> Score:
    """The score of `shown`, the prediction without an offset."""
    zero = float(np.mean(record.measured - shown)) if record.offset is None else record.offset
    squares = float(np.sum((record.measured - shown - zero) ** 2))
    noise, count = known_noise(record), record.measured.size
    freedom = max(count - (record.offset is None), 1)
    chi2 = squares / noise**2 / freedom if noise > 0 else math.nan
    return Score(math.sqrt(squares / count), chi2, noise, record.noise is not None, zero)


def known_noise(record: Record) -> float:
    """Standard deviation of a record's noise: given, or from neighbouring samples; NaN where they are too few."""
    if record.noise is not None:
        return record.noise
    return scatter_floor(record.measured) if record.time.size >= 8 else math.nan


def initial_stretch(record: Record) -> tuple[float, float]:
    """The stretch [s] enlarged at the beginning: around the fastest motion, such as a slip or the onset of a step."""
    time = record.time
    width = max(60 * float(np.median(np.diff(time))), float(time[-1] - time[0]) / 60)
    jump = float(time[np.argmax(np.abs(np.diff(record.measured) / np.diff(time)))])
    return clipped_stretch(record, jump - 0.15 * width, jump + 0.85 * width)


def clipped_stretch(record: Record, begin: float, end: float) -> tuple[float, float]:
    """The stretch from `begin` to `end` [s], moved and shortened to lie within the record."""
    first, last = float(record.time[0]), float(record.time[-1])
    width = min(max(end - begin, (last - first) / 2000), last - first)
    begin = min(max(begin, first), last - width)
    return begin, begin + width


def cycle_of(record: Record) -> float:
    """Length [s] by which the buttons move the enlarged stretch: a cycle of the drive, or a tenth of the record."""
    frequency = cycles_a_second(record)
    return 1.0 / frequency if frequency else float(record.time[-1] - record.time[0]) / 10


def instants_of(record: Record, begin: float, end: float) -> Float[np.ndarray, " k"]:
    """Times [s] of the drawn prediction, dense from `begin` to `end`; their number is always the same."""
    whole = np.linspace(record.time[0], record.time[-1], OVERVIEW)
    return np.sort(np.concatenate([whole, np.linspace(begin, end, ENLARGED)]))


def drawn_samples(record: Record) -> Int[np.ndarray, " drawn"]:
    """Indices of the samples to draw: all, or of a long record the extremes of each of many stretches."""
    size = record.time.size
    if size <= DRAWN:
        return np.arange(size)
    parts = np.array_split(np.arange(size), DRAWN // 2)
    extremes = [(part[record.measured[part].argmin()], part[record.measured[part].argmax()]) for part in parts]
    return np.unique([0, size - 1, *itertools.chain(*extremes)])


Tree = TypeVar("Tree")

ACCURACY = 1e-11
"""Error of a step [m]: 3e-10 m along the records of the example, a thirtieth of their noise."""

_FEWEST = 512
"""Smallest capacity for integration steps."""

_MOST_SEGMENTS = 1 << 18
"""Most segments of a drive within a record; a fifth of them took 46 s for the first drawing on two busy cores."""

OUT_OF_STEPS = 1
"""Failure code of a run with too little room for steps."""


class _Room(NamedTuple):
    """Capacities for which a function is compiled."""

    steps: int
    segments: int
    """Segments of the drive; 0 where the function does not depend on their number."""


class LiveRecord:
    """A record of a study, compiled so that it is predicted at any numbers in milliseconds."""

    def __init__(self, study: Study, record: Record, values: Values):
        self.study, self.record = study, record
        self.models = study.models_with(values)
        self.setup: AbstractSetup = _as_arrays(record.measurement.setup(self.models))
        run, numbers = self._run_of(record, values)
        self._closed = is_closed(self.setup.system(self.models, numbers, run))
        self._rooms: list[_Room] = []
        """Compiled capacities, the smallest first, so that one for extreme numbers does not slow down all others."""
        self._plan(record, values)

    def run(self, record: Record, values: Values, instants: Float[np.ndarray, " k"]) -> Observation:
        """Predict the record at its sample times, and the motion inside at the `instants` [s].

        **Arguments:**

        - `record`: this record, possibly with other numbers of its drive.
        - `values`: the numbers [SI] of the parameters.
        - `instants`: times [s] on the clock of the record.

        Compiles where the numbers take more steps than there is room for.

        **Returns:** the prediction, with NaN and a `message` where the simulation fails.

        **Raises:** `InputError` where the drive has too many segments.
        """
        found = self.run_at_once(record, values, instants)
        return self._observed(record, values, instants, self._plan(record, values)) if found is None else found

    def run_at_once(self, record: Record, values: Values, instants: Float[np.ndarray, " k"]) -> Observation | None:
        """Predict as `run` does, but return None where a function must be compiled first."""
        segments = self._segments(record) if self._closed else 0
        for room in self._rooms:
            if room.segments >= segments:
                found = self._observed(record, values, instants, room)
                if int(found.failure) != OUT_OF_STEPS or room.steps >= self._full_accuracy(record).max_steps:
                    return found
        return None

    def _observed(self, record: Record, values: Values, instants: Float[np.ndarray, " k"], room: _Room) -> Observation:
        run, numbers = self._run_of(record, values)
        accuracy = Accuracy(ACCURACY, ACCURACY, max_steps=room.steps)
        found = observed(self.setup, self.models, run, numbers, instants, accuracy, room.segments)
        return jax.tree.map(np.asarray, found)

    def _segments(self, record: Record) -> int:
        """Number of segments of its drive that a record reaches; **raises** `InputError` for too many to draw."""
        segments = self.setup.segments(record.drive, record.time)
        if segments > _MOST_SEGMENTS:
            raise InputError(
                f'record "{record.name}": found a drive of {segments:.3g} segments within the record, expected '
                f"{_MOST_SEGMENTS} at most on this page: a lower frequency, or a shorter record."
            )
        return segments

    def _full_accuracy(self, record: Record) -> Accuracy:
        """Accuracy with capacity for all steps that a record may take."""
        segments, end = _power_of_two(self._segments(record)), float(record.time[-1])
        return with_room(Accuracy(ACCURACY, ACCURACY), self.setup, self.models, segments, end)

    def _run_of(self, record: Record, values: Values) -> tuple[Run, dict[str, Float[np.ndarray, ""]]]:
        """The run of the record, and the numbers of the parameters under its conditions."""
        numbers = {base: float(values[path]) for base, path in paths_in(values, record.conditions).items()}
        drive = None if record.drive is None else drive_with(record, numbers)
        motion = None if record.motion is None else jnp.asarray(record.motion)
        run = Run(_as_arrays(drive), jnp.asarray(record.time), motion)
        return run, {path: np.asarray(n, float) for path, n in numbers.items()}

    def _plan(self, record: Record, values: Values) -> _Room:
        """Add a larger room, in which the record can be predicted at the `values`, and return this room."""
        run, numbers = self._run_of(record, values)
        segments = _power_of_two(2 * self._segments(record)) if self._closed else 0
        most = self._full_accuracy(record)
        steps = 0 if self._closed else int(steps_taken(self.setup, self.models, run, numbers, most))
        known = max((room.steps for room in self._rooms), default=0)
        room = _Room(min(most.max_steps, _power_of_two(max(_FEWEST, known + 1, 1.5 * steps))), segments)
        self._rooms = sorted({*self._rooms, room})
        return room


def _as_arrays(tree: Tree) -> Tree:
    """`tree` with arrays in place of numbers, so that changed numbers compile nothing."""
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
    """Predict a run of a record, compiled; the `instants` [s] are on the clock of the record."""
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
    """Count the steps of a run; without output this compiles and runs quickly."""
    solution = integrate_steps(setup.system(models, values, run), setup.times(run)[-1], accuracy)
    return solution.count + solution.rejected


class LiveRecords:
    """The live records of a study for all pages and threads, each compiled when it is first drawn."""

    def __init__(self, study: Study):
        self.study = study
        self._live: dict[str, LiveRecord] = {}
        self._locks = {record.name: threading.Lock() for record in study.records}

    def is_ready(self, name: str) -> bool:
        """Whether the record `name` has been compiled."""
        return name in self._live

    def redraw(self, name: str, settings: Settings, instants: Float[np.ndarray, " k"]) -> Redraw:
        """The curves of the record `name` at the numbers of `settings`; may compile, which takes seconds."""
        record = self._at(name, settings)
        with self._locks[name]:
            live = self._live.get(name) or LiveRecord(self.study, record, settings.values)
            found = live.run(record, settings.values, instants)
            self._live[name] = live
        return redraw(record, found, instants)

    def redraw_at_once(self, name: str, settings: Settings, instants: Float[np.ndarray, " k"]) -> Redraw | None:
        """The curves in milliseconds, as by `redraw`, or None where a function must be compiled first."""
        record, lock = self._at(name, settings), self._locks[name]
        if name not in self._live or not lock.acquire(blocking=False):
            return None
        try:
            found = self._live[name].run_at_once(record, settings.values, instants)
        finally:
            lock.release()
        return None if found is None else redraw(record, found, instants)

    def _at(self, name: str, settings: Settings) -> Record:
        return next(record for record in study_at(self.study, settings).records if record.name == name)
