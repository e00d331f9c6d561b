"""The tabs of a record, its motion over time and its contact, and the table of all scores."""

import html
import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np
import panel as pn

from ...core import MICROMETRES, decimals_for, rounded, with_micro_sign
from ...study import Record
from ..live_record import Redraw, Score, drawn_samples, known_noise
from .style import (
    BLUE,
    CUT,
    GREEN,
    GREY,
    MILLISECONDS,
    PURPLE,
    TABLE,
    VERMILION,
    Model,
    Widget,
    button,
    column,
    models,
    pane,
    plain_figure,
    plain_legend,
    row,
    second_axis,
)


class RecordTab:
    """Six plots of one record: three of the whole record, three of the enlarged stretch."""

    def __init__(self, record: Record, window: tuple[float, float], moved: Callable[[float, float], None]):
        """`moved` takes begin and end [s] of the stretch that the user chooses to enlarge."""
        self._record, self._drawn = record, drawn_samples(record)
        display = record.measurement.display
        self._scale, self._unit = display.scale, with_micro_sign(display.unit)
        self._window = window
        self._quiet = False
        self._whole, self._near = _Sources(), _Sources()
        first, last = MILLISECONDS * float(record.time[0]), MILLISECONDS * float(record.time[-1])
        ends = (
            models.Range1d(first, last, bounds=(first, last)),
            models.Range1d(*(MILLISECONDS * end for end in window)),
        )
        self._moved = moved
        names = f"{display.quantity} ({self._unit})", f"residual ({self._unit})"
        self._plots = [
            [_motion(self._whole, ends[0], names[0], True), _motion(self._near, ends[1], names[0], False)],
            [_residual(self._whole, ends[0], names[1], self._band), _residual(self._near, ends[1], "", self._band)],
            [_command(s, x, record) for s, x in zip((self._whole, self._near), ends, strict=True)],
        ]
        tool = models.RangeTool(x_range=ends[1])
        tool.overlay.fill_color, tool.overlay.fill_alpha = "#F0E442", 0.35
        self._plots[0][0].add_tools(tool)
        for name in ("start", "end"):
            ends[1].on_change(name, lambda attr, old, new: self._dragged(ends[1]))
        for plot in (plot for both in self._plots for plot in both):
            # Aligns the time axes of the rows.
            plot.min_border_left, plot.min_border_right = 72, 58
        heights = 2.5, 1.4, 1.7
        rows = [row(pane(a, 3), pane(b, 2.4), flex=h) for (a, b), h in zip(self._plots, heights, strict=True)]
        self.view = column(*rows)

    def _dragged(self, window: Model) -> None:
        if not self._quiet:
            begin, end = float(window.start), float(window.end)
            self._moved(begin / MILLISECONDS, end / MILLISECONDS)

    def enlarge(self, window: tuple[float, float]) -> None:
        """Show another stretch, from begin to end [s]; the next `draw` draws its curves."""
        self._window, self._quiet = window, True
        try:
            self._plots[0][1].x_range.update(start=MILLISECONDS * window[0], end=MILLISECONDS * window[1])
        finally:
            self._quiet = False

    @property
    def _band(self) -> float:
        """Half-height of the noise band, in the unit of the plot; 0 where the noise is unknown."""
        noise = known_noise(self._record)
        return 2.0 * noise * self._scale if noise > 0 else 0.0

    def draw(self, found: Redraw) -> None:
        """Show the record at other numbers."""
        record, drawn, scale = self._record, self._drawn, self._scale
        for sources, begin, end in ((self._whole, record.time[0], record.time[-1]), (self._near, *self._window)):
            margin = 0.02 * (end - begin)
            at = (record.time >= begin - margin) & (record.time <= end + margin)
            chosen = drawn[at[drawn]] if sources is self._whole else np.flatnonzero(at)[:20000]
            sources.samples.data = {
                "time": MILLISECONDS * record.time[chosen],
                "measured": scale * record.measured[chosen],
                "residual": scale * found.residual[chosen],
            }
            near = (found.instants >= begin - margin) & (found.instants <= end + margin)
            inside = found.inside
            # A contact alone has a prescribed motion in place of the voltage.
            prescribed = np.isfinite(inside.friction).any() and not np.isfinite(inside.voltage).any()
            sources.lines.data = {
                "time": MILLISECONDS * found.instants[near],
                "predicted": scale * found.between[near],
                "voltage": np.asarray(MICROMETRES * inside.relative[near] if prescribed else inside.voltage[near]),
                "platform": np.asarray(MICROMETRES * inside.platform[near]),
            }


