"""Whether the points of a sweep fit into the memory of this machine."""

import os

from ..core import InputError

_COPIES = 4
"""Of all points and all that is found of them, at once: in the order of the axes, in that of the blocks, labelled."""

_SHARE = 0.5
"""Part of the machine's memory that they may take."""


def check_memory(points: int, paths: int, columns: int) -> None:
    """**Raises** `InputError` for more points than this machine can hold, with `columns` numbers found at each.

    Where the machine does not tell how much memory it has nothing is refused.
    """
    try:
        there = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return
    needed = 8 * _COPIES * points * (paths + columns)
    if needed > _SHARE * there:
        raise InputError(
            f"sweep: found {points:.4g} points, which take {1e-9 * needed:.3g} GB of memory, expected at most "
            f"{1e-9 * _SHARE * there:.3g} GB, half of what this machine has: ask for fewer, or for one part after "
            "the other."
        )
