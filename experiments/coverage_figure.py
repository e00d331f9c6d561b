"""How often intervals hold what they should: the picture that several experiments share."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure


def draw_coverage(
    shares: Mapping[str, Float[np.ndarray, " p"]],
    colours: Sequence[str],
    paths: Sequence[str],
    count: int,
    title: str,
    label: str,
) -> Figure:
    """Shares of intervals [%] by name of what made them, of each of the parameters at `paths`, out of `count` draws.

    Whiskers are the 95 % uncertainty of a share; the band is what 95 % intervals should come to.
    """
    figure = Figure(figsize=(7.4, 3.5), layout="constrained")
    axes = figure.subplots()
    axes.axhspan(93.0, 97.0, color="0.88", linewidth=0)
    for place, ((name, heights), colour) in enumerate(zip(shares.items(), colours, strict=True)):
        error = 1.96 * np.sqrt(np.maximum(heights * (100.0 - heights), 25.0) / count)
        places = np.arange(heights.size) + 0.2 * (place - 1)
        axes.errorbar(places, heights, error, fmt="o", color=colour, markersize=4, label=name)
    axes.set_xticks(range(len(paths)), [path.split(".")[1] for path in paths], rotation=20)
    axes.set_ylabel(label)
    axes.set_title(title, loc="left")
    figure.legend(loc="outside lower center", ncols=3)
    return figure
