"""Figure of a record's residuals split into misfit, which repeats every cycle, and noise."""

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...inference import repeats
from ...metrics import CycleSplit, NoiseInTime, ResidualSplit, grid_positions, sample_autocovariance, split_residuals
from ...study import FittedRecord
from ._style import BLUE, GREY, STYLE, VERMILION

_MOST_SHOWN = 60
"""Intervals up to which the autocorrelation is shown at most."""

_MARGIN = 0.1
"""Room above and below residuals, as a share of their span, where an axis leaves out samples that stand out."""


def residual_split_figure(record: FittedRecord) -> Figure:
    """Mean over the cycles at each phase beside all residuals; to the right, the autocorrelation of the rest.

    Of a record that does not repeat, all residuals over time.  All of them are those of the report.  Samples that stand
    out may lie beyond the axis, whose caption says by how much, and are left out of means and autocorrelation.
    """
    split = split_residuals(record.residual_without_outliers, record.time, record.frequency)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.4, 2.9), layout="constrained")
        residuals, correlation = figure.subplots(1, 2, width_ratios=(3, 2))
        if split.cycles is None:
            _draw_all(residuals, record)
        else:
            _draw_cycle(residuals, record, split.cycles)
        if record.outliers.size:
            _show_others(residuals, record)
        _draw_autocorrelation(correlation, record, split)
        figure.suptitle(f"{record.name}\n{_caption(record, split)}", x=0.01, ha="left", fontsize=10.0, wrap=True)
    return figure


def _draw_cycle(axes: Axes, record: FittedRecord, cycles: CycleSplit) -> None:
    scale, unit = record.display.scale, record.display.unit.replace("um", "µm")
    there = cycles.sizes > 0
    place = cycles.phases()
    residual = scale * record.residual
    seen = cycles.group >= 0
    # Samples that stand out have no group, but a phase.
    phase = np.mod(record.time * (record.frequency or 0.0), 1.0)
    phase[seen] = place[cycles.group[seen]]
    axes.plot(phase, residual, ".", color="0.75", markersize=2, label="every cycle")
    within = float(np.sqrt(np.nanmean(cycles.rest**2)))
    band = 2.0 * scale * within / np.sqrt(np.maximum(cycles.sizes, 1))
    centre = float(np.mean(residual[seen]))
    axes.fill_between(
        place[there],
        centre - band[there],
        centre + band[there],
        color=GREY,
        alpha=0.35,
        linewidth=0,
        label="± 2 by noise",
    )
    axes.plot(place[there], scale * cycles.mean[there], color=BLUE, linewidth=1.0, label="mean of the cycles")
    axes.set_xlabel("phase of the cycle")
    axes.set_ylabel(f"residual ({unit})")
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, markerscale=3, borderaxespad=0.2)


def _draw_all(axes: Axes, record: FittedRecord) -> None:
    scale, unit = record.display.scale, record.display.unit.replace("um", "µm")
    axes.plot(record.time, scale * record.residual, color=BLUE, linewidth=0.6)
    axes.set_xlabel("time (s)")
    axes.set_ylabel(f"residual ({unit})")


def _show_others(axes: Axes, record: FittedRecord) -> None:
    """End the axis where the samples end that do not stand out."""
    others = record.display.scale * record.residual_without_outliers
    others = others[np.isfinite(others)]
    if others.size and np.ptp(others) > 0.0:
        margin = _MARGIN * float(np.ptp(others))
        axes.set_ylim(float(others.min()) - margin, float(others.max()) + margin)


def _draw_autocorrelation(axes: Axes, record: FittedRecord, split: ResidualSplit) -> None:
    interval, places = float(np.median(np.diff(record.time))), grid_positions(record.time)
    if places is None:
        interval = max(interval, float(np.ptp(record.time)) / (4 * record.time.size))
        places = np.rint((record.time - record.time[0]) / interval).astype(int)
    longest = record.time.size // 2 if split.cycles is None else split.cycles.sizes.size // 2
    shown = max(min(_MOST_SHOWN, longest), 2)
    covariance = sample_autocovariance(split.rest, places, shown)
    if covariance[0] <= 0.0:
        return
    apart = interval * np.arange(shown)
    band = 2.0 / np.sqrt(max(split.freedom, 1.0))
    axes.axhspan(-band, band, color="0.9", linewidth=0, zorder=-1)
    axes.vlines(1e3 * apart, 0.0, covariance / covariance[0], color=BLUE, linewidth=1.2)
    noise = split.noise
    if isinstance(noise, NoiseInTime):
        model, label = noise.covariance_at(apart), f"white and slow noise ({1e3 * noise.duration:.2g} ms)"
    else:
        model, label = noise.autocovariance(shown), f"autoregression of order {noise.order}"
    label = label if noise.order else "white noise"
    style = ".-" if noise.order else "."
    axes.plot(1e3 * apart, model / model[0], style, color=VERMILION, linewidth=0.9, markersize=2.5, label=label)
    axes.axhline(0.0, color=GREY, linewidth=0.5)
    axes.set_xlabel("interval (ms)")
    axes.set_ylabel("autocorrelation " + ("of the residuals" if split.cycles is None else "of the rest"))
    axes.legend(loc="upper right")


def _caption(record: FittedRecord, split: ResidualSplit) -> str:
    show = lambda number: record.display.text(number).replace("um", "µm")
    without = ""
    if record.outliers.size:
        largest = float(np.max(np.abs(record.residual[record.outliers])))
        without = f"; samples that stand out: {record.outliers.size}, by up to {show(largest)}"
    if split.cycles is None or record.lack_of_fit is None:
        return f"does not repeat: misfit and slow noise cannot be told apart{without}"
    found = record.lack_of_fit
    what = "misfit" if repeats(record) else "as chance has it, no misfit"
    return f"repeats every cycle: {show(found.misfit)} ({what}); does not: {show(found.noise)} (noise){without}"
