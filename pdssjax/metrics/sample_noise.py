"""The noise of samples: how far neighbours scatter, whatever slower motion there is."""

import numpy as np
from jaxtyping import Float

_FAR = 3.0
"""Standard deviations from which a second difference counts as motion, not noise."""

_KEPT = 0.98658
"""Standard deviation of a normal variable cut off there."""

_BEND = float(np.sqrt(6.0))
"""Standard deviation of a second difference of white noise of standard deviation 1."""

_FEWEST_TURNS = 8
"""Turns from one sample to the next from which a voltage flickers."""

_TURNING = 0.005
"""Share of the samples that turn in a voltage that flickers, at least."""

_EXACT = 1e-8
"""Part of the samples' standard deviation that no sensor resolves: one of 0.1 nm does 1e-8 of a way of 1 cm."""


def neighbour_scatter(values: Float[np.ndarray, " n"]) -> float:
    """The standard deviation of white noise in `values`, from their second differences.

    Robust against fast motion, such as a slip's, which fills few samples: what lies far out is left out again and
    again.  A smooth motion between samples hardly enters, and rounding no more than it does in the noise itself.  Of
    fewer than eight values, their own standard deviation.
    """
    if values.size < 8:
        return float(np.std(values))
    bends = np.abs(np.diff(values, 2))
    spread = _typical(bends)
    for _ in range(20):
        near = bends[bends <= _FAR * spread] if spread > 0 else bends
        spread = float(np.sqrt(np.mean(near**2))) / _KEPT
    return spread / _BEND


def scatter_between_corners(values: Float[np.ndarray, " n"]) -> float:
    """The same of a voltage, straight between its corners: less than half of the samples may be next to one.

    By the median alone, which stays 0 where nothing but corners scatters.  Each sample next to a corner raises it: 43 %
    too much where a quarter are.  Of fewer than four values, 0.
    """
    return _typical(np.abs(np.diff(values, 2))) / _BEND if values.size > 3 else 0.0


def flicker_of(volts: Float[np.ndarray, " n"]) -> float:
    """How far a voltage jumps to and fro between neighbouring samples, in its unit; 0 where it hardly does.

    That is one step of a converter that flickers between two, however seldom, and 1.7 standard deviations of white
    noise.  A voltage without noise turns at its corners alone.
    """
    steps = np.diff(volts)
    turns = np.flatnonzero(steps[1:] * steps[:-1] < 0)
    if turns.size < max(_FEWEST_TURNS, _TURNING * volts.size):
        return 0.0
    return float(np.percentile(np.minimum(np.abs(steps[turns]), np.abs(steps[turns + 1])), 90.0))


def scatter_floor(measured: Float[np.ndarray, " samples"]) -> float:
    """A first guess of the noise from the scatter of second differences, in the samples' unit; above zero."""
    scatter = neighbour_scatter(measured)
    if measured.size < 8:
        return scatter or 1e-9
    return max(scatter, _EXACT * float(np.std(measured)), 1e-12)


def _typical(bends: Float[np.ndarray, " n"]) -> float:
    """The standard deviation of normal numbers of these sizes, by their median."""
    return 1.4826 * float(np.median(bends))
