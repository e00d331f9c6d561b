"""The duration of a sawtooth's fast flanks, from the few samples that lie on them.

A voltage V and a start that come from the slow flanks alone are wrong by what is wrong in the fall time tf: by
V = s (T - tf), s the slope, and by tf.  One sample on each fast flank tells tf far below the sampling interval.
"""

import math

import numpy as np

from .sample_noise import scatter_between_corners
from .voltage_flanks import Samples

Flanked = tuple[float, float, float, float]
"""Voltage [V], period [s], begin of a fast flank [s] and its duration [s]."""

_TRIED = (0.3, 0.8, 1.3, 1.8, 2.4)
"""Sampling intervals from which the duration of a flank is looked for."""

_MOST = 30_000
"""Samples of the slow flanks that are used."""

_KNOWN = 0.1
"""Standard error of the duration, in sampling intervals, above which it is not known."""

_CORNER = 0.05
"""Part of a fast flank beside its ends, where a sample may as well be off it."""

_EXPLAINED = 1.5
"""Standard deviations of the voltage's noise up to which straight flanks explain it."""


def sharpened_sawtooth(
    time: Samples, volts: Samples, forward: bool, about: Flanked, seen: float, interval: float
) -> Flanked | None:
    """The periodic sawtooth of least squares near `about`, all flanks straight, the fast ones included.

    **Arguments:** `volts` [V] at `time` [s], `interval` [s] apart; `seen` is the duration of the fast flanks [s] as
    two levels tell it.  **Returns:** None where no sample lies on a fast flank, where straight flanks do not
    explain the voltage within its noise, or where its samples do not tell the duration.
    """
    from scipy.optimize import least_squares

    _, period, start, _ = about
    turn = np.mod((time - start) / period + 0.5, 1.0) - 0.5
    near = np.abs(turn) * period < 2.0 * max(seen, interval) + 4.0 * interval
    thin = np.arange(time.size) % max(1, time.size // _MOST) == 0
    time, volts = time[near | thin], volts[near | thin]
    scale = np.array([about[0], period / max(time.size, 1), interval, interval])

    def residual(numbers: np.ndarray) -> np.ndarray:
        return _sawtooth(time, forward, *numbers) - volts

    best = None
    for duration in (seen, *(share * interval for share in _TRIED)):
        # The slow flanks fix slope and place: a longer fast flank means less voltage, and falls begin earlier.
        longer = duration - about[3]
        first = [about[0] * (1.0 - longer / period), period, start - longer if forward else start, duration]
        low, high = (
            [0.5 * about[0], 0.9 * period, -np.inf, 1e-3 * interval],
            [2 * about[0], 1.1 * period, np.inf, period / 2],
        )
        found = least_squares(residual, np.clip(first, low, high), bounds=(low, high), x_scale=scale, max_nfev=60)
        best = found if best is None or found.cost < best.cost else best
    assert best is not None
    noise = scatter_between_corners(volts)
    left = math.sqrt(2.0 * best.cost / max(time.size - 4, 1))
    if left > _EXPLAINED * noise + 2e-4 * about[0]:
        return None
    voltage, period, start, duration = (float(number) for number in best.x)
    passed = np.mod(time - start, period) / duration
    between = np.count_nonzero((passed > _CORNER) & (passed < 1.0 - _CORNER))
    flanks = round((time[-1] - time[0]) / period)
    if between < max(1, flanks // 4) or _error_of_last(best.jac, left) > _KNOWN * interval:
        return None
    return voltage, period, start, duration


def _sawtooth(time: Samples, forward: bool, voltage: float, period: float, start: float, duration: float) -> Samples:
    """Peak to 0 V within `duration` and back over the rest of a period; not `forward`: the other way."""
    passed = np.mod(time - start, period)
    fallen = np.where(passed < duration, passed / duration, (period - passed) / (period - duration))
    return voltage * (1.0 - fallen if forward else fallen)


def _error_of_last(jacobian: np.ndarray, noise: float) -> float:
    """Standard error of the last number of a least-squares fit; infinite where it is not determined."""
    size = np.linalg.norm(jacobian, axis=0)
    if np.any(size == 0.0):
        return math.inf
    triangle = np.asarray(np.linalg.qr(jacobian / size, mode="r"))
    return noise / (abs(float(triangle[-1, -1])) * float(size[-1]) + 1e-300)
