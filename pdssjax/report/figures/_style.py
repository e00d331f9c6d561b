"""Colours and style of every figure; the palette of Okabe and Ito."""

from typing import Any

from matplotlib.axes import Axes

# From the palette of Okabe and Ito, distinct also with a colour vision deficiency and in grey print.
GREY, VERMILION, BLUE, YELLOW, GREEN = "0.5", "#D55E00", "#0072B2", "#F0E442", "#009E73"

STYLE: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.formatter.useoffset": False,
    "legend.frameon": False,
    "figure.dpi": 200,
}


def fixed_ticks(most: int, *panels: Axes) -> None:
    """At most so many intervals of ticks on y, whatever the height of the `panels`.

    The layout leaves room for the labels of the ticks before it has settled the height: were there others then, with a
    digit more, the axis's own label would be cut off.
    """
    for panel in panels:
        panel.locator_params(axis="y", nbins=most)
