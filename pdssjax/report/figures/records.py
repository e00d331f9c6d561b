"""Figure of a record against its prediction.

Figures are made without pyplot, so that no window system and no global state is involved.
"""

from collections.abc import Sequence

import matplotlib
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...core import VELOCITY
from ...study import FittedRecord
from ._style import BLUE, GREY, STYLE, VERMILION, YELLOW, fixed_ticks


def record_figure(record: FittedRecord) -> Figure:
    """Measured against predicted over residuals; to the right, the liveliest moment enlarged."""
    moment = liveliest_moment(record.time, record.measured)
    span = record.time[moment][[0, -1]]
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.4, 4.6), layout="constrained")
        ((motion, near), (residual, near_residual)) = figure.subplots(
            2, 2, sharex="col", height_ratios=(2, 1), width_ratios=(3, 2)
        )
        _draw_overview(motion, residual, record)
        if record.motion is not None:
            _draw_loops(near, near_residual, record, record.motion)
        else:
            _draw_moment(near, near_residual, record, moment)
            for panel in (motion, residual):
                panel.axvspan(*span, color=YELLOW, alpha=0.45, linewidth=0, zorder=0)
        if np.isfinite(record.noise):
            _draw_noise((residual, near_residual), record)
        fixed_ticks(6, motion, near)
        fixed_ticks(4, residual, near_residual)
        figure.suptitle(_caption(record), x=0.01, ha="left", fontsize=10.0, wrap=True)
        figure.align_ylabels((motion, residual))
    return figure


def liveliest_moment(time: Float[np.ndarray, " n"], measured: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Samples around the fastest motion: a slip, or the onset of a step.

    Some 60 samples show the ring-down at the sampling rates that resolve it; much denser
    records are shown for the sixtieth part of their length.
    """
    width = max(60 * np.median(np.diff(time)), (time[-1] - time[0]) / 60)
    jump = time[np.argmax(np.abs(np.diff(measured) / np.diff(time)))]
    return (time >= jump - 0.15 * width) & (time <= jump + 0.85 * width)


def _draw_overview(motion: Axes, residual: Axes, record: FittedRecord) -> None:
    scale, unit = _shown(record)
    motion.plot(record.time, scale * record.measured, color=GREY, linewidth=2.4, label="measured")
    motion.plot(record.time, scale * record.predicted, color=VERMILION, linewidth=0.9, label="predicted")
    motion.set_ylabel(f"{record.display.quantity} ({unit})")
    motion.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, borderaxespad=0.0)
    residual.plot(record.time, _residual(record), color=BLUE, linewidth=0.6)
    residual.set_ylabel(f"residual ({unit})")
    residual.set_xlabel("time (s)")


def _draw_moment(motion: Axes, residual: Axes, record: FittedRecord, moment: np.ndarray) -> None:
    scale, _ = _shown(record)
    time = 1e3 * record.time[moment]
    motion.plot(time, scale * record.measured[moment], "o", color=GREY, fillstyle="none", markersize=4.5)
    motion.plot(time, scale * record.predicted[moment], ".-", color=VERMILION, linewidth=0.9, markersize=3)
    motion.set_title("the shaded moment", loc="left")
    residual.plot(time, _residual(record)[moment], ".-", color=BLUE, linewidth=0.7, markersize=3)
    residual.set_xlabel("time (ms)")


def _draw_loops(force: Axes, residual: Axes, record: FittedRecord, motion: Float[np.ndarray, " n"]) -> None:
    """Friction force against the motion: what tells one law from another."""
    # Loops come in order; the samples of a friction curve need not, and are put into it.
    order = np.argsort(motion) if record.prescribed == VELOCITY else np.arange(motion.size)
    place = record.prescribed.scale * motion[order]
    force.plot(place, record.measured[order], color=GREY, linewidth=2.0)
    force.plot(place, record.predicted[order], color=VERMILION, linewidth=0.8)
    force.set_title(f"against the {record.prescribed.quantity}", loc="left")
    residual.plot(place, _residual(record)[order], color=BLUE, linewidth=0.5)
    residual.set_xlabel(f"{record.prescribed.quantity} ({record.prescribed.unit.replace('um', 'µm')})")


def _draw_noise(panels: Sequence[Axes], record: FittedRecord) -> None:
    scale, unit = _shown(record)
    band = 2.0 * scale * record.noise
    for panel in panels:
        panel.axhspan(-band, band, color="0.9", linewidth=0, zorder=-1)
    panels[0].set_ylabel(f"residual ({unit}),\n± 2 noise in grey")


def _shown(record: FittedRecord) -> tuple[float, str]:
    """The factor from SI to the unit shown, and its name."""
    return record.display.scale, record.display.unit.replace("um", "µm")


def _residual(record: FittedRecord) -> Float[np.ndarray, " n"]:
    return _shown(record)[0] * (record.measured - record.predicted)


def _caption(record: FittedRecord) -> str:
    scale, unit = _shown(record)
    quality = f"r² {record.r2:.7g}, error index {scale * record.error_index:.3g} {unit}"
    if np.isfinite(record.reduced_chi2):
        quality += f", chi-square per sample {record.reduced_chi2:.3g}"
    role = "fitted" if record.role == "fit" else "not fitted"
    return f"{record.name}\n{record.measures}, {role}, {quality if record.simulated else 'the simulation failed'}"
