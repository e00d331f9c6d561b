"""Figures of what no fit has seen: the guess of a record, its cycles, a friction curve, a simulated run."""

from typing import Any

import matplotlib
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...core import LENGTH, MICROMETRES, VELOCITY, InputError, member, with_micro_sign
from ...metrics import Characterisation, RecordGuess
from ...simulation import Trajectory
from ._style import BLUE, GREY, VERMILION, YELLOW, fixed_ticks, styled_figure


def guess_figure(name: str, guess: RecordGuess) -> Figure:
    """Voltage with the waveform found, over the motion; to the right, the first fast flank enlarged."""
    # The samples around the fastest change of the voltage, or of the motion where none was recorded.
    changing, first, last = guess.motion if guess.volts is None else guess.volts, guess.time[0], guess.time[-1]
    width = max(60 * float(np.median(np.diff(guess.time))), (last - first) / 60)
    jump = float(guess.time[np.argmax(np.abs(np.diff(changing)))])
    moment = max(jump - 0.2 * width, float(first)), min(jump + 0.8 * width, float(last))
    near = (guess.time >= moment[0]) & (guess.time <= moment[1])
    with styled_figure(7.4, 4.2) as figure:
        ((volts, near_volts), (motion, near_motion)) = figure.subplots(2, 2, sharex="col", width_ratios=(3, 2))
        whole = np.ones(guess.time.size, bool)
        for panels, part, factor in (((volts, motion), whole, 1.0), ((near_volts, near_motion), near, 1e3)):
            _draw_guess(*panels, guess, part, factor)
        for panel in (volts, motion):
            panel.axvspan(*moment, color=YELLOW, alpha=0.45, linewidth=0, zorder=0)
        volts.set_ylabel("voltage (V)")
        motion.set_ylabel(f"{guess.measures} ({_unit(guess)})" + (", turned" if guess.turned else ""))
        motion.set_xlabel("time on the file's clock (s)")
        # Milliseconds have three decimals and a sign: nine of them run into each other.
        motion.locator_params(axis="x", nbins=6)
        near_motion.set_xlabel("time (ms)")
        near_volts.set_title("the shaded moment", loc="left")
        if guess.volts is not None or np.isfinite(guess.waveform.numbers["voltage"]):
            volts.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, borderaxespad=0.0)
        figure.suptitle(_guess_caption(name, guess), x=0.01, ha="left", fontsize=10.0, wrap=True)
        fixed_ticks(6, volts, near_volts, motion, near_motion)
        figure.align_ylabels((volts, motion))
    return figure


