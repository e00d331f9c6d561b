"""When the fast flanks of a step or a sawtooth begin and how long they last, from the few samples that lie on them.

A voltage V and a start that come from a sawtooth's slow flanks alone are wrong by what is wrong in the fall time tf: by
V = s (T - tf), s the slope, and by tf.  One sample on each fast flank tells tf far below the sampling interval.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .sample_noise import scatter_between_corners
from .voltage_flanks import Samples

_TRIED = (0.3, 0.8, 1.3, 1.8, 2.4)
"""Sampling intervals from which the duration of a flank is looked for."""

_MOST = 30_000
"""Samples of the slow flanks that are used."""

_CORNER = 0.05
"""Part of a fast flank beside its ends, where a sample may as well be off it."""

_LOCATED = 0.5
"""Standard error of start and duration, in sampling intervals, above which samples on a flank do not locate it."""

_EXPLAINED = 1.5
"""Standard deviations of the voltage's noise up to which straight flanks explain it."""


class SharpFlanks(NamedTuple):
    """A step or a sawtooth with straight flanks, by least squares, with standard errors."""

    voltage: float
    """[V]"""
    period: float
    """Of a sawtooth [s]; infinite of a step."""
    start: float
    """Begin of a fast flank [s]."""
    duration: float
    """Of it [s]."""
    start_error: float
    """[s]"""
    duration_error: float
    """[s]"""


class _Fitted(NamedTuple):
    numbers: Float[np.ndarray, " p"]
    errors: Float[np.ndarray, " p"]


def sharpened_sawtooth(
    time: Samples, volts: Samples, forward: bool, about: tuple[float, float, float, float], seen: float, interval: float
) -> SharpFlanks | None:
    """The periodic sawtooth of least squares near `about`, all flanks straight, the fast ones included.

    **Arguments:** `volts` [V] at `time` [s], `interval` [s] apart; `about` holds voltage [V], period, begin of a fast
    flank and its duration [s], `seen` is that duration as two levels tell it.  **Returns:** None where too few samples
    lie on fast flanks, or where straight flanks do not explain the voltage within its noise.
    """
    voltage, period, start, fast = about
    turn = np.mod((time - start) / period + 0.5, 1.0) - 0.5
    near = np.abs(turn) * period < 2.0 * max(seen, interval) + 4.0 * interval
    thin = np.arange(time.size) % max(1, time.size // _MOST) == 0
    time, volts = time[near | thin], volts[near | thin]
    firsts = []
    for duration in (seen, *(share * interval for share in _TRIED)):
        # The slow flanks fix slope and place: a longer fast flank means less voltage, and falls begin earlier.
        longer = duration - fast
        firsts.append([voltage * (1.0 - longer / period), period, start - longer if forward else start, duration])
    bounds = (
        [0.5 * voltage, 0.9 * period, -np.inf, 1e-3 * interval],
        [2.0 * voltage, 1.1 * period, np.inf, 0.5 * period],
    )
    shape = lambda numbers: _sawtooth(time, forward, *numbers)
    found = _least_squares(shape, volts, firsts, bounds, [voltage, period / max(time.size, 1), interval, interval])
    if found is None:
        return None
    voltage, period, start, duration = (float(number) for number in found.numbers)
    flanks = round((time[-1] - time[0]) / period)
    told = max(found.errors[2:]) < _LOCATED * interval
    if not told or _on_flank(np.mod(time - start, period) / duration) < max(1, flanks // 4):
        return None
    return SharpFlanks(voltage, period, start, duration, float(found.errors[2]), float(found.errors[3]))


def sharpened_step(
    time: Samples, volts: Samples, about: tuple[float, float, float], interval: float
) -> SharpFlanks | None:
    """The same of a step: `about` holds voltage [V], begin and duration [s] of the rise."""
    voltage, start, rise = about
    middle = start + 0.5 * rise
    durations = (rise, *(share * interval for share in _TRIED))
    firsts = [[voltage, middle - 0.5 * duration, duration] for duration in durations]
    bounds = [0.5 * voltage, -np.inf, 1e-3 * interval], [2.0 * voltage, np.inf, np.inf]
    shape = lambda numbers: numbers[0] * np.clip((time - numbers[1]) / numbers[2], 0.0, 1.0)
    found = _least_squares(shape, volts, firsts, bounds, [voltage, interval, interval])
    if found is None:
        return None
    voltage, start, duration = (float(number) for number in found.numbers)
    if max(found.errors[1:]) > _LOCATED * interval or not _on_flank((time - start) / duration):
        return None
    return SharpFlanks(voltage, math.inf, start, duration, float(found.errors[1]), float(found.errors[2]))


def _least_squares(
    shape: Callable[[np.ndarray], Samples],
    volts: Samples,
    firsts: list[list[float]],
    bounds: tuple[list[float], list[float]],
    scale: list[float],
) -> _Fitted | None:
    """The best of the fits from the `firsts`, with standard errors; None where it leaves more than noise."""
    from scipy.optimize import least_squares

    best = None
    for first in firsts:
        start = np.clip(first, *bounds)
        found = least_squares(lambda n: shape(n) - volts, start, bounds=bounds, x_scale=scale, max_nfev=60)
        best = found if best is None or found.cost < best.cost else best
    assert best is not None
    left = math.sqrt(2.0 * best.cost / max(volts.size - best.x.size, 1))
    if left > _EXPLAINED * scatter_between_corners(volts) + 2e-4 * best.x[0]:
        return None
    return _Fitted(best.x, _errors(best.jac, left))


def _on_flank(passed: Samples) -> int:
    """How many samples lie on a flank, by the part of it that has passed at each."""
    return int(np.count_nonzero((passed > _CORNER) & (passed < 1.0 - _CORNER)))


def _sawtooth(time: Samples, forward: bool, voltage: float, period: float, start: float, duration: float) -> Samples:
    """Peak to 0 V within `duration` and back over the rest of a period; not `forward`: the other way."""
    passed = np.mod(time - start, period)
    fallen = np.where(passed < duration, passed / duration, (period - passed) / (period - duration))
    return voltage * (1.0 - fallen if forward else fallen)


def _errors(jacobian: Float[np.ndarray, "n p"], noise: float) -> Float[np.ndarray, " p"]:
    """Standard errors of the numbers of a least-squares fit; infinite where they are not determined."""
    size = np.linalg.norm(jacobian, axis=0)
    if np.any(size == 0.0):
        return np.full(size.size, math.inf)
    triangle = np.asarray(np.linalg.qr(jacobian / size, mode="r"))
    if np.min(np.abs(np.diag(triangle))) < 1e-10:
        return np.full(size.size, math.inf)
    return noise * np.linalg.norm(np.linalg.inv(triangle), axis=1) / size
