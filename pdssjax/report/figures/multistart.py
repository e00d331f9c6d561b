"""Figure of fits from many starts: the sorted chi-squares, and the parameters at the optima."""

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ...study import Multistart
from ._style import BLUE, GREY, STYLE, VERMILION

_OTHERS = VERMILION, "#009E73", "#CC79A7", "#56B4E9", "#E69F00"
"""Of the optima after the best, in turn; from the palette of Okabe and Ito."""

_FLOOR = 1e-3
"""Excess of chi-square shown for all that are lower."""

_SHOWN = 12
"""Optima whose parameters are drawn, the best first."""


def multistart_figure(multistart: Multistart) -> Figure:
    """The waterfall above; below, every parameter over that of the best optimum."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(6.4, 3.4 + 0.26 * len(multistart.names)), layout="constrained")
        heights = [2.0, 0.6 + 0.26 * len(multistart.names)]
        above, below = figure.subplots(2, 1, gridspec_kw={"height_ratios": heights})
        _waterfall(above, multistart)
        _parameters(below, multistart)
    return figure


def _colour(number: int) -> str:
    return GREY if number < 0 else BLUE if number == 0 else _OTHERS[(number - 1) % len(_OTHERS)]


def _waterfall(axes: Axes, multistart: Multistart) -> None:
    known = np.isfinite(multistart.chi2)
    rank, least = np.arange(1, multistart.chi2.size + 1), float(np.min(multistart.chi2))
    excess = np.maximum(multistart.chi2 - least, _FLOOR)
    axes.plot(rank[known], excess[known], color="0.85", linewidth=0.8, zorder=0)
    for number in range(-1, multistart.distinct):
        at = known & (multistart.optimum == number)
        name = "not converged" if number < 0 else f"optimum {number + 1}" if number < len(_OTHERS) else None
        marker = "x" if number < 0 else "o"
        if at.any():
            axes.plot(rank[at], excess[at], marker, color=_colour(number), markersize=4.0, label=name)
    axes.set_yscale("log")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlim(0.0, multistart.chi2.size + 1.0)
    axes.set_ylabel("chi-square above the lowest")
    failed = int(np.sum(~known))
    axes.set_xlabel("start, sorted" + (f" ({failed} could not be simulated)" if failed else ""))
    axes.legend(loc="upper left")


def _parameters(axes: Axes, multistart: Multistart) -> None:
    """Relative to the best optimum, on a scale that is linear within one per cent."""
    rows = np.arange(len(multistart.names))
    firsts = [int(np.flatnonzero(multistart.optimum == n)[0]) for n in range(min(multistart.distinct, _SHOWN))]
    best = multistart.ends[firsts[0] if firsts else 0]
    scale = np.where(best == 0.0, 1.0, np.abs(best))
    spread = [multistart.ranges.get(path, (np.nan, np.nan)) for path in multistart.names]
    low, high = (100.0 * (np.array(ends) - best) / scale for ends in zip(*spread, strict=True))
    axes.hlines(rows, low, high, color="0.85", linewidth=5.0, label="range of the starts")
    for first in reversed(firsts):
        number = int(multistart.optimum[first])
        change = 100.0 * (multistart.ends[first] - best) / scale
        axes.plot(change, rows, "o-", color=_colour(number), markersize=3.5, linewidth=0.8)
    axes.set_xscale("symlog", linthresh=1.0)
    axes.set_yticks(rows, multistart.names)
    axes.invert_yaxis()
    axes.grid(axis="x", color="0.9")
    axes.set_axisbelow(True)
    axes.set_xlabel("from the best optimum (% of its value)")
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0))
