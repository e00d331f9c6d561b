"""Samples smoothed by a Gaussian, thinned behind a low-pass, and integrated: none of it with a delay.

Smoothing takes v_k = sum of g_j u_(k+j), with g_j proportional to exp(-(j dt)^2 / (2 sigma^2)).  A harmonic of angular
frequency w is left with exp(-(w sigma)^2 / 2) of its size.  White noise of standard deviation s is left with
s sqrt(dt / (2 sqrt(pi) sigma)), and its rate with that over sqrt(2) sigma, where the raw samples' differences have
sqrt(2) s / dt.

Thinning takes h_k = sinc(2 f k) w_k with a Kaiser window (beta = 8.6, 90 dB), which passes what lies below 0.32 of the
new sampling rate and stops what lies above half of it, so that nothing faster than the new samples can show folds into
them.
"""

import numpy as np
from jaxtyping import Float

from .sensor_samples import Samples


def smoothed(samples: Samples, width: float) -> Samples:
    """`samples` smoothed over `width`, sigma in intervals; beyond the ends they go on point-symmetrically."""
    reach = min(int(np.ceil(5.0 * width)), samples.size - 1)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / width) ** 2)
    before = 2.0 * samples[0] - samples[reach:0:-1]
    after = 2.0 * samples[-1] - samples[-2 : -reach - 2 : -1]
    return np.convolve(np.concatenate([before, samples, after]), kernel / kernel.sum(), "valid")


_FILTER_REACH = 16
"""Reach of the low-pass to each side, in new samples."""

_CUTOFF = 0.411
"""Middle of the low-pass's flank, in units of the new sampling rate."""

_BETA = 8.6


def decimated(samples: Float[np.ndarray, "samples columns"], by: int) -> Float[np.ndarray, "kept columns"]:
    """Every sample number `by` of evenly spaced `samples`, behind a low-pass.

    Those within 16 new samples of an end, for which the filter has not enough, are left out.
    """
    reach = _FILTER_REACH * by
    around = np.arange(-reach, reach + 1)
    kernel = np.sinc(2.0 * _CUTOFF * around / by) * np.kaiser(2 * reach + 1, _BETA)
    kernel /= kernel.sum()
    if len(samples) < kernel.size:
        return samples[:0]
    windows = np.lib.stride_tricks.sliding_window_view(samples, kernel.size, axis=0)[::by]
    return windows @ kernel


_FEWEST_AT_REST = 8
"""Fewest samples whose mean serves as a zero."""


def velocity_zero(time: Samples, speed: Samples, volts: Samples, returns: bool) -> float | None:
    """Zero of a velocity sensor [m/s]: what it shows of a thing at rest, from a record `speed` [m/s].

    Before the drive, which starts at `time` 0 [s]; or at the end, where the voltage `volts` [V] holds; or on average,
    of what `returns` to where it began.  None where no part of the record tells it.
    """
    late = volts[-max(volts.size // 5, _FEWEST_AT_REST) :]
    if np.sum(time < 0) >= _FEWEST_AT_REST:
        rests = speed[time < 0]
    elif np.ptp(late) <= 1e-3 * np.max(np.abs(volts)):
        rests = speed[-late.size :]
    elif returns:
        rests = speed
    else:
        return None
    return float(np.mean(rests))


def integrated(time: Samples, speed: Samples) -> Samples:
    """Displacement [m] since the first sample, by the trapezoidal rule."""
    steps = 0.5 * (speed[1:] + speed[:-1]) * np.diff(time)
    return np.concatenate([np.zeros(1), np.cumsum(steps)])
