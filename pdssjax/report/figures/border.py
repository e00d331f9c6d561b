"""The border that a sweep looked for: where a metric passes a level."""

from typing import TYPE_CHECKING

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ._axis_scale import in_equal_ratios, scale_axes
from ._style import STYLE
from .sweep import drawn_over, held_fixed, shown

if TYPE_CHECKING:
    import xarray

_LINES = 7
"""Of a second axis so many values are drawn, the first and the last among them."""


def border_figure(data: "xarray.Dataset") -> Figure:
    """The border of a `find_border` over the first axis of its grid, a line for each value of the second.

    Further axes are held at their middle, as the title says.  Where there is no border the line has a gap.
    """
    every = [str(name) for name in data.border.dims]
    names = drawn_over(data, every)
    middle = {name: (data.sizes[name] - 1) // 2 for name in every if name not in names}
    cut = data.isel(middle)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(5.2, 3.6), layout="constrained")
        axes = figure.subplots()
        _draw(axes, cut, names)
        told = [data.attrs["title"], f"drive of {data.attrs['record']}", data.attrs["of"], *held_fixed(data, middle)]
        figure.suptitle(", ".join(told), x=0.01, ha="left", fontsize=9.5, wrap=True)
    return figure


def _draw(axes: Axes, data: "xarray.Dataset", names: list[str]) -> None:
    border, label = shown(data.border)
    axes.set_ylabel(label)
    if not names:
        axes.axhline(float(border), color="#0072B2")
        return
    places, place = shown(data[names[0]])
    if len(names) == 1:
        axes.plot(places, border, ".-", color="#0072B2", markersize=4)
    else:
        values, what = shown(data[names[1]])
        rows = np.unique(np.linspace(0, len(values) - 1, _LINES).round().astype(int))
        for i, row in enumerate(rows):
            colour = matplotlib.colormaps["viridis"](i / max(len(rows) - 1, 1) * 0.9)
            label = _named(names[1], float(values[row]))
            axes.plot(places, border[:, row], ".-", color=colour, markersize=4, label=label)
        axes.legend(title=what)
    if in_equal_ratios(places):
        scale_axes(axes, x=places)
    elif len(places) > 1:
        # Where there is no border the axis goes on.
        margin = 0.05 * np.ptp(places)
        axes.set_xlim(places.min() - margin, places.max() + margin)
    axes.set_xlabel(place)


def _named(dimension: str, value: float) -> str:
    """A value of the second axis."""
    if dimension == "drive_direction":
        return "forward" if value > 0 else "backward"
    return f"{value:.4g}"
