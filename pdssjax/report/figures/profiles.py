"""Figure of likelihood profiles: chi-square against each parameter, with its parabola and its verdict."""

from collections.abc import Mapping, Sequence

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...core import display_unit
from ...study import FittedParameter, Profile
from ._style import BLUE, GREY, STYLE, VERMILION

_COLUMNS = 3


def profile_figure(profiles: Sequence[Profile], parameters: Mapping[str, FittedParameter]) -> Figure:
    """Small multiples, one a parameter: the curve, the linear model's parabola, and the level of the 95 % interval."""
    columns = min(_COLUMNS, len(profiles))
    rows = -(-len(profiles) // columns)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(0.6 + 2.6 * columns, 0.7 + 1.9 * rows), layout="constrained")
        grid = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
        for axes, profile in zip(grid, profiles, strict=False):
            _draw(axes, profile, parameters[profile.path])
        for axes in grid[len(profiles) :]:
            axes.set_visible(False)
        for axes in grid[::columns]:
            axes.set_ylabel("excess of chi-square")
        handles, labels = grid[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4 if columns > 2 else columns)
    return figure


def _draw(axes: Axes, profile: Profile, parameter: FittedParameter) -> None:
    unit, factor = display_unit(parameter.unit)
    value = factor * profile.value
    axes.plot(value, profile.linear, color=GREY, linestyle="--", linewidth=1.0, label="linear model")
    axes.plot(value, profile.excess, color=BLUE, linewidth=1.3, label="minimised over the others")
    computed = profile.computed
    axes.plot(value[computed], profile.excess[computed], "o", color=BLUE, markersize=3.0, label="computed")
    axes.axhline(profile.threshold, color=VERMILION, linewidth=0.8, label="95 %")
    axes.axvline(factor * parameter.value, color=GREY, linewidth=0.5)
    axes.set_ylim(0.0, 1.4 * profile.threshold)
    axes.set_title(f"{profile.path}\n{profile.verdict}", loc="left")
    axes.set_xlabel(f"[{unit.replace('um', 'µm')}]" if unit else "[-]")
    axes.locator_params(axis="x", nbins=3)
