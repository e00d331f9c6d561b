"""Parameters that records of steady sines cannot separate: a sine shows two numbers, gain and phase at its frequency.

A stack's natural frequency, damping ratio and hysteresis all change the phase.  With too few frequencies a fit
separates them by the shape of the loops, which is that of the assumed law: one ended at 71 rad/s for 39 rad/s, with an
error of 0.24 %.  The transient after the onset of a drive may still determine them.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..study import MARK, Record
from .covariance import least_squares_covariance
from .evidence import Evidence
from .initial_values.record_features import frequency_of, voltages

_SINE = 0.01
"""Largest rms residual of a sine in a voltage that counts as one, as a fraction of the amplitude."""

ELECTRONICS = ("sensor.bandwidth", "sensor.delay", "amplifier.bandwidth")
"""Other parameters that change the phase."""


class InseparableParameters(NamedTuple):
    """Parameters that steady sines do not tell apart."""

    paths: tuple[str, ...]
    """Paths of the parameters that change the phase, and are not determined by the onset of a drive."""
    beside: tuple[str, ...]
    """Other unknowns that gains and phases must determine, in words."""
    records: tuple[str, ...]
    """Names of the records."""
    frequencies: tuple[float, ...]
    """The different frequencies of the drives [Hz]."""


class _Sine(NamedTuple):
    frequency: float
    """[Hz]"""
    amplitude: float
    """[V]"""


def inseparable(evidence: Evidence) -> InseparableParameters | None:
    """The parameters of a fit that its records cannot tell apart if all are steady sines; None where they can."""
    problem = evidence.problem
    sines = [sine for record in problem.records if (sine := _sine(record)) is not None]
    if len(sines) < len(problem.records) or not sines or not np.isfinite(evidence.fit.chi2):
        return None
    piezo = problem.residual.predictor.models.piezo
    free = problem.residual.transform.paths
    bare = [path.partition(MARK)[0] for path in free]
    turns = {*ELECTRONICS, *(f"piezo.{name}" for name in piezo.mechanical)}
    turning = [path for path, name in zip(free, bare, strict=True) if name in turns]
    lossy = any(name.removeprefix("piezo.") in piezo.hysteretic for name in bare if name.startswith("piezo."))
    frequencies = _distinct([sine.frequency for sine in sines])
    # Loops of several sizes at one frequency tell hysteresis, which depends on the size, from damping.
    several = len(sines) > len(frequencies) and len(_distinct([sine.amplitude for sine in sines])) > 1
    beside = ["piezo.gain"] * ("piezo.gain" in bare) + ["hysteresis"] * (lossy and not several)
    if len(turning) + len(beside) <= 2 * len(frequencies):
        return None
    determined = _determined_by_onset(evidence, [sine.frequency for sine in sines])
    paths = tuple(path for path in turning if path not in determined)
    names = tuple(record.name for record in problem.records)
    return InseparableParameters(paths, tuple(beside), names, tuple(frequencies)) if paths else None


def _sine(record: Record) -> _Sine | None:
    """The sine that drives a platform seen alone through a whole record; None where another voltage does."""
    if record.drive is None or not record.measurement.platform_alone or record.time.size < 16:
        return None
    return steady_sine(record.time, voltages(record), frequency_of(record))


def steady_sine(time: Float[np.ndarray, " n"], volts: Float[np.ndarray, " n"], frequency: float | None) -> _Sine | None:
    """The sine that `volts` at `time` [s] are throughout, for a cycle or more, of the `frequency` [Hz] or of any."""
    elapsed = time - time[0]
    if frequency is None:
        even = np.linspace(0.0, elapsed[-1], time.size)
        spectrum = np.abs(np.fft.rfft(np.hanning(time.size) * (np.interp(even, elapsed, volts) - np.mean(volts))))
        frequency = float(np.argmax(spectrum)) / float(elapsed[-1])
    amplitude, left = 0.0, math.inf
    for _ in range(8):
        if frequency * elapsed[-1] < 1.0:
            return None
        angle = 2.0 * np.pi * frequency * elapsed
        turn = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        design = np.column_stack([np.ones(time.size), turn, turn * (elapsed / elapsed[-1])[:, None]])
        constant, a, b, da, db = np.linalg.lstsq(design, volts, rcond=None)[0]
        amplitude = math.hypot(a, b)
        left = float(np.sqrt(np.mean((volts - design[:, :3] @ [constant, a, b]) ** 2)))
        if left < _SINE * amplitude or amplitude == 0.0:
            break
        # Of a frequency that is off by d/(2 pi) a cos + b sin grows by d t (b cos - a sin).
        frequency += float(b * da - a * db) / amplitude**2 / (2.0 * np.pi * float(elapsed[-1]))
    return _Sine(frequency, amplitude) if left < _SINE * amplitude else None


def _distinct(numbers: Sequence[float]) -> list[float]:
    """The ascending numbers that differ by more than a per cent."""
    distinct: list[float] = []
    for number in sorted(numbers):
        if not distinct or number > 1.01 * distinct[-1]:
            distinct.append(number)
    return distinct


def _determined_by_onset(evidence: Evidence, frequencies: Sequence[float]) -> set[str]:
    """Paths of the free parameters that the transient after the onset of a drive determines to ten per cent."""
    problem, jacobian = evidence.problem, np.asarray(evidence.fit.state.jacobian)
    if not np.isfinite(jacobian).all():
        return set()
    rest = jacobian.copy()
    for record, rows, frequency in zip(problem.records, problem.rows, frequencies, strict=True):
        # Without the harmonics of the drive, as many as the samples show.
        time = record.time
        cycle = 1.0 / (frequency * float(np.median(np.diff(time))))
        harmonics = np.arange(1, int(min(60, 0.45 * cycle, time.size // 6)) + 1)
        angle = 2.0 * np.pi * frequency * np.outer(time - time[0], harmonics)
        base = np.column_stack([np.ones(time.size), np.cos(angle), np.sin(angle)])
        rest[rows] -= base @ np.linalg.lstsq(base, jacobian[rows], rcond=None)[0]
    # A column that is rounding only has no information.
    rest[:, np.linalg.norm(rest, axis=0) < 1e-9 * np.linalg.norm(jacobian, axis=0)] = 0.0
    transform = problem.residual.transform
    known = least_squares_covariance(rest, transform.at_bound(evidence.fit.free))
    error = np.sqrt(np.diag(known.matrix) * max(1.0, evidence.reduced_chi2))
    return {path for path, e in zip(transform.paths, error, strict=True) if e < 0.1}
