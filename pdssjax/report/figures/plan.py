"""Figures of a plan: the expected errors before and after, and where samples go along the drive's cycle."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...design import Plan, PlannedRecord
from ._style import BLUE, GREY, VERMILION, styled_figure


def design_figure(plan: Plan) -> Figure:
    """Errors of all parameters on the left, a cycle of the first eight records with its samples on the right."""
    shown = plan.records[:8]
    height = max(0.9 + 0.28 * len(plan.after), 0.5 + 0.95 * len(shown))
    with styled_figure(9.0, height) as figure:
        left, right = np.ravel(np.asarray(figure.subfigures(1, 2, width_ratios=(1.0, 1.15))))
        _draw_errors(left.subplots(), plan)
        panels = np.ravel(right.subplots(len(shown), 1, squeeze=False))
        for axes, planned in zip(panels, shown, strict=True):
            _draw_cycle(axes, planned)
        panels[-1].set_xlabel("time within the cycle (ms)")
    return figure


def _draw_errors(axes: Axes, plan: Plan) -> None:
    """Relative errors of each parameter: before, by the plan alone, together."""
    paths = list(plan.after)
    places = np.arange(len(paths))[::-1]
    kinds = (("before", plan.before, GREY, "o"), ("plan alone", plan.alone, BLUE, "s"))
    for label, errors, colour, marker in (*kinds, ("together", plan.after, VERMILION, "D")):
        shares = np.array([100.0 * abs(errors[path] / plan.knowledge.values[path]) for path in paths])
        axes.plot(shares, places, marker, color=colour, markersize=4.5, label=label)
    axes.set_xscale("log")
    axes.set_yticks(places, paths)
    axes.set_xlabel("expected standard error (%)")
    axes.grid(axis="x", alpha=0.3)
    axes.legend(loc="best")


def _draw_cycle(axes: Axes, planned: PlannedRecord) -> None:
    """The drive over a cycle, or over the record where it does not repeat, and every sample at its phase."""
    experiment, times = planned.experiment, planned.times
    period = experiment.period
    first, end, phase = 0.0, float(times[-1]), times
    if period is not None:
        first, end, phase = period, period, np.mod(times, period)
    time = np.linspace(0.0, end, 800)
    if experiment.motion is not None:
        level, label = 1e6 * experiment.motion[0] * np.sin(2.0 * np.pi * time / end), "um"
    else:
        assert experiment.drive is not None
        level, label = np.asarray(experiment.drive.at(first + time)), "V"  # pyright: ignore[reportArgumentType]
    axes.plot(1e3 * time, level, color=GREY, linewidth=0.9)
    axes.plot(1e3 * phase, np.interp(phase, time, level), "|", color=VERMILION, markersize=7.0, markeredgewidth=0.4)
    axes.set_ylabel(label)
    axes.set_title(f"{planned.name}: {planned.schedule.count} samples", loc="left", fontsize=8.0)
