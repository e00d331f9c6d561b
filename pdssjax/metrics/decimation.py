"""Thins samples behind a low-pass, so that what is faster than the new samples can show does not fold into them.

A linear-phase filter, h_k = sinc(2 f k) w_k with a Kaiser window (beta = 8.6, 90 dB): it passes what lies below
0.32 of the new sampling rate and stops what lies above half of it; nothing is delayed.
"""

import numpy as np
from jaxtyping import Float

_REACH = 16
"""New samples on each side that the filter takes."""

_MIDDLE = 0.411
"""Of the filter's flank, in new sampling rates."""

_BETA = 8.6


def decimated(samples: Float[np.ndarray, "samples columns"], by: int) -> Float[np.ndarray, "kept columns"]:
    """Every sample number `by` of evenly spaced `samples`, behind a low-pass.

    Those within 16 new samples of an end, for which the filter has not enough, are left out.
    """
    reach = _REACH * by
    around = np.arange(-reach, reach + 1)
    kernel = np.sinc(2.0 * _MIDDLE * around / by) * np.kaiser(2 * reach + 1, _BETA)
    kernel /= kernel.sum()
    if len(samples) < kernel.size:
        return samples[:0]
    windows = np.lib.stride_tricks.sliding_window_view(samples, kernel.size, axis=0)[::by]
    return windows @ kernel
