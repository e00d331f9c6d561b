"""Figure of a record's cycles, slips and turning points."""

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...core import MICROMETRES
from ...metrics import Characterisation
from ._style import BLUE, GREY, STYLE, VERMILION


def cycle_figure(found: Characterisation) -> Figure:
    """The record with its cycles and turning points; to the right, its cycles and its slips on top of each other."""
    scale, unit = (MICROMETRES, "µm") if found.measures == "displacement" else (1.0, "N")
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.4, 4.8), layout="constrained")
        panels = figure.subplot_mosaic("RRRCC;RRRSS")
        _draw_cycles(panels["R"], found, scale)
        for name, periods in [("C", 0.75), ("S", 0.05)]:
            _draw_overlaid(panels[name], found, scale, periods)
        panels["R"].set_ylabel(f"{found.measures} ({unit})")
        for name in "CS":
            panels[name].set_ylabel(
                f"from mid-flank ({unit})" if found.measures == "displacement" else f"force ({unit})"
            )
        panels["C"].set_title("cycles, first dark, last light", loc="left")
        dashed = ", dashed: mean of the lines" if found.measures == "displacement" else ""
        panels["S"].set_title(f"slips{dashed}", loc="left")
        panels["S"].set_xlabel("time from the slip (ms)")
        figure.suptitle(_cycle_caption(found), x=0.01, ha="left", fontsize=10.0, wrap=True)
    return figure


def _draw_cycles(axes: Axes, found: Characterisation, scale: float) -> None:
    """The record, as it was measured."""
    period = 1.0 / found.cycles.frequency
    slips = found.cycles.start + np.arange(found.cycles.count + 1) * period
    for index in range(0, found.cycles.count, 2):
        axes.axvspan(slips[index], slips[index + 1], color="0.93", linewidth=0, zorder=0)
    axes.plot(found.time, scale * found.values, color=GREY, linewidth=1.0)
    size = 4.5 if len(slips) < 20 else 2.5
    for levels, side, marker, color, label in [
        (found.before, -1, "^", BLUE, "before a slip"),
        (found.after, 1, "v", VERMILION, "after a slip"),
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


def _draw_overlaid(axes: Axes, found: Characterisation, scale: float, periods: float) -> None:
    """What lies within `periods` periods of each slip, signed so that slow flanks rise."""
    cycles, signed = found.cycles, found.sign * found.values
    period = 1.0 / cycles.frequency
    shades = matplotlib.colormaps["cividis"](np.linspace(0.0, 0.9, cycles.count))
    moves = found.measures == "displacement"
    for index in range(cycles.count):
        since = found.time - cycles.start - (index + 1) * period
        near = np.abs(since) <= periods * period
        zero = np.mean(signed[(since > -0.8 * period) & (since < -0.2 * period)]) if moves else 0.0
        axes.plot(1e3 * since[near], scale * (signed[near] - zero), color=shades[index], linewidth=0.8)
    if moves:
        stroke, back = (scale * found.summary[name].mean for name in ("stroke", "back_slip"))
        ends = np.array([-periods, 0.0, 0.0, periods])
        lines = (0.5 + ends) * stroke - back * np.array([0, 0, 1, 1])
        axes.plot(1e3 * period * ends, lines, "--", color=VERMILION, linewidth=1.2)
    axes.set_xlim(-1e3 * periods * period, 1e3 * periods * period)


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
