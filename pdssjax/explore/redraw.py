"""What the page draws of one record: prediction and residuals beside the samples, and what the record is worth."""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ..metrics import scatter_floor
from ..simulation import Inside, Observation
from ..study import Record, cycles_a_second

DRAWN = 4000
"""Samples that are drawn of a record at most."""

OVERVIEW, ENLARGED = 700, 2000
"""Instants of the whole record, and of the stretch that is enlarged, at which the prediction is drawn."""


class Score(NamedTuple):
    """How well a record is predicted."""

    rmse: float
    """Root mean square of the residuals, in the unit of the record."""
    chi2: float
    """Chi-square a degree of freedom; NaN where the simulation failed or no noise is known."""
    noise: float
    """Standard deviation against which chi-square is counted."""
    noise_given: bool
    """The study gives it; else it is that seen between neighbouring samples."""
    offset: float
    """The record's zero: given, or the best at these numbers."""


class Redraw(NamedTuple):
    """A record at some numbers, SI."""

    predicted: Float[np.ndarray, " samples"]
    """At the record's samples, the offset included."""
    residual: Float[np.ndarray, " samples"]
    """Measured minus predicted."""
    instants: Float[np.ndarray, " k"]
    """[s], at which the rest is told."""
    between: Float[np.ndarray, " k"]
    """Predicted, the offset included."""
    inside: Inside
    score: Score
    message: str
    """Why the simulation failed; empty where it did not."""


def redraw(record: Record, found: Observation, instants: Float[np.ndarray, " k"]) -> Redraw:
    """What is drawn of `record` where `found` is how it was simulated."""
    shown = np.asarray(found.shown)
    score = score_of(record, shown)
    zero = score.offset
    between = np.asarray(found.between) + zero
    return Redraw(shown + zero, record.measured - shown - zero, instants, between, found.inside, score, found.message)


def score_of(record: Record, shown: Float[np.ndarray, " samples"]) -> Score:
    """How well the prediction `shown`, without the record's zero, explains it."""
    zero = float(np.mean(record.measured - shown)) if record.offset is None else record.offset
    squares = float(np.sum((record.measured - shown - zero) ** 2))
    noise, count = known_noise(record), record.measured.size
    freedom = max(count - (record.offset is None), 1)
    chi2 = squares / noise**2 / freedom if noise > 0 else math.nan
    return Score(math.sqrt(squares / count), chi2, noise, record.noise is not None, zero)


def known_noise(record: Record) -> float:
    """The standard deviation of a record's noise: given, or seen between neighbouring samples; NaN for too few."""
    if record.noise is not None:
        return record.noise
    return scatter_floor(record.measured) if record.time.size >= 8 else math.nan


def enlarged_at_first(record: Record) -> tuple[float, float]:
    """From when to when [s] a record is enlarged at first: around its fastest motion, a slip or the onset of a step."""
    time = record.time
    width = max(60 * float(np.median(np.diff(time))), float(time[-1] - time[0]) / 60)
    jump = float(time[np.argmax(np.abs(np.diff(record.measured) / np.diff(time)))])
    return within(record, jump - 0.15 * width, jump + 0.85 * width)


def within(record: Record, begin: float, end: float) -> tuple[float, float]:
    """The stretch from `begin` to `end` [s], moved and shortened so that it lies within the record."""
    first, last = float(record.time[0]), float(record.time[-1])
    width = min(max(end - begin, (last - first) / 2000), last - first)
    begin = min(max(begin, first), last - width)
    return begin, begin + width


def cycle_of(record: Record) -> float:
    """By how much the stretch enlarged moves at a time [s]: a cycle of the drive, or a tenth of the record."""
    frequency = cycles_a_second(record)
    return 1.0 / frequency if frequency else float(record.time[-1] - record.time[0]) / 10


def instants_of(record: Record, begin: float, end: float) -> Float[np.ndarray, " k"]:
    """When the prediction is drawn [s]: over the whole record, and closely from `begin` to `end`; always as many."""
    whole = np.linspace(record.time[0], record.time[-1], OVERVIEW)
    return np.sort(np.concatenate([whole, np.linspace(begin, end, ENLARGED)]))


def drawn_samples(record: Record) -> Int[np.ndarray, " drawn"]:
    """Which samples are drawn: all, or of a long record the least and the largest of each of many stretches."""
    size = record.time.size
    if size <= DRAWN:
        return np.arange(size)
    edges = np.linspace(0, size, DRAWN // 2 + 1).astype(int)
    ends = [(begin + part.argmin(), begin + part.argmax()) for begin, part in _parts(record, edges)]
    return np.unique(np.concatenate([[0, size - 1], np.ravel(ends)]))


def _parts(record: Record, edges: Int[np.ndarray, " edges"]) -> list[tuple[int, Float[np.ndarray, " part"]]]:
    pairs = zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)
    return [(begin, record.measured[begin:end]) for begin, end in pairs]
