"""Figure of ways of identification side by side: every parameter's estimates and intervals."""

from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...inference import half_width_95
from ...study import Estimate, FittedParameter
from ._style import BLUE, GREEN, STYLE, VERMILION

_COLUMNS = 3
"""Panels side by side."""

_COLOURS = (BLUE, GREEN, VERMILION)
"""Of the ways, in their order."""


def comparison_figure(estimates: Sequence[Estimate]) -> Figure:
    """One panel a free parameter: each way's estimate and 95 % interval, in per cent off the joint fit's value.

    The first of the `estimates` is the joint fit.  Thick: the interval with the errors of the earlier step; thin, with
    ends: that which takes them for exact.
    """
    first = estimates[0].parameters
    shown = [path for path in estimates[0].names if first[path].value and np.isfinite(first[path].standard_error)]
    rows = -(-len(shown) // _COLUMNS)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.4, 0.9 + 1.15 * max(rows, 1)), layout="constrained")
        panels = figure.subplots(max(rows, 1), _COLUMNS, squeeze=False, sharey=True).ravel()
        for axes, path in zip(panels, shown, strict=False):
            _draw(axes, path, estimates)
        for axes in panels[len(shown) :]:
            axes.set_axis_off()
        for axes in panels[len(shown) - min(_COLUMNS, len(shown)) : len(shown)]:
            axes.set_xlabel("off the joint fit (%)")
        figure.suptitle(
            f"{estimates[0].title}\n95 % intervals: thick with the earlier step's errors, thin without (naive)",
            x=0.01,
            ha="left",
            fontsize=9.5,
            wrap=True,
        )
    return figure


def _naive_interval(found: FittedParameter) -> tuple[float, float]:
    """The 95 % interval by the naive error, on the scale of the fit that the interval by the whole error is on."""
    naive, (low, high) = found.naive_standard_error or 0.0, found.interval
    whole = found.errors["white"].interval if "white" in found.errors else (low, high)
    naive *= float(half_width_95(found.degrees_of_freedom))
    logarithmic = found.value > 0.0 and min(whole) > 0.0 and np.isclose(whole[0] * whole[1], found.value**2, rtol=1e-6)
    if logarithmic:
        factor = float(np.exp(naive / found.value))
        return found.value / factor, found.value * factor
    return found.value - naive, found.value + naive


def _draw(axes: Axes, path: str, estimates: Sequence[Estimate]) -> None:
    joint = estimates[0].parameters[path].value
    for place, (estimate, colour) in enumerate(zip(estimates, _COLOURS, strict=False)):
        found = estimate.parameters[path]
        off = 100.0 * (found.value / joint - 1.0)
        low, high = (100.0 * (end / joint - 1.0) for end in found.interval)
        axes.plot([low, high], [place, place], color=colour, alpha=0.35, linewidth=5.0, solid_capstyle="butt")
        if found.naive_standard_error is not None:
            ends = [100.0 * (end / joint - 1.0) for end in _naive_interval(found)]
            reach = np.abs(np.array(ends) - off)[:, None]
            axes.errorbar(off, place, xerr=reach, color=colour, linewidth=1.0, capsize=2.5)
        axes.plot(off, place, "o", color=colour, markersize=4.0)
    axes.axvline(0.0, color="0.6", linewidth=0.7, zorder=0)
    axes.set_yticks(range(len(estimates)), [estimate.method for estimate in estimates])
    axes.set_ylim(len(estimates) - 0.4, -0.6)
    axes.set_title(path, loc="left")