class _Sources:
    """The data that the plots of a column share."""

    def __init__(self):
        self.samples = models.ColumnDataSource({"time": [], "measured": [], "residual": []})
        self.lines = models.ColumnDataSource({"time": [], "predicted": [], "voltage": [], "platform": []})


def _motion(sources: _Sources, x_range: Model, label: str, whole: bool) -> Model:
    plot = plain_figure("", label if whole else "", x_range=x_range)
    if whole:
        plot.line("time", "measured", source=sources.samples, color=GREY, line_width=3, legend_label="measured")
    else:
        plot.scatter("time", "measured", source=sources.samples, color=GREY, size=5, fill_alpha=0.5)
    line = {"legend_label": "predicted"} if whole else {}
    plot.line("time", "predicted", source=sources.lines, color=VERMILION, line_width=1.3, **line)
    if whole:
        plain_legend(plot, "top_left", "11px")
        plot.legend.orientation = "horizontal"
        plot.legend.padding = 2
    return plot


def _residual(sources: _Sources, x_range: Model, label: str, band: float) -> Model:
    plot = plain_figure("", label, x_range=x_range)
    if band:
        plot.add_layout(
            models.BoxAnnotation(bottom=-band, top=band, fill_color="#dddddd", fill_alpha=0.6, level="underlay")
        )
    plot.line("time", "residual", source=sources.samples, color=BLUE, line_width=0.8)
    plot.scatter("time", "residual", source=sources.samples, color=BLUE, size=2)
    return plot


def _command(sources: _Sources, x_range: Model, record: Record) -> Model:
    """The voltage, with the platform on a second axis; for a contact alone the prescribed motion."""
    driven = record.measurement.driven
    plot = plain_figure("time (ms)", "voltage (V)" if driven else "motion (µm)", x_range=x_range)
    command = plot.line("time", "voltage", source=sources.lines, color=GREEN, line_width=1.3)
    if driven:
        plot.y_range.renderers = [command]
        plot.yaxis.axis_label_text_color = GREEN
        second_axis(plot, sources.lines, "platform", "platform (µm)", BLUE, line_width=1.3)
        plot.yaxis[1].axis_label_text_color = BLUE
    return plot


def keyboard_buttons(move: Callable[[float], None], widen: Callable[[float], None]) -> Widget:
    """Buttons that move the enlarged stretch by cycles and widen it by factors, for use without a mouse."""
    calls = {"◀ cycle": (move, -1.0), "cycle ▶": (move, 1.0), "closer": (widen, 0.5), "wider": (widen, 2.0)}
    buttons = [button(text, partial(*call), "small", height=26, margin=(4, 2)) for text, call in calls.items()]
    return pn.Row(pn.pane.HTML("enlarged:", margin=(9, 4, 0, 8)), *buttons, margin=0)


