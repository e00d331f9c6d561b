"""Figures of an estimate (records against predictions, correlations, relative errors) and of cycles.

The one home of matplotlib.  Figures are made without pyplot, so that no window system
and no global state is involved.
"""

from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .characterise import Characterisation
from .display import MICROMETRES, display_unit
from .estimate import Estimate, FittedParameter, FittedRecord

# From the palette of Okabe and Ito, told apart by the colour-blind and in grey print.
_GREY, _VERMILION, _BLUE, _YELLOW = "0.5", "#D55E00", "#0072B2", "#F0E442"

STYLE: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.formatter.useoffset": False,
    "legend.frameon": False,
    "figure.dpi": 200,
}


def record_figure(record: FittedRecord) -> Figure:
    """Measured against predicted [um] over residuals; to the right, the liveliest moment enlarged."""
    moment = _liveliest_moment(record)
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
                panel.axvspan(*span, color=_YELLOW, alpha=0.45, linewidth=0, zorder=0)
        if np.isfinite(record.noise):
            _draw_noise((residual, near_residual), record)
        figure.suptitle(_caption(record), x=0.01, ha="left", fontsize=10.0)
        figure.align_ylabels((motion, residual))
    return figure


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


def error_figure(estimate: Estimate) -> Figure:
    """Standard errors in per cent of the values; of a sequential fit also the naive ones."""
    known = [p for p in estimate.parameters.values() if p.free and p.value and np.isfinite(p.standard_error)]
    rows = range(len(known))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(5.6, 1.3 + 0.28 * len(known)), layout="constrained")
        axes = figure.subplots()
        axes.plot([_percent(p, p.standard_error) for p in known], rows, "o", color=_BLUE, label="standard error")
        if any(p.naive_standard_error for p in known):
            naive = [_percent(p, p.naive_standard_error or np.nan) for p in known]
            axes.plot(naive, rows, "D", color=_VERMILION, fillstyle="none", label="naive standard error")
            axes.legend(loc="best")
        axes.set_xscale("log")
        axes.set_yticks(rows, [p.path for p in known])
        axes.invert_yaxis()
        axes.grid(axis="both", color="0.9")
        axes.set_axisbelow(True)
        axes.set_xlabel("standard error (% of the value)")
    return figure


def cycle_figure(found: Characterisation) -> Figure:
    """The record with its cycles and turning points; to the right, its cycles and its slips on top of each other."""
    scale, unit = (MICROMETRES, "µm") if found.measures == "displacement" else (1.0, "N")
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.4, 4.8), layout="constrained")
        panels = figure.subplot_mosaic("RRRCC;RRRSS")
        _draw_cycles(panels["R"], found, scale)
        for name, reach in [("C", 0.75), ("S", 0.05)]:
            _draw_overlaid(panels[name], found, scale, reach)
        panels["R"].set_ylabel(f"{found.measures} ({unit})")
        for name in "CS":
            panels[name].set_ylabel(
                f"from mid-flank ({unit})" if found.measures == "displacement" else f"force ({unit})"
            )
        panels["C"].set_title("cycles, first dark, last light", loc="left")
        dashed = ", dashed: mean of the lines" if found.measures == "displacement" else ""
        panels["S"].set_title(f"slips{dashed}", loc="left")
        panels["S"].set_xlabel("time from the slip (ms)")
        figure.suptitle(_cycle_caption(found), x=0.01, ha="left", fontsize=10.0)
    return figure


def _draw_cycles(axes: Axes, found: Characterisation, scale: float) -> None:
    """The record, as it was measured."""
    period = 1.0 / found.cycles.frequency
    slips = found.cycles.start + np.arange(found.cycles.count + 1) * period
    for index in range(0, found.cycles.count, 2):
        axes.axvspan(slips[index], slips[index + 1], color="0.93", linewidth=0, zorder=0)
    axes.plot(found.time, scale * found.values, color=_GREY, linewidth=1.0)
    size = 4.5 if len(slips) < 20 else 2.5
    for levels, side, marker, color, label in [
        (found.before, -1, "^", _BLUE, "before a slip"),
        (found.after, 1, "v", _VERMILION, "after a slip"),
    ]:
        known = np.isfinite(levels)
        # Which sample it was: the one of that value on this side of the slip, give or take the slip itself.
        since = side * (found.time - slips[known, None])
        here = (since > -0.02 * period - found.slip_duration) & (since < 0.27 * period)
        which = np.argmin(np.where(here, np.abs(found.sign * found.values - levels[known, None]), np.inf), axis=1)
        style = {"linestyle": "", "marker": marker, "markersize": size, "color": color, "label": label}
        axes.plot(found.time[which], scale * found.values[which], **style)
    axes.set_xlabel("time (s)")
    axes.set_title("complete cycles shaded in turn", loc="left")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=2, handletextpad=0.2)


