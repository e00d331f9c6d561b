"""Whether a record stays at the end of a range, where a sensor or a digitiser shows no more."""

import numpy as np
from jaxtyping import Float

_RUN = 8
"""Equal samples in a row, at least."""

_TIMES = 4
"""How many times as long as any run of equal samples between the extremes: a coarse sensor has such, too."""

_MOVED = 0.1
"""Part of its range that a voltage goes through in the middle half of a run, if the drive runs there."""


def clipped(values: Float[np.ndarray, " n"], voltage: Float[np.ndarray, " n"] | None = None) -> dict[str, int]:
    """How many samples lie in long runs of exactly the "highest" or the "lowest" value; neither where none does.

    Runs with which the record begins or ends count only beside others, or where the `voltage` moves on: without a drive
    a sensor without noise shows such a rest.
    """
    beside = np.flatnonzero(np.diff(values) != 0.0)
    ends = np.append(beside + 1, values.size)
    lengths = np.diff(np.append(0, ends))
    levels = values[ends - 1]
    inside = (levels > values.min()) & (levels < values.max())
    least = max(_RUN, _TIMES * int(np.max(lengths[inside], initial=0)))
    found = {}
    for end, level in (("highest", values.max()), ("lowest", values.min())):
        long = (levels == level) & (lengths >= least)
        outer = [run for run in {0, lengths.size - 1} if long[run]]
        if long[1:-1].any() or any(_moves(voltage, ends[run] - lengths[run], lengths[run]) for run in outer):
            found[end] = int(np.sum(lengths[long]))
    return found


def _moves(voltage: Float[np.ndarray, " n"] | None, first: int, count: int) -> bool:
    """The voltage goes on in the middle half of a run of samples."""
    if voltage is None:
        return False
    middle = voltage[first + count // 4 : first + count - count // 4]
    return bool(np.ptp(middle) > _MOVED * np.ptp(voltage))
