"""Figure of an estimate's correlations."""

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from ...study import Estimate
from ._style import STYLE


def correlation_figure(estimate: Estimate) -> Figure:
    """The lower triangle of the correlation matrix; crosses where there is no information."""
    names, count = estimate.names, len(estimate.names)
    shown = np.where(np.tri(count, k=-1, dtype=bool), estimate.correlation, np.nan)[1:, :-1]
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(2.6 + 0.5 * count, 1.6 + 0.45 * count), layout="constrained")
        axes = figure.subplots()
        image = axes.imshow(shown, vmin=-1.0, vmax=1.0, cmap="RdBu_r", aspect="auto")
        axes.set_xticks(range(count - 1), names[:-1], rotation=40, ha="right", rotation_mode="anchor")
        axes.set_yticks(range(count - 1), names[1:])
        for row in range(count - 1):
            for column in range(row + 1):
                value = shown[row, column]
                label = f"{value:.2f}" if np.isfinite(value) else "×"
                axes.text(column, row, label, ha="center", va="center", fontsize=7.5, color=_ink(value))
        blank = "" if np.isfinite(estimate.correlation).all() else " (×: no information)"
        axes.set_title(f"Correlations of the estimates{blank}", loc="left")
        figure.colorbar(image, ax=axes, label="correlation", shrink=0.8)
    return figure


def _ink(correlation: float) -> str:
    return "white" if abs(correlation) > 0.6 else "black"
