"""Where fits from many starts ended, as text."""

import numpy as np

from ...study import Multistart
from ._layout import aligned_table, heading


def format_multistart(multistart: Multistart) -> str:
    """How many starts led to which optimum, and how much worse each is than the best."""
    count, least = multistart.chi2.size, float(np.min(multistart.chi2))
    failed = int(np.sum(~multistart.converged))
    optima = "1 optimum" if multistart.distinct == 1 else f"{multistart.distinct} distinct optima"
    said = f"    {count} starts, {count - failed} of them converged, to {optima}\n"
    rows = [["optimum", "starts", "chi-square above the lowest"]]
    for number in range(multistart.distinct):
        at = multistart.optimum == number
        rows.append([str(number + 1), str(int(np.sum(at))), f"{float(np.min(multistart.chi2[at])) - least:.4g}"])
    return heading("Starts") + said + aligned_table(">>>", rows)
