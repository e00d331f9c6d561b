"""Draws docs/figures/start.png: the actuator, a slip of the packaged example with its prediction, the errors.

Run by hand, `python docs/start_picture.py`, when the example's estimate has changed.
"""

from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

import pdssjax
from pdssjax.core import prepare_jax
from pdssjax.files import EXAMPLE

BLUE, VERMILION, GREY = "#0072B2", "#D55E00", "0.5"


def rig(axes: Axes) -> None:
    """The stack, the platform on it, the end-effector held by friction, and the voltage."""
    axes.add_patch(Rectangle((0.0, 0.9), 0.25, 1.3, color="0.35"))
    for i in range(8):
        axes.add_patch(Rectangle((0.25 + 0.3 * i, 1.25), 0.27, 0.6, color=BLUE, alpha=0.4 + 0.3 * (i % 2), linewidth=0))
    axes.add_patch(Rectangle((2.68, 1.1), 2.6, 0.9, facecolor="0.85", edgecolor="0.3"))
    axes.add_patch(Rectangle((3.3, 2.03), 1.1, 0.6, facecolor=VERMILION, alpha=0.75, edgecolor="0.3"))
    axes.plot(np.linspace(3.3, 4.4, 40), 2.015 + 0.03 * (np.arange(40) % 2), color="black", linewidth=0.8)
    for x, y, text in [
        (1.4, 0.95, "piezo stack"),
        (3.98, 1.48, "platform"),
        (3.85, 2.8, "end-effector, held by friction"),
    ]:
        axes.text(x, y, text, ha="center", va="center" if y == 1.48 else "bottom", fontsize=8.5)
    time = np.linspace(0, 3, 301)
    axes.plot(0.4 + 1.5 * time, 0.05 + 0.6 * (time % 1), color="black", linewidth=1.1)
    axes.text(5.05, 0.3, "voltage", fontsize=8.5)
    axes.annotate("", (4.95, 2.33), (4.45, 2.33), arrowprops={"arrowstyle": "->", "color": VERMILION, "linewidth": 1.6})
    axes.set_xlim(-0.1, 6.0)
    axes.set_ylim(-0.1, 3.3)
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.set_title("the actuator", loc="left")


def slip(axes: Axes, estimate: pdssjax.Estimate) -> None:
    """One slip of the record that goes backward."""
    record = next(r for r in estimate.records if r.name == "5 Hz B")
    near = (record.time > 1.19) & (record.time < 1.215)
    time = 1e3 * (record.time[near] - 1.2)
    axes.plot(time, 1e6 * record.measured[near], "o", color=GREY, fillstyle="none", markersize=5, label="measured")
    axes.plot(time, 1e6 * record.predicted[near], "-", color=VERMILION, linewidth=1.3, label="predicted")
    axes.set_xlabel("time from the slip (ms)")
    axes.set_ylabel("end-effector (µm)")
    axes.legend(loc="lower right")
    axes.set_title("a slip, measured and predicted", loc="left")


def errors(axes: Axes, estimate: pdssjax.Estimate) -> None:
    """Every parameter with its standard error."""
    found = [estimate.parameters[path] for path in estimate.names]
    shares = [100.0 * p.standard_error / p.value for p in found]
    axes.barh([p.path for p in found], shares, color=BLUE, height=0.6)
    for row, share in enumerate(shares):
        axes.text(1.15 * share, row, f"{share:.2g} %", va="center", fontsize=8)
    axes.set_xscale("log")
    axes.set_xlim(3e-3, 60)
    axes.invert_yaxis()
    axes.set_xlabel("standard error (% of the value)")
    axes.set_title("all parameters, with errors", loc="left")


def picture(estimate: pdssjax.Estimate) -> Figure:
    """The three side by side."""
    style = {"font.size": 9, "axes.titlesize": 10, "axes.spines.top": False, "axes.spines.right": False}
    with matplotlib.rc_context({**style, "legend.frameon": False}):
        figure = Figure(figsize=(11.0, 3.1), layout="constrained", dpi=160)
        left, middle, right = figure.subplots(1, 3, width_ratios=(1.15, 1.0, 1.0))
        rig(left)
        slip(middle, estimate)
        errors(right, estimate)
    return figure


if __name__ == "__main__":
    prepare_jax(dedicated=True)
    target = Path(__file__).parent / "figures" / "start.png"
    target.parent.mkdir(exist_ok=True)
    picture(pdssjax.identify(pdssjax.load_study(EXAMPLE / "study.toml"))).savefig(target)
