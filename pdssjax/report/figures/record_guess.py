"""Figure of what the samples of a file suggest: voltage and waveform, motion, the drive's start."""

from typing import Any

import matplotlib
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...metrics import RecordGuess
from ._style import BLUE, GREY, STYLE, VERMILION, YELLOW, fixed_ticks


def guess_figure(name: str, guess: RecordGuess) -> Figure:
    """Voltage with the waveform found, over the motion; to the right, the first fast flank enlarged."""
    moment = _moment(guess)
    near = (guess.time >= moment[0]) & (guess.time <= moment[1])
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.4, 4.2), layout="constrained")
        ((volts, near_volts), (motion, near_motion)) = figure.subplots(2, 2, sharex="col", width_ratios=(3, 2))
        whole = np.ones(guess.time.size, bool)
        for panels, part, factor in (((volts, motion), whole, 1.0), ((near_volts, near_motion), near, 1e3)):
            _draw(*panels, guess, part, factor)
        volts.axvspan(*moment, color=YELLOW, alpha=0.45, linewidth=0, zorder=0)
        motion.axvspan(*moment, color=YELLOW, alpha=0.45, linewidth=0, zorder=0)
        volts.set_ylabel("voltage (V)")
        motion.set_ylabel(f"{guess.measures} ({_unit(guess)})" + (", turned" if guess.turned else ""))
        motion.set_xlabel("time on the file's clock (s)")
        # Milliseconds have three decimals and a sign: nine of them run into each other.
        motion.locator_params(axis="x", nbins=6)
        near_motion.set_xlabel("time (ms)")
        near_volts.set_title("the shaded moment", loc="left")
        if guess.volts is not None or np.isfinite(guess.waveform.numbers["voltage"]):
            volts.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, borderaxespad=0.0)
        figure.suptitle(_caption(name, guess), x=0.01, ha="left", fontsize=10.0, wrap=True)
        fixed_ticks(6, volts, near_volts, motion, near_motion)
        figure.align_ylabels((volts, motion))
    return figure


def _draw(volts: Axes, motion: Axes, guess: RecordGuess, part: np.ndarray, factor: float) -> None:
    time = factor * guess.time[part]
    marks = {"marker": ".", "markersize": 3.0} if factor != 1.0 else {}
    # Enlarged, the samples themselves: a line between them would be a flank that nobody recorded.
    shown: dict[str, Any] = {"linestyle": "none", "marker": ".", "markersize": 7.0} if marks else {"linewidth": 2.4}
    if guess.volts is not None:
        volts.plot(time, guess.volts[part], color=GREY, label="recorded", **shown)
    if guess.waveform.name != "sampled":
        fine = np.linspace(guess.time[part][0], guess.time[part][-1], 4000)
        label = guess.waveform.name + (", not recorded" if guess.volts is None else "")
        volts.plot(factor * fine, waveform_at(guess, fine), color=VERMILION, linewidth=0.9, label=label)
    shown_motion = guess.motion if guess.velocity is None else guess.velocity
    motion.plot(time, guess.display.scale * shown_motion[part], color=BLUE, linewidth=0.8, **marks)
    if guess.time[part][0] <= guess.start <= guess.time[part][-1]:
        for panel in (volts, motion):
            panel.axvline(factor * guess.start, color="0.2", linewidth=0.8, linestyle=":")
        # On white, beside the voltage's flank.
        backed = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0}
        place = (factor * guess.start, 0.5)
        label = volts.annotate("t = 0", place, (3.0, 0.0), ("data", "axes fraction"), "offset points", fontsize=8.0)
        label.set_bbox(backed)


def waveform_at(guess: RecordGuess, time: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """The voltage [V] of the waveform found, at `time` [s] on the file's clock, and the level it is counted from."""
    from ...core import member

    wave = guess.waveform
    kind = member("drive", wave.name)
    drive = kind(**wave.numbers, **({"direction": wave.direction} if wave.direction else {}))
    return np.asarray(drive.at(time - guess.start)) + wave.counted_from


def _moment(guess: RecordGuess) -> tuple[float, float]:
    """Around the fastest change of the voltage, or of the motion where none was recorded."""
    shown = guess.motion if guess.volts is None else guess.volts
    interval = float(np.median(np.diff(guess.time)))
    width = max(60 * interval, (guess.time[-1] - guess.time[0]) / 60)
    jump = float(guess.time[np.argmax(np.abs(np.diff(shown)))])
    return max(jump - 0.2 * width, float(guess.time[0])), min(jump + 0.8 * width, float(guess.time[-1]))


def _caption(name: str, guess: RecordGuess) -> str:
    wave = guess.waveform
    units = {"voltage": (1.0, "V"), "bias": (1.0, "V"), "frequency": (1.0, "Hz"), "fall_time": (1e3, "ms")}
    units["rise_time"] = (1e3, "ms")
    told = [f"{wave.name} {wave.direction}".strip()]
    if wave.name != "sampled":
        for field, number in wave.numbers.items():
            scale, unit = units.get(field, (1.0, ""))
            title = "" if field in ("voltage", "frequency") else field.replace("_", " ") + " "
            told.append(f"{title}{scale * number:.5g} {unit}".strip())
        told += [f"counted from {wave.counted_from:.4g} V"] * (wave.counted_from != 0)
    told.append(f"t = 0 at {_shown_time(guess.start)}")
    return f"{name}\n{', '.join(told)}; noise {guess.display.scale * guess.noise:.3g} {_unit(guess)}"


def _unit(guess: RecordGuess) -> str:
    return guess.display.unit.replace("um", "µm")


def _shown_time(seconds: float) -> str:
    """To the nanosecond; in milliseconds where it is short, as the enlarged panels show it."""
    return f"{round(1e3 * seconds, 6) + 0.0:.4g} ms" if abs(seconds) < 0.1 else f"{seconds:.7g} s"
