"""Smooths evenly spaced samples with a Gaussian, without delay.

    v_k = sum of g_j u_(k+j),   g_j proportional to exp(-(j dt)^2 / (2 sigma^2))

A harmonic of angular frequency w is left with exp(-(w sigma)^2 / 2) of its size.  White noise of
standard deviation s is left with s sqrt(dt / (2 sqrt(pi) sigma)), and its rate with that over sqrt(2) sigma, where
the raw samples' differences have sqrt(2) s / dt.
"""

import numpy as np
from jaxtyping import Float

_REACH = 5.0
"""Standard deviations that the kernel reaches to each side."""


def smoothed(samples: Float[np.ndarray, " n"], width: float) -> Float[np.ndarray, " n"]:
    """`samples` smoothed over `width`, sigma in intervals; beyond the ends they go on point-symmetrically."""
    reach = min(int(np.ceil(_REACH * width)), samples.size - 1)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / width) ** 2)
    before = 2.0 * samples[0] - samples[reach:0:-1]
    after = 2.0 * samples[-1] - samples[-2 : -reach - 2 : -1]
    return np.convolve(np.concatenate([before, samples, after]), kernel / kernel.sum(), "valid")
