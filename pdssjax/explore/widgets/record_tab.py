"""The tab of a record: measured and predicted, residuals, voltage and platform; to the right a stretch enlarged."""

from collections.abc import Callable

import numpy as np
import panel as pn
from jaxtyping import Bool, Float

from ...core import MICROMETRES
from ...study import Record
from ..redraw import Redraw, drawn_samples, known_noise
from .style import (
    BLUE,
    GREEN,
    GREY,
    MILLISECONDS,
    VERMILION,
    Model,
    Widget,
    column,
    models,
    pane,
    plain,
    plain_figure,
    row,
)

Moved = Callable[[float, float], None]
"""Told from when to when [s] the stretch reaches that is to be enlarged."""


class RecordTab:
    """Six plots of one record, three of all of it and three of the stretch enlarged."""

    def __init__(self, record: Record, window: tuple[float, float], moved: Moved):
        self._record, self._drawn = record, drawn_samples(record)
        display = record.measurement.display
        self._scale, self._unit = display.scale, display.unit.replace("um", "µm")
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
        self._add_tool(ends[1])
        for made in (made for both in self._plots for made in both):
            # So that the times stand below each other.
            made.min_border_left, made.min_border_right = 72, 58
        # The heights of the rows, of six parts.
        parts = [row(pane(a, 3), pane(b, 2.4), flex=f) for (a, b), f in zip(self._plots, (2.5, 1.4, 1.7), strict=True)]
        self.view = column(*parts)

    def _add_tool(self, window: Model) -> None:
        overview = self._plots[0][0]
        tool = models.RangeTool(x_range=window)
        tool.overlay.fill_color = "#F0E442"
        tool.overlay.fill_alpha = 0.35
        overview.add_tools(tool)
        for name in ("start", "end"):
            window.on_change(name, lambda attr, old, new: self._dragged(window))

    def _dragged(self, window: Model) -> None:
        if not self._quiet:
            begin, end = float(window.start), float(window.end)
            self._moved(begin / MILLISECONDS, end / MILLISECONDS)

    def enlarge(self, window: tuple[float, float]) -> None:
        """Shows another stretch, from when to when [s]; what is drawn in it comes with the next `draw`."""
        self._window, self._quiet = window, True
        try:
            self._plots[0][1].x_range.update(start=MILLISECONDS * window[0], end=MILLISECONDS * window[1])
        finally:
            self._quiet = False

    @property
    def _band(self) -> float:
        """Half the height of the band of the noise, in the unit shown; 0 where none is known."""
        noise = known_noise(self._record)
        return 2.0 * noise * self._scale if noise > 0 else 0.0

    def draw(self, found: Redraw) -> None:
        """Shows the record at other numbers."""
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
            sources.lines.data = _lines(found, near, scale)


class _Sources:
    """What two plots in a column share."""

    def __init__(self):
        self.samples = models.ColumnDataSource({"time": [], "measured": [], "residual": []})
        self.lines = models.ColumnDataSource({"time": [], "predicted": [], "voltage": [], "platform": []})


def _lines(found: Redraw, near: Bool[np.ndarray, " k"], scale: float) -> dict[str, Float[np.ndarray, " near"]]:
    inside = found.inside
    friction = np.isfinite(inside.friction).any() and not np.isfinite(inside.voltage).any()
    return {
        "time": MILLISECONDS * found.instants[near],
        "predicted": scale * found.between[near],
        # Where no voltage drives it, what is prescribed.
        "voltage": np.asarray(MICROMETRES * inside.relative[near] if friction else inside.voltage[near]),
        "platform": np.asarray(MICROMETRES * inside.platform[near]),
    }


def _motion(sources: _Sources, x_range: Model, label: str, whole: bool) -> Model:
    made = plain_figure("", label if whole else "", x_range=x_range)
    if whole:
        made.line("time", "measured", source=sources.samples, color=GREY, line_width=3, legend_label="measured")
    else:
        made.scatter("time", "measured", source=sources.samples, color=GREY, size=5, fill_alpha=0.5)
    line = {"legend_label": "predicted"} if whole else {}
    made.line("time", "predicted", source=sources.lines, color=VERMILION, line_width=1.3, **line)
    if whole:
        made.legend.location = "top_left"
        made.legend.orientation = "horizontal"
        made.legend.background_fill_alpha = 0.6
        made.legend.border_line_color = None
        made.legend.label_text_font_size = "11px"
        made.legend.padding = 2
    return made


def _residual(sources: _Sources, x_range: Model, label: str, band: float) -> Model:
    made = plain_figure("", label, x_range=x_range)
    if band:
        made.add_layout(
            models.BoxAnnotation(bottom=-band, top=band, fill_color="#dddddd", fill_alpha=0.6, level="underlay")
        )
    made.line("time", "residual", source=sources.samples, color=BLUE, line_width=0.8)
    made.scatter("time", "residual", source=sources.samples, color=BLUE, size=2)
    return made


def _command(sources: _Sources, x_range: Model, record: Record) -> Model:
    """Voltage, and the platform on an axis of its own; of a contact alone the motion prescribed."""
    driven = record.measurement.driven
    made = plain_figure("time (ms)", "voltage (V)" if driven else "motion (µm)", x_range=x_range)
    command = made.line("time", "voltage", source=sources.lines, color=GREEN, line_width=1.3)
    if driven:
        made.y_range.renderers = [command]
        made.yaxis.axis_label_text_color = GREEN
        motion = models.DataRange1d()
        made.extra_y_ranges = {"platform": motion}
        axis = models.LinearAxis(y_range_name="platform", axis_label="platform (µm)", axis_label_text_color=BLUE)
        made.add_layout(axis, "right")
        drawn = made.line("time", "platform", source=sources.lines, color=BLUE, line_width=1.3, y_range_name="platform")
        motion.renderers = [drawn]
        plain(made)
    return made


def keyboard_buttons(move: Callable[[float], None], widen: Callable[[float], None]) -> Widget:
    """What moves and widens the stretch enlarged without a mouse: by cycles, and by factors."""

    def button(text: str, act: Callable[[], None]) -> Widget:
        made = pn.widgets.Button(label=text, height=26, margin=(4, 2), css_classes=["small"])
        made.on_click(lambda event: act())
        return made

    return pn.Row(
        pn.pane.HTML("enlarged:", margin=(9, 4, 0, 8)),
        button("◀ cycle", lambda: move(-1.0)),
        button("cycle ▶", lambda: move(1.0)),
        button("closer", lambda: widen(0.5)),
        button("wider", lambda: widen(2.0)),
        margin=0,
    )
