"""Figures of a comparison of models: held-out scores with their errors, and residuals beside the best model's."""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...selection import Comparison, Difference, Result
from ...study import Record, cycles_a_second
from ._style import BLUE, GREEN, GREY, VERMILION, styled_figure


def selection_figure(found: Comparison) -> Figure:
    """How much each model scores below the best one on held-out samples, with two standard errors."""
    shown = [result for result in found.results if result.time is not None]
    with styled_figure(7.4, 1.3 + 0.3 * len(shown)) as figure:
        has_records = any(result.records is not None for result in shown)
        panels = figure.subplots(1, 1 + has_records, sharey=True, squeeze=False)[0]
        _draw_scores(panels[0], found, shown, "time", "blocks of time")
        if has_records:
            _draw_scores(panels[1], found, shown, "records", "whole records")
        panels[0].set_yticks(range(len(shown)), [_label(result) for result in shown])
        panels[0].set_ylim(len(shown) - 0.5, -0.5)
        figure.supxlabel("log score on held-out samples below the best model, with 2 standard errors", fontsize=9.0)
    return figure


def _label(result: Result) -> str:
    return f"{result.name} ({len(result.fitted.free)})"


def _draw_scores(axes: Axes, found: Comparison, shown: list[Result], which: str, title: str) -> None:
    ends = [0.0]
    for place, result in enumerate(shown):
        difference: Difference | None = getattr(result, which)
        if difference is None:
            continue
        colour = VERMILION if result.is_worse else GREEN if result.name == found.chosen else BLUE
        error = 2.0 * difference.standard_error
        ends += [difference.total - error, difference.total + error]
        axes.errorbar(difference.total, place, xerr=error, fmt="o", color=colour, markersize=4, capsize=2)
    axes.axvline(0.0, color=GREY, linewidth=0.8, zorder=0)
    # Laws that are far off would press all others together.
    axes.set_xscale("symlog", linthresh=_LINEAR)
    low, high = min(min(ends), -_LINEAR / 2.0), max(max(ends), _LINEAR)
    axes.set_xlim(2.0 * low, 3.0 * high)
    axes.set_xticks(sorted({0.0, *_decades(high), *(-tick for tick in _decades(-low))}))
    axes.minorticks_off()
    axes.set_title(title, loc="left")


_LINEAR = 10.0
"""Log score up to which the axis is linear: three or four matter."""


def _decades(reach: float) -> list[float]:
    """Ticks from where the axis is logarithmic up to its end, five at most."""
    last = math.floor(math.log10(reach)) if reach > 0 else 0
    return [10.0**k for k in range(1, last + 1, max(1, math.ceil(last / 5)))]


def residual_strips_figure(found: Comparison) -> Figure:
    """The residuals of six models at most, those near the best one, in the record that has most of what each leaves.

    Grey are those of the best model.
    """
    behind = {result.name: abs(result.time.total) for result in found.results if result.time is not None}
    behind |= dict.fromkeys((found.chosen, found.best), -1.0)
    nearest = sorted(behind, key=behind.__getitem__)[:6]
    shown = [result for result in found.results if result.name in nearest]
    best = found[found.best].fitted
    with styled_figure(7.4, 0.6 + 1.05 * len(shown)) as figure:
        panels = figure.subplots(len(shown), 1, squeeze=False)[:, 0]
        for axes, result in zip(panels, shown, strict=True):
            place = _place(found, result)
            beside = None if result.name == found.best else best.residuals[place]
            _draw_strip(axes, found.records[place], result, place, beside)
        panels[-1].set_xlabel("time (s), or part of the drive's cycle where a record repeats")
    return figure


def _place(found: Comparison, result: Result) -> int:
    """The record of a strip: that which has most of what the model leaves, else the first that shows a contact."""
    names = [record.name for record in found.records]
    if result.misfit is not None:
        return names.index(result.misfit.record)
    misfits = [other.misfit.record for other in found.results if other.misfit is not None]
    return names.index(max(set(misfits), key=misfits.count)) if misfits else 0


def _draw_strip(axes: Axes, record: Record, result: Result, place: int, best: np.ndarray | None) -> None:
    display, frequency = record.measurement.display, cycles_a_second(record)
    repeats = frequency is not None and np.ptp(record.time) * frequency >= 1.0
    where = np.mod(record.time * frequency, 1.0) if repeats and frequency else record.time
    few = slice(None, None, -(-record.time.size // 4000))  # more samples are one black bar
    colour = VERMILION if result.is_worse else BLUE
    axes.plot(where[few], display.scale * result.fitted.residuals[place][few], ".", color=colour, markersize=1.6)
    if best is not None:
        axes.plot(where[few], display.scale * best[few], ".", color=GREY, markersize=1.2)
    axes.set_title(f"{_label(result)}: {record.name}", loc="left")
    axes.set_ylabel(f"residual ({display.unit})")
    axes.set_xlabel("")
