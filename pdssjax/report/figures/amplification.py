"""Figure of what an error of the stack does to the parameters identified after it."""

import matplotlib
import numpy as np
from matplotlib.colors import SymLogNorm
from matplotlib.figure import Figure

from ...study import UNSEEN, Amplification
from ._style import STYLE


def amplification_figure(amplification: Amplification) -> Figure:
    """The matrix as colours and numbers: per cent in the row for 1 % in the column."""
    amplification = amplification.visible()
    matrix = amplification.matrix
    rows, columns = matrix.shape
    most = max(2.0, float(np.max(np.abs(matrix))))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(3.4 + 0.9 * columns, 1.7 + 0.36 * rows), layout="constrained")
        axes = figure.subplots()
        # Linear up to one per cent for one per cent: there an error is passed on, beyond it grows.
        scale = SymLogNorm(1.0, vmin=-most, vmax=most)
        image = axes.imshow(matrix, norm=scale, cmap="RdBu_r", aspect="auto")
        axes.set_xticks(range(columns), amplification.earlier, rotation=25, ha="right", rotation_mode="anchor")
        axes.set_yticks(range(rows), amplification.later)
        for i in range(rows):
            for j in range(columns):
                dark = abs(float(scale(matrix[i, j])) - 0.5) > 0.3
                # 110, not 1.1e+02; 0, not -0.
                label = f"{float(f'{matrix[i, j]:.2g}') if abs(matrix[i, j]) >= UNSEEN else 0.0:g}"
                axes.text(j, i, label, ha="center", va="center", fontsize=7.5, color="white" if dark else "black")
        axes.set_title("Per cent in the row for 1 % in the column", loc="left")
        figure.colorbar(image, ax=axes, label="% for 1 %", shrink=0.9)
    return figure
