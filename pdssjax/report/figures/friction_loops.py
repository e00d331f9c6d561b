"""Figure of a force against the motion that was prescribed: loops, or a friction curve."""

import matplotlib
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from ...core import LENGTH, VELOCITY
from ._style import BLUE, STYLE, fixed_ticks


def friction_figure(
    name: str, motion: Float[np.ndarray, " n"], force: Float[np.ndarray, " n"], quantity: str
) -> Figure:
    """The `force` [N] against the `motion`, a "displacement" [m] or a "velocity" [m/s]."""
    shown = VELOCITY if quantity == "velocity" else LENGTH
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(5.0, 3.6), layout="constrained")
        axes = figure.subplots()
        if quantity == "velocity":
            axes.plot(shown.scale * motion, force, ".", color=BLUE, markersize=3)
        else:
            axes.plot(shown.scale * motion, force, color=BLUE, linewidth=0.8)
        axes.set_xlabel(f"{quantity} ({shown.unit.replace('um', 'µm')})")
        axes.set_ylabel("force (N), with the sign of the motion")
        axes.set_title(name, loc="left")
        fixed_ticks(5, axes)
    return figure
