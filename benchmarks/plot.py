"""Work-precision diagrams: the time a run takes against the error it leaves."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .measure import Curve

_OURS = "#c0392b"
_THEIRS = ("#1f4e79", "#2e8b57", "#8e6bbf", "#b8860b", "#5f6a6a", "#17819c", "#111111")
_MARKS = "osD^vPX"
_LABELS = {
    "trajectory": ("largest error of the end-effector [um]", "Trajectory: 8 cycles, 1601 samples"),
    "Jacobian": ("relative error of the worst column", "Jacobian: 10 columns"),
    "sweep, 1000 points": ("largest error of any sample [um]", "Sweep: 1000 points on one core"),
    "joint fit, starts 5 % off": (
        "distance from the optimum of pdssjax [standard errors]",
        "Joint fit, starts 5 % off",
    ),
}
_FIT = "joint fit, starts 5 % off"


def draw(curves: list[Curve], path: Path) -> bool:
    """Saves the figure; False where there is nothing to draw."""
    figure = panels(curves)
    if figure is None:
        return False
    figure.savefig(path, dpi=150)
    return True


def panels(curves: list[Curve]) -> Figure | None:
    """One panel a job, None without any."""
    jobs = [job for job in _LABELS if any(curve.job == job for curve in curves)]
    if not jobs:
        return None
    names = list(dict.fromkeys(curve.who for curve in curves if not _ours(curve) and curve.job != _FIT))
    columns = min(len(jobs), 2)
    rows = -(-len(jobs) // columns)
    figure = Figure(figsize=(6.4 * columns, 0.8 + 4.6 * rows), layout="constrained")
    for i, job in enumerate(jobs):
        axes = figure.add_subplot(rows, columns, i + 1)
        for curve in [c for c in curves if c.job == job]:
            (_point if job == _FIT else _line)(axes, curve, names)
        _dress(axes, job)
    handles, labels = _legend(figure)
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    return figure


def _ours(curve: Curve) -> bool:
    return curve.who.startswith("pdssjax")


def _line(axes: Axes, curve: Curve, names: list[str]) -> None:
    errors = [rung.error for rung in curve.rungs]
    times = [1e3 * rung.seconds for rung in curve.rungs]
    style: dict[str, Any]
    if _ours(curve):
        stepped, coarse = "every cycle" in curve.who, "order 8" in curve.who
        style = dict(color=_OURS, linestyle="--" if stepped else "-", marker="o" if coarse else "s", markersize=4.5)
        style |= dict(linewidth=1.8, markerfacecolor=_OURS if coarse else "white", zorder=3)
    else:
        rank = names.index(curve.who)
        style = dict(color=_THEIRS[rank % len(_THEIRS)], marker=_MARKS[rank % len(_MARKS)], markersize=4, linewidth=1.2)
    axes.plot(errors, times, label=curve.who, **style)
    if curve.wrong:
        beside: dict[str, Any] = dict(textcoords="offset points", xytext=(8, 0), va="center", color=style["color"])
        axes.annotate("wrong", (min(errors), max(times)), **beside)


def _point(axes: Axes, curve: Curve, names: list[str]) -> None:
    """A fit is one point, and ours the line from which the distances are measured."""
    error, time = curve.rungs[0].error, 1e3 * curve.rungs[0].seconds
    beside: dict[str, Any] = dict(textcoords="offset points", va="center", fontsize=9)
    if _ours(curve):
        axes.axhline(time, color=_OURS, linewidth=1.8)
        axes.annotate(curve.who, (0.02, time), xycoords=("axes fraction", "data"), xytext=(0, 9), color=_OURS, **beside)
    else:
        colour = next((_THEIRS[i % len(_THEIRS)] for i, name in enumerate(names) if curve.who.endswith(name)), "black")
        axes.plot([error], [time], "o", color=colour)
        to_the_left = curve.rungs[0].error < 1.0  # the axis runs from large errors to small ones
        beside |= dict(xytext=(-8 if to_the_left else 8, 0), ha="right" if to_the_left else "left", color=colour)
        axes.annotate(curve.who.split(",")[0], (error, time), **beside)


def _dress(axes: Axes, job: str) -> None:
    label, title = _LABELS[job]
    axes.set(xscale="log", yscale="log", xlabel=label, title=title)
    axes.set_ylabel("time of a warm run [ms]")
    axes.invert_xaxis()
    for limits, place in ((axes.get_xlim, axes.set_xlim), (axes.get_ylim, axes.set_ylim)):
        ends = np.log10(limits())
        if abs(ends[1] - ends[0]) < 2.0:  # whole decades, so that two ticks have numbers
            place(*np.power(10.0, np.where(ends == ends.min(), np.floor(ends), np.ceil(ends))))
    if job != _FIT:
        axes.axvline(1e-3, color="0.6", linewidth=0.8, linestyle=":", zorder=0)
    axes.annotate("better", (0.98, 0.86), (0.87, 0.95), "axes fraction", arrowprops=dict(arrowstyle="->", color="0.5"))
    axes.grid(which="major", color="0.9", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)


def _legend(figure: Figure):
    """Everyone once, in the order of first appearance."""
    found = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    return list(found.values()), list(found)
