"""The way that a velocity adds up to, and what its sensor shows of a thing at rest."""

import numpy as np
from jaxtyping import Float

_FEWEST = 8
"""Samples whose mean is taken for a zero."""

_RESTS = 1e-3
"""Part of the largest voltage by which it may vary where the rig is taken to rest."""


def rest_of(
    time: Float[np.ndarray, " n"], speed: Float[np.ndarray, " n"], volts: Float[np.ndarray, " n"], returns: bool
) -> float | None:
    """What the sensor of a velocity `speed` [m/s] shows of a thing at rest [m/s].

    Before the drive, which starts at `time` 0 [s]; or at the end, where the voltage `volts` [V] holds; or on average,
    of what `returns` to where it began.  None where no part of the record tells it.
    """
    late = volts[-max(volts.size // 5, _FEWEST) :]
    if np.sum(time < 0) >= _FEWEST:
        rests = speed[time < 0]
    elif np.ptp(late) <= _RESTS * np.max(np.abs(volts)):
        rests = speed[-late.size :]
    elif returns:
        rests = speed
    else:
        return None
    return float(np.mean(rests))


def integrated(time: Float[np.ndarray, " n"], speed: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """The way [m] since the first sample, by trapezia."""
    steps = 0.5 * (speed[1:] + speed[:-1]) * np.diff(time)
    return np.concatenate([np.zeros(1), np.cumsum(steps)])
