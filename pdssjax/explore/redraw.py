"""The curves that the page draws of one record, and how well the record is predicted."""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ..metrics import scatter_floor
from ..simulation import Inside, Observation
from ..study import Record, cycles_a_second

DRAWN = 4000
"""Largest number of samples of a record that are drawn."""

OVERVIEW, ENLARGED = 700, 2000
"""Number of instants at which the prediction is drawn, over the whole record and over the enlarged stretch."""


class Score(NamedTuple):
    """How well a record is predicted."""

    rmse: float
    """Root mean square of the residuals, in the unit of the record."""
    chi2: float
    """Chi-square a degree of freedom; NaN where the simulation failed or no noise is known."""
    noise: float
    """Standard deviation to which chi-square refers."""
    noise_given: bool
    """Whether the study gives the noise; else it is estimated from neighbouring samples."""
    offset: float
    """The zero of the record: given, or the best one at these numbers."""


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
    """Why the simulation failed; empty where it did not fail."""


def redraw(record: Record, found: Observation, instants: Float[np.ndarray, " k"]) -> Redraw:
    """Compute the curves of `record` from its simulated observation `found`."""
    shown = np.asarray(found.shown)
    score = score_of(record, shown)
    zero = score.offset
    between = np.asarray(found.between) + zero
    return Redraw(shown + zero, record.measured - shown - zero, instants, between, found.inside, score, found.message)


def score_of(record: Record, shown: Float[np.ndarray, " samples"]) -> Score:
    """How well `shown`, the prediction without an offset, explains the record."""
    zero = float(np.mean(record.measured - shown)) if record.offset is None else record.offset
    squares = float(np.sum((record.measured - shown - zero) ** 2))
    noise, count = known_noise(record), record.measured.size
    freedom = max(count - (record.offset is None), 1)
    chi2 = squares / noise**2 / freedom if noise > 0 else math.nan
    return Score(math.sqrt(squares / count), chi2, noise, record.noise is not None, zero)


def known_noise(record: Record) -> float:
    """Standard deviation of a record's noise: given, or from neighbouring samples; NaN where these are too few."""
    if record.noise is not None:
        return record.noise
    return scatter_floor(record.measured) if record.time.size >= 8 else math.nan


def initial_stretch(record: Record) -> tuple[float, float]:
    """The stretch [s] that is enlarged at first: around the fastest motion, such as a slip or the onset of a step."""
    time = record.time
    width = max(60 * float(np.median(np.diff(time))), float(time[-1] - time[0]) / 60)
    jump = float(time[np.argmax(np.abs(np.diff(record.measured) / np.diff(time)))])
    return within(record, jump - 0.15 * width, jump + 0.85 * width)


def within(record: Record, begin: float, end: float) -> tuple[float, float]:
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
    """Times [s] at which the prediction is drawn, dense from `begin` to `end`; their number is always the same."""
    whole = np.linspace(record.time[0], record.time[-1], OVERVIEW)
    return np.sort(np.concatenate([whole, np.linspace(begin, end, ENLARGED)]))


def drawn_samples(record: Record) -> Int[np.ndarray, " drawn"]:
    """Indices of the samples that are drawn: all, or the extremes of each of many stretches of a long record."""
    size = record.time.size
    if size <= DRAWN:
        return np.arange(size)
    edges = np.linspace(0, size, DRAWN // 2 + 1).astype(int)
    ends = [(begin + part.argmin(), begin + part.argmax()) for begin, part in _parts(record, edges)]
    return np.unique(np.concatenate([[0, size - 1], np.ravel(ends)]))


def _parts(record: Record, edges: Int[np.ndarray, " edges"]) -> list[tuple[int, Float[np.ndarray, " part"]]]:
    pairs = zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)
    return [(begin, record.measured[begin:end]) for begin, end in pairs]
