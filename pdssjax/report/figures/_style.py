"""Colours, style and axes of every figure; the palette of Okabe and Ito.

Figures are made without pyplot, so that no window system and no global state is involved.
"""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, NullLocator, StrMethodFormatter

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


@contextlib.contextmanager
def styled_figure(width: float, height: float, *, fitted: bool = True) -> Iterator[Figure]:
    """A figure of that size [inch], drawn in the style of all; matplotlib places its panels, unless not `fitted`."""
    with matplotlib.rc_context(STYLE):
        yield Figure(figsize=(width, height), layout="constrained" if fitted else None)


def save_figure(figure: Figure, file: Path) -> None:
    """Write a `figure` to a PNG `file`, laid out and drawn once: `savefig` draws what it lays out twice."""
    canvas, layout = FigureCanvasAgg(figure), figure.get_layout_engine()
    if layout is not None:
        layout.execute(figure)
        figure.set_layout_engine("none")
    # Level 3 takes two thirds of the time of the usual 6, for a tenth more bytes.
    canvas.print_png(file, pil_kwargs={"compress_level": 3})


def fixed_ticks(most: int, *panels: Axes) -> None:
    """Limit the number of tick intervals on y to `most`, whatever the height of the `panels`.

    The layout leaves room for the labels of the ticks before it has settled the height: were there others then, with a
    digit more, the axis's own label would be cut off.
    """
    for panel in panels:
        panel.locator_params(axis="y", nbins=most)


_DECADE, _MANY = 10.0, 100.0
"""Ratios of the ends of a logarithmic axis: below the first its ticks are equidistant, up to the second they are at
1, 2 and 5 of each decade, above it at each decade."""


def in_equal_ratios(places: Float[np.ndarray, " values"]) -> bool:
    """Whether the points of an axis have equal ratios, as `FROM:TO:COUNT:log` makes them."""
    if places.size < 3 or places.min() <= 0:
        return False
    ratios = places[1:] / places[:-1]
    return bool(np.ptp(ratios) < 1e-6 * ratios[0] and np.ptp(np.diff(places)) > 1e-6 * np.ptp(places))


def scale_axes(axes: Axes, **places: Float[np.ndarray, " values"]) -> None:
    """Make the axes `x` and `y` logarithmic if their points have equal ratios."""
    for name, values in places.items():
        if in_equal_ratios(values):
            ratio = values.max() / values.min()
            wide, subs = ratio >= _DECADE, (1.0, 2.0, 5.0) if ratio <= _MANY else (1.0,)
            axes.set(**{f"{name}scale": "log"})
            axis = axes.xaxis if name == "x" else axes.yaxis
            axis.set_major_locator(LogLocator(subs=subs) if wide else MaxNLocator(6, steps=[1, 2, 5, 10]))
            if not wide:
                axis.set_minor_locator(NullLocator())
            axis.set_major_formatter(StrMethodFormatter("{x:g}"))
            axis.set_minor_formatter(NullFormatter())
