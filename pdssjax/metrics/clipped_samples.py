"""Whether a record stays at the end of a range, where a sensor or a digitiser shows no more."""

import numpy as np
from jaxtyping import Float

_RUN = 8
"""Equal samples in a row, at least."""

_TIMES = 4
"""How many times as long as any run of equal samples between the extremes: a coarse sensor has such, too."""


def clipped(values: Float[np.ndarray, " n"]) -> dict[str, int]:
    """How many samples lie in long runs of exactly the "highest" or the "lowest" value; neither where none does.

    Runs with which the record begins or ends count only beside others: it may be at rest there.
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
        if long[1:-1].any():
            found[end] = int(np.sum(lengths[long]))
    return found