def _draw_overlaid(axes: Axes, found: Characterisation, scale: float, reach: float) -> None:
    """What lies within `reach` periods of each slip, turned so that slow flanks rise."""
    cycles, turned = found.cycles, found.sign * found.values
    period = 1.0 / cycles.frequency
    shades = matplotlib.colormaps["cividis"](np.linspace(0.0, 0.9, cycles.count))
    walks = found.measures == "displacement"
    for index in range(cycles.count):
        since = found.time - cycles.start - (index + 1) * period
        near = np.abs(since) <= reach * period
        zero = np.mean(turned[(since > -0.8 * period) & (since < -0.2 * period)]) if walks else 0.0
        axes.plot(1e3 * since[near], scale * (turned[near] - zero), color=shades[index], linewidth=0.8)
    if walks:
        stroke, back = (scale * found.summary[name].mean for name in ("stroke", "back_slip"))
        ends = np.array([-reach, 0.0, 0.0, reach])
        lines = (0.5 + ends) * stroke - back * np.array([0, 0, 1, 1])
        axes.plot(1e3 * period * ends, lines, "--", color=_VERMILION, linewidth=1.2)
    axes.set_xlim(-1e3 * reach * period, 1e3 * reach * period)


def _cycle_caption(found: Characterisation) -> str:
    shown = lambda name, scale, unit: f"{scale * found.summary[name].mean:.4g} {unit}"
    if found.measures == "force":
        figures = f"output force {shown('output', 1.0, 'N')}"
    else:
        figures = ", ".join(
            [
                f"S {shown('stroke', MICROMETRES, 'µm')}",
                f"S₀ {shown('back_slip', MICROMETRES, 'µm')}",
                f"step efficiency {shown('efficiency', 100.0, '%')}",
                shown("speed", MICROMETRES, "µm/s"),
            ]
        )
    return f"{found.name}\n{found.cycles.count} cycles at {found.cycles.frequency:.5g} Hz: {figures}"


def _liveliest_moment(record: FittedRecord) -> Bool[np.ndarray, " n"]:
    """Samples around the fastest motion: a slip, or the onset of a step.

    Some 60 samples show the ring-down at the sampling rates that resolve it; much denser
    records are shown for the sixtieth part of their length.
    """
    time = record.time
    width = max(60 * np.median(np.diff(time)), (time[-1] - time[0]) / 60)
    jump = time[np.argmax(np.abs(np.diff(record.measured) / np.diff(time)))]
    return (time >= jump - 0.15 * width) & (time <= jump + 0.85 * width)


def _draw_overview(motion: Axes, residual: Axes, record: FittedRecord) -> None:
    scale, unit = _shown(record)
    motion.plot(record.time, scale * record.measured, color=_GREY, linewidth=2.4, label="measured")
    motion.plot(record.time, scale * record.predicted, color=_VERMILION, linewidth=0.9, label="predicted")
    motion.set_ylabel(f"{'force' if record.unit == 'N' else 'displacement'} ({unit})")
    motion.legend(loc="best")
    residual.plot(record.time, _residual(record), color=_BLUE, linewidth=0.6)
    residual.set_ylabel(f"residual ({unit})")
    residual.set_xlabel("time (s)")


def _draw_moment(motion: Axes, residual: Axes, record: FittedRecord, moment: np.ndarray) -> None:
    scale, _ = _shown(record)
    time = 1e3 * record.time[moment]
    motion.plot(time, scale * record.measured[moment], "o", color=_GREY, fillstyle="none", markersize=4.5)
    motion.plot(time, scale * record.predicted[moment], ".-", color=_VERMILION, linewidth=0.9, markersize=3)
    motion.set_title("the shaded moment", loc="left")
    residual.plot(time, _residual(record)[moment], ".-", color=_BLUE, linewidth=0.7, markersize=3)
    residual.set_xlabel("time (ms)")


def _draw_loops(force: Axes, residual: Axes, record: FittedRecord, motion: Float[np.ndarray, " n"]) -> None:
    """Friction force against the motion: what tells one law from another."""
    place = MICROMETRES * motion
    force.plot(place, record.measured, color=_GREY, linewidth=2.0)
    force.plot(place, record.predicted, color=_VERMILION, linewidth=0.8)
    force.set_title("against the motion", loc="left")
    residual.plot(place, _residual(record), color=_BLUE, linewidth=0.5)
    residual.set_xlabel("motion (µm)")


def _draw_noise(panels: Sequence[Axes], record: FittedRecord) -> None:
    scale, unit = _shown(record)
    band = 2.0 * scale * record.noise
    for panel in panels:
        panel.axhspan(-band, band, color="0.9", linewidth=0, zorder=-1)
    panels[0].set_ylabel(f"residual ({unit}),\n± 2 noise in grey")


def _shown(record: FittedRecord) -> tuple[float, str]:
    """The factor from SI to the unit shown, and its name."""
    unit, scale = display_unit(record.unit)
    return scale, unit.replace("um", "µm")


def _residual(record: FittedRecord) -> Float[np.ndarray, " n"]:
    return _shown(record)[0] * (record.measured - record.predicted)


def _caption(record: FittedRecord) -> str:
    scale, unit = _shown(record)
    quality = f"r² {record.r2:.7g}, error index {scale * record.error_index:.3g} {unit}"
    if np.isfinite(record.reduced_chi2):
        quality += f", chi-square per sample {record.reduced_chi2:.3g}"
    role = "fitted" if record.role == "fit" else "not fitted"
    return f"{record.name}\n{record.measures}, {role}, {quality if record.simulated else 'the simulation failed'}"


def _ink(correlation: float) -> str:
    return "white" if abs(correlation) > 0.6 else "black"


def _percent(parameter: FittedParameter, error: float) -> float:
    return 100.0 * error / abs(parameter.value)
