"""Figure of a simulated run: voltage, motion, friction."""

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from ...core import MICROMETRES, InputError
from ...simulation import Trajectory
from ._style import BLUE, GREY, STYLE, VERMILION, fixed_ticks


def trajectory_figure(run: Trajectory) -> Figure:
    """The voltage over the motion over the friction force, against time.

    **Raises:** `InputError` for several runs side by side (of `vmap`).
    """
    if np.ndim(run.time) != 1:
        raise InputError(f"plot: found runs of shape {np.shape(run.effector)}, expected a single one.")
    time = np.asarray(run.time)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.4, 4.8), layout="constrained")
        voltage, motion, friction = figure.subplots(3, 1, sharex=True, height_ratios=(1, 2.4, 1.2))
        voltage.plot(time, run.voltage, color="black", linewidth=0.9)
        voltage.set_ylabel("voltage (V)")
        motion.plot(time, MICROMETRES * np.asarray(run.platform), color=GREY, linewidth=1.2, label="platform")
        motion.plot(time, MICROMETRES * np.asarray(run.effector), color=VERMILION, linewidth=1.2, label="end-effector")
        motion.set_ylabel("displacement (µm)")
        motion.legend(loc="best")
        friction.plot(time, run.friction, color=BLUE, linewidth=0.8)
        friction.axhline(0.0, color="0.8", linewidth=0.6, zorder=0)
        friction.set_ylabel("friction (N)")
        friction.set_xlabel("time (s)")
        fixed_ticks(3, voltage)
        fixed_ticks(8, motion)
        fixed_ticks(4, friction)
        figure.align_ylabels()
        if run.message:
            figure.suptitle(run.message, x=0.01, ha="left", fontsize=9.0, wrap=True)
    return figure
