"""Figures of a study and of an estimate: every record, one a row, and beside it its liveliest moment enlarged."""

from collections.abc import Sequence
from typing import NamedTuple

import matplotlib
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...core import VELOCITY, Display
from ...study import Estimate, Study
from ._style import BLUE, GREY, STYLE, VERMILION, YELLOW
from .records import liveliest_moment


class _Row(NamedTuple):
    """What is drawn of one record."""

    title: str
    display: Display
    time: Float[np.ndarray, " n"]
    measured: Float[np.ndarray, " n"]
    predicted: Float[np.ndarray, " n"] | None
    motion: Float[np.ndarray, " n"] | None
    prescribed: Display
    """How the `motion` is shown."""


def study_figure(study: Study) -> Figure:
    """What was measured: every record of a study."""
    rows = [
        _Row(
            _titled(r.name, r.measures, r.role),
            r.measurement.display,
            r.time,
            r.measured,
            None,
            r.motion,
            r.measurement.prescribed_display,
        )
        for r in study.records
    ]
    return _overview(study.title, rows)


def estimate_figure(estimate: Estimate) -> Figure:
    """Every record of an estimate against its prediction."""
    rows = [
        _Row(_titled(r.name, r.measures, r.role), r.display, r.time, r.measured, r.predicted, r.motion, r.prescribed)
        for r in estimate.records
    ]
    return _overview(estimate.title, rows)


def _titled(name: str, measures: str, role: str) -> str:
    return f"{name}: {measures}" + (", not fitted" if role == "validate" else "")


def _overview(title: str, rows: Sequence[_Row]) -> Figure:
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.4, 0.9 + 1.25 * len(rows)), layout="constrained")
        grid = figure.subplots(len(rows), 2, squeeze=False)
        for row, (whole, near) in zip(rows, grid, strict=True):
            _draw(whole, near, row)
        grid[-1, 0].set_xlabel("time (s)")
        if any(row.predicted is not None for row in rows):
            figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
        figure.suptitle(title, x=0.01, ha="left", fontsize=10.0, wrap=True)
        figure.align_ylabels(grid[:, 0])
    return figure


def _draw(whole: Axes, near: Axes, row: _Row) -> None:
    _curves(whole, row.time, row, slice(None))
    whole.set_title(row.title, loc="left")
    whole.set_ylabel(row.display.unit.replace("um", "µm"))
    if row.motion is not None:
        order = np.argsort(row.motion) if row.prescribed == VELOCITY else np.arange(row.motion.size)
        _curves(near, row.prescribed.scale * row.motion[order], row, order)
        near.set_xlabel(f"{row.prescribed.quantity} ({row.prescribed.unit.replace('um', 'µm')})")
        return
    moment = liveliest_moment(row.time, row.measured)
    _curves(near, 1e3 * row.time[moment], row, moment)
    near.set_xlabel("time (ms)", fontsize=7.5, labelpad=1.0)
    near.tick_params(labelsize=7.5)
    whole.axvspan(*row.time[moment][[0, -1]], color=YELLOW, alpha=0.5, linewidth=0, zorder=0)


def _curves(axes: Axes, x: Float[np.ndarray, " n"], row: _Row, part: "slice | np.ndarray") -> None:
    scale = row.display.scale
    alone = row.predicted is None
    axes.plot(
        x, scale * row.measured[part], color=BLUE if alone else GREY, linewidth=1.0 if alone else 2.2, label="measured"
    )
    if row.predicted is not None:
        axes.plot(x, scale * row.predicted[part], color=VERMILION, linewidth=0.9, label="predicted")