def _draw_guess(volts: Axes, motion: Axes, guess: RecordGuess, part: np.ndarray, factor: float) -> None:
    time = factor * guess.time[part]
    marks = {"marker": ".", "markersize": 3.0} if factor != 1.0 else {}
    # Enlarged, the samples themselves: a line between them would be a flank that nobody recorded.
    shown: dict[str, Any] = {"linestyle": "none", "marker": ".", "markersize": 7.0} if marks else {"linewidth": 2.4}
    if guess.volts is not None:
        volts.plot(time, guess.volts[part], color=GREY, label="recorded", **shown)
    wave = guess.waveform
    if wave.name != "sampled":
        fine = np.linspace(guess.time[part][0], guess.time[part][-1], 4000)
        drive = member("drive", wave.name)(**wave.numbers, **({"direction": wave.direction} if wave.direction else {}))
        voltage = np.asarray(drive.at(fine - guess.start)) + wave.counted_from
        label = wave.name + (", not recorded" if guess.volts is None else "")
        volts.plot(factor * fine, voltage, color=VERMILION, linewidth=0.9, label=label)
    shown_motion = guess.motion if guess.velocity is None else guess.velocity
    motion.plot(time, guess.display.scale * shown_motion[part], color=BLUE, linewidth=0.8, **marks)
    if guess.time[part][0] <= guess.start <= guess.time[part][-1]:
        for panel in (volts, motion):
            panel.axvline(factor * guess.start, color="0.2", linewidth=0.8, linestyle=":")
        place = (factor * guess.start, 0.5)
        label = volts.annotate("t = 0", place, (3.0, 0.0), ("data", "axes fraction"), "offset points", fontsize=8.0)
        # On white, beside the voltage's flank.
        label.set_bbox({"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0})


def _guess_caption(name: str, guess: RecordGuess) -> str:
    wave = guess.waveform
    units = {"voltage": (1.0, "V"), "bias": (1.0, "V"), "frequency": (1.0, "Hz")}
    units |= {"fall_time": (1e3, "ms"), "rise_time": (1e3, "ms")}
    parts = [f"{wave.name} {wave.direction}".strip()]
    if wave.name != "sampled":
        for field, number in wave.numbers.items():
            scale, unit = units.get(field, (1.0, ""))
            title = "" if field in ("voltage", "frequency") else field.replace("_", " ") + " "
            parts.append(f"{title}{scale * number:.5g} {unit}".strip())
        parts += [f"counted from {wave.counted_from:.4g} V"] * (wave.counted_from != 0)
    # To the nanosecond; in milliseconds where it is short, as in the enlarged panels.
    start, is_short = guess.start, abs(guess.start) < 0.1
    parts.append("t = 0 at " + (f"{round(1e3 * start, 6) + 0.0:.4g} ms" if is_short else f"{start:.7g} s"))
    return f"{name}\n{', '.join(parts)}; noise {guess.display.scale * guess.noise:.3g} {_unit(guess)}"


def _unit(guess: RecordGuess) -> str:
    return with_micro_sign(guess.display.unit)


def cycle_figure(found: Characterisation) -> Figure:
    """The record with its cycles and turning points; to the right, its cycles and its slips on top of each other."""
    scale, unit = (MICROMETRES, "µm") if found.measures == "displacement" else (1.0, "N")
    with styled_figure(7.4, 4.8) as figure:
        panels = figure.subplot_mosaic("RRRCC;RRRSS")
        _draw_cycles(panels["R"], found, scale)
        for name, periods in [("C", 0.75), ("S", 0.05)]:
            _draw_overlaid(panels[name], found, scale, periods)
        panels["R"].set_ylabel(f"{found.measures} ({unit})")
        moves = found.measures == "displacement"
        for name in "CS":
            panels[name].set_ylabel(f"{'from mid-flank' if moves else 'force'} ({unit})")
        panels["C"].set_title("cycles, first dark, last light", loc="left")
        panels["S"].set_title("slips, dashed: mean of the lines" if moves else "slips", loc="left")
        panels["S"].set_xlabel("time from the slip (ms)")
        figure.suptitle(_cycle_caption(found), x=0.01, ha="left", fontsize=10.0, wrap=True)
    return figure


def _draw_cycles(axes: Axes, found: Characterisation, scale: float) -> None:
    """Draw the record as it was measured."""
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
    """Draw what lies within `periods` periods of each slip, signed so that slow flanks rise."""
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
        figures = f"S {shown('stroke', MICROMETRES, 'µm')}, S₀ {shown('back_slip', MICROMETRES, 'µm')}, "
        figures += f"step efficiency {shown('efficiency', 100.0, '%')}, {shown('speed', MICROMETRES, 'µm/s')}"
    return f"{found.name}\n{found.cycles.count} cycles at {found.cycles.frequency:.5g} Hz: {figures}"


def friction_figure(
    name: str, motion: Float[np.ndarray, " n"], force: Float[np.ndarray, " n"], quantity: str
) -> Figure:
    """The `force` [N] against the `motion`, a "displacement" [m] or a "velocity" [m/s]."""
    shown = VELOCITY if quantity == "velocity" else LENGTH
    with styled_figure(5.0, 3.6) as figure:
        axes = figure.subplots()
        if quantity == "velocity":
            axes.plot(shown.scale * motion, force, ".", color=BLUE, markersize=3)
        else:
            axes.plot(shown.scale * motion, force, color=BLUE, linewidth=0.8)
        axes.set_xlabel(f"{quantity} ({with_micro_sign(shown.unit)})")
        axes.set_ylabel("force (N), with the sign of the motion")
        axes.set_title(name, loc="left")
        fixed_ticks(5, axes)
    return figure


def trajectory_figure(run: Trajectory) -> Figure:
    """The voltage over the motion over the friction force, against time.

    **Raises:** `InputError` for several runs side by side (of `vmap`).
    """
    if np.ndim(run.time) != 1:
        raise InputError(f"plot: found runs of shape {np.shape(run.effector)}, expected a single one.")
    time = np.asarray(run.time)
    with styled_figure(7.4, 4.8) as figure:
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