class ContactTab:
    """Plots of the contact, or of the platform where the record has no contact."""

    def __init__(self, record: Record):
        # Without a moving end-effector the phase portrait is the platform's.
        self._contact = "friction" in record.measurement.parts()
        self._driven = record.measurement.driven
        empty = {name: [] for name in ("displacement", "velocity", "force", "time")}
        self._whole, self._near = models.ColumnDataSource(empty), models.ColumnDataSource(dict(empty))
        self._measured = models.ColumnDataSource({"displacement": [], "force": []})
        place, speed = "platform (µm)", "velocity (mm/s)"
        if self._contact:
            place = "end-effector relative to platform (µm)" if self._driven else "prescribed motion (µm)"
            speed = "relative velocity (mm/s)"
        portrait = self._loops("Phase portrait", place, speed, "velocity")
        over_time = self._over_time(speed, "velocity", BLUE)
        if not self._contact:
            self.view = column(row(pane(portrait, 1.2), pane(over_time, 1)))
            return
        loop = self._loops("Friction force against displacement", place, "friction force (N)", "force")
        if not self._driven:
            loop.line(
                "displacement", "force", source=self._measured, color=GREY, line_width=3, alpha=0.6, level="underlay"
            )
        force = self._over_time("friction force (N)", "force", PURPLE)
        self.view = column(row(pane(portrait), pane(loop), flex=1.5), row(pane(over_time), pane(force)))

    def draw(self, found: Redraw, window: tuple[float, float], record: Record) -> None:
        """Show the record at other numbers, with the enlarged stretch `window` [s] emphasised."""
        inside, sign = found.inside, -1.0 if self._driven else 1.0
        place, speed = inside.platform, inside.platform_velocity
        if self._contact:
            place, speed = sign * inside.relative, sign * inside.relative_velocity
        data = {
            "displacement": MICROMETRES * place,
            "velocity": 1e3 * speed,
            "force": inside.friction,
            "time": MILLISECONDS * found.instants,
        }
        near = (found.instants >= window[0]) & (found.instants <= window[1])
        self._whole.data = data
        self._near.data = {name: values[near] for name, values in data.items()}
        if record.motion is not None:
            self._measured.data = {
                "displacement": MICROMETRES * record.motion,
                "force": record.measured - found.score.offset,
            }

    def _loops(self, title: str, x: str, y: str, name: str) -> Model:
        plot = plain_figure(x, y, title=f"{title}, within the stretch enlarged")
        if not self._driven:
            plot.line("displacement", name, source=self._whole, color="#c4c4c4", line_width=1)
        plot.line("displacement", name, source=self._near, color=VERMILION, line_width=1.4)
        return plot

    def _over_time(self, label: str, name: str, color: str) -> Model:
        plot = plain_figure("time (ms), the stretch enlarged", label)
        plot.line("time", name, source=self._near, color=color, line_width=1.3)
        return plot


_POOR = 1.5
"""Chi-square per degree of freedom from which a record is marked as poor."""


class ScoreTable:
    """A table with a row for each record."""

    def __init__(self, records: Sequence[Record]):
        self._records = records
        self.view: Widget = pn.pane.HTML(
            "", stylesheets=[TABLE, CUT], sizing_mode="stretch_width", margin=(2, 0, 0, 8), css_classes=["scores"]
        )

    def show(self, scores: Mapping[str, Score], chosen: str, stale: bool) -> None:
        """Show the known `scores` by record; `stale` marks all but that of the `chosen` record."""
        heads = "record", "measures", "role", "chi-square / n", "rmse", "noise", "offset"
        head = "".join(f"<th{_side(i)}>{text}</th>" for i, text in enumerate(heads))
        rows = "".join(self._row(r, scores.get(r.name), chosen, stale and r.name != chosen) for r in self._records)
        self.view.object = f"<table><tr>{head}</tr>{rows}</table>"

    def _row(self, record: Record, score: Score | None, chosen: str, stale: bool) -> str:
        name = html.escape(record.name)
        role = "fitted" if record.role == "fit" else "validation"
        cells = [f'<span class="cut" title="{name}">{name}</span>', record.measures, role]
        poor = ""
        if score is None:
            cells += ["…", "", "", ""]
        else:
            display = record.measurement.display
            unit = with_micro_sign(display.unit)
            places = decimals_for(0.1 * score.noise * display.scale)
            amount = lambda number: f"{rounded(number * display.scale, places)} {unit}"
            chi2 = f"{score.chi2:.4g}" if math.isfinite(score.chi2) else "simulation failed"
            cells += [chi2, amount(score.rmse), amount(score.noise), amount(score.offset)]
            cells[5] += "" if score.noise_given else " (seen)"
            poor = " poor" if not score.chi2 < _POOR else ""
        grey = ' style="color:#999"' if stale else ""
        row_cells = "".join(f"<td{_side(i, poor if i == 3 else '')}{grey}>{cell}</td>" for i, cell in enumerate(cells))
        return f"<tr{' class=chosen' if record.name == chosen else ''}>{row_cells}</tr>"


def _side(column: int, more: str = "") -> str:
    return f' class="number{more}"' if column > 2 else ""
