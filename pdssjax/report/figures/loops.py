"""Figure of a platform against its voltage: the loops of hysteresis, and what a model leaves of them."""

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from ...study import FittedRecord
from ._style import BLUE, GREY, STYLE, VERMILION, fixed_ticks

FEWEST = 20
"""Levels of the voltage from which on a loop is worth a figure: a step has two."""


def has_loops(record: FittedRecord) -> bool:
    """The platform alone was measured while its voltage ran up or down."""
    return record.voltage is not None and np.unique(np.round(record.voltage, 9)).size >= FEWEST


def loop_figure(record: FittedRecord) -> Figure:
    """Displacement against voltage over the residual against voltage.

    **Arguments:** a `record` that `has_loops`.
    """
    if record.voltage is None:
        raise ValueError("Expected a record with a voltage, but it has none.")
    scale, unit = record.display.scale, record.display.unit.replace("um", "µm")
    residual = scale * (record.measured - record.predicted)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(5.6, 5.6), layout="constrained")
        motion, left = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
        motion.plot(record.voltage, scale * record.measured, color=GREY, linewidth=2.4, label="measured")
        motion.plot(record.voltage, scale * record.predicted, color=VERMILION, linewidth=0.8, label="predicted")
        motion.set_ylabel(f"{record.display.quantity} ({unit})")
        motion.legend(loc="best")
        left.plot(record.voltage, residual, ".", color=BLUE, markersize=2.0, alpha=0.35, markeredgewidth=0)
        left.axhline(0.0, color="0.6", linewidth=0.7, zorder=0)
        left.set_ylabel(f"residual ({unit})")
        left.set_xlabel("voltage (V)")
        figures = f"rms {scale * record.rmse:.3g} {unit}, largest {scale * record.largest_error:.3g} {unit}"
        figure.suptitle(f"{record.name}\nagainst the voltage: {figures}", x=0.01, ha="left", fontsize=10.0, wrap=True)
        fixed_ticks(8, motion)
        fixed_ticks(4, left)
        figure.align_ylabels((motion, left))
    return figure
