"""Work-precision diagrams: the time a run takes against the error it leaves."""

from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .measure import Curve

_OURS = "#c0392b"
_THEIRS = ("#1f4e79", "#2e8b57", "#8e6bbf", "#b8860b", "#5f6a6a", "#17819c")
_MARKS = "osD^vP"
_LABELS = {
    "trajectory": ("largest error of the end-effector [um]", "Trajectory: 8 cycles, 1601 samples"),
    "Jacobian": ("relative error of the worst column", "Jacobian: 10 columns"),
}


def draw(curves: list[Curve], path: Path) -> bool:
    """One panel a job; False where there is nothing to draw."""
    jobs = [job for job in _LABELS if any(curve.job == job for curve in curves)]
    if not jobs:
        return False
    names = list(dict.fromkeys(curve.who for curve in curves if not _ours(curve)))
    figure = Figure(figsize=(6.4 * len(jobs), 5.6), layout="constrained")
    for i, job in enumerate(jobs):
        axes = figure.add_subplot(1, len(jobs), i + 1)
        for curve in [c for c in curves if c.job == job]:
            _line(axes, curve, names)
        _dress(axes, job)
    handles, labels = _legend(figure)
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    figure.savefig(path, dpi=150)
    return True


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


def _dress(axes: Axes, job: str) -> None:
    label, title = _LABELS[job]
    axes.set(xscale="log", yscale="log", xlabel=label, title=title)
    axes.set_ylabel("time of a warm run [ms]")
    axes.invert_xaxis()
    axes.axvline(1e-3, color="0.6", linewidth=0.8, linestyle=":", zorder=0)
    axes.annotate("better", (0.97, 0.03), (0.86, 0.12), "axes fraction", arrowprops=dict(arrowstyle="->", color="0.5"))
    axes.grid(which="major", color="0.9", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)


def _legend(figure: Figure):
    """Everyone once, in the order of first appearance."""
    found = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    return list(found.values()), list(found)
