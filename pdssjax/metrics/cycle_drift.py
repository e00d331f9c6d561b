"""How far a motion that repeats has got after each cycle."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float


class CycleDrift(NamedTuple):
    """What a cycle leaves, and what it consists of, in the unit of the samples."""

    net: float
    """From one cycle to the next, on average."""
    standard_error: float
    """Of `net`, by the scatter of the samples; their noise is taken for independent."""
    stroke: float
    """Between the extremes, once the drift is taken out."""


def drift_per_cycle(
    time: Float[np.ndarray, " n"], values: Float[np.ndarray, " n"], frequency: float
) -> CycleDrift | None:
    """Every sample beside what was measured a cycle later, the first cycle left out where three are there.

    **Arguments:** `time` [s] ascends; `frequency` in cycles a second [Hz].

    **Returns:** None where the samples cover less than two cycles.
    """
    period = 1.0 / frequency
    covered = (time[-1] - time[0]) * frequency
    if covered < 2.0 - 1e-6:
        return None
    begin = time[0] + (period if covered > 3.0 else 0.0)
    whole = int((time[-1] - begin) * frequency + 1e-6) - 1
    taken = (time >= begin) & (time < begin + whole * period)
    later = np.interp(time[taken] + period, time, values)
    steps = later - values[taken]
    straight = values - np.mean(steps) * (time - time[0]) * frequency
    return CycleDrift(float(np.mean(steps)), float(np.std(steps) / np.sqrt(steps.size)), float(np.ptp(straight)))
