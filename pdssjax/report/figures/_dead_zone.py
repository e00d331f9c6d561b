"""The border of the dead zone on a map of a sweep, and the words for it in the legend."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke

_WIDTH = 1.2

BARE = "0.85"
"""Colour of a cell of a map that has no value to show."""


def has_border(dead: Float[np.ndarray, "rows columns"]) -> bool:
    """Whether `dead`, below zero in the dead zone, changes its sign on a map."""
    return min(dead.shape) > 1 and bool(np.nanmin(dead, initial=np.inf) < 0 < np.nanmax(dead, initial=-np.inf))


def draw_border(
    axes: Axes,
    x: Float[np.ndarray, " columns"],
    y: Float[np.ndarray, " rows"],
    dead: Float[np.ndarray, "rows columns"],
    colour: str,
) -> None:
    """The border, where there is one."""
    if has_border(dead):
        axes.contour(x, y, dead, levels=[0.0], colors=colour, linewidths=_WIDTH).set(path_effects=_edged(colour))


def border_key(colour: str, says: str) -> Artist:
    """The border's entry in a legend."""
    return Line2D([], [], color=colour, linewidth=_WIDTH, path_effects=_edged(colour), label=says)


def bare_key(says: str) -> Artist:
    """The entry of cells without a value."""
    return Patch(facecolor=BARE, label=says)


def explain(figure: Figure, keys: Sequence[Artist]) -> None:
    """Puts a legend with the `keys` below all panels."""
    if keys:
        figure.legend(handles=list(keys), loc="outside lower center", ncols=len(keys))


def _edged(colour: str) -> list[withStroke]:
    """White shows on neither a bright map nor on paper: it gets an edge."""
    return [withStroke(linewidth=_WIDTH + 1.2, foreground="0.2")] if colour == "w" else []
