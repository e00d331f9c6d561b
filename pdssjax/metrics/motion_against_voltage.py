"""Whether a motion goes against the voltage: a sensor that counts the other way, or the other direction of a drive.

A platform follows the voltage, and so does what sticks to it; only slips do not.
"""

import math

import numpy as np
from jaxtyping import Float

_CLEAR = -0.7
"""Correlation of motion and voltage, both without their lines in time, below which a motion goes against it."""

_MOST = 0.75
"""Share of the cycles in which an end-effector goes against the voltage where its sensor counts the other way."""

_LATE = 0.5, 0.95
"""Parts of a cycle, from one fast flank to the next, between which the slow one is looked at."""


def goes_against(
    time: Float[np.ndarray, " n"], motion: Float[np.ndarray, " n"], volts: Float[np.ndarray, " n"]
) -> bool:
    """Whether `motion` [m] goes against `volts` [V] at `time` [s], of a platform or of what follows it."""
    return _correlation(time, motion, volts) < _CLEAR


def rides_against(
    time: Float[np.ndarray, " n"],
    motion: Float[np.ndarray, " n"],
    volts: Float[np.ndarray, " n"],
    period: float,
    start: float = 0.0,
) -> bool:
    """Whether an end-effector goes against the voltage late on slow flanks, where it rides on the platform.

    What it does on the fast ones tells nothing: a platform that rings may throw it on as well as back.

    **Arguments:** a fast flank begins every `period` [s] from the `start` [s] on.
    """
    first = math.ceil((time[0] - start) / period - _LATE[0])
    cycles = np.arange(max(first, 0), math.floor((time[-1] - start) / period - _LATE[1]) + 1)
    if not cycles.size:
        return goes_against(time, motion, volts)
    # Samples within: between two of them may lie the fast flank.
    early, late = (start + (cycles + part) * period for part in _LATE)
    firsts, lasts = np.searchsorted(time, early), np.searchsorted(time, late, side="right") - 1
    within = lasts > firsts
    if not within.any():
        return goes_against(time, motion, volts)
    ways = [column[lasts[within]] - column[firsts[within]] for column in (motion, volts)]
    return bool(np.mean(ways[0] * ways[1] < 0) > _MOST)


def _correlation(
    time: Float[np.ndarray, " n"], motion: Float[np.ndarray, " n"], volts: Float[np.ndarray, " n"]
) -> float:
    """Of motion and voltage, both without their lines in time; 0 where one of them is a line."""
    line = np.stack([np.ones(time.size), time - time.mean()], axis=1)
    bent = [column - line @ np.linalg.lstsq(line, column, rcond=None)[0] for column in (motion, volts)]
    size = [float(np.linalg.norm(column)) for column in bent]
    if size[1] <= 1e-6 * np.linalg.norm(volts) or size[0] == 0:
        return 0.0
    return float(bent[0] @ bent[1]) / (size[0] * size[1])
