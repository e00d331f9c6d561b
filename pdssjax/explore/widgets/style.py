"""Colours, sizes, style sheets and common widgets of the page; the colours are those of the figures."""

from collections.abc import Callable
from typing import Any, TypeAlias

import bokeh.models
import bokeh.plotting
import panel as pn

GREY, VERMILION, BLUE, GREEN, PURPLE = "#8c8c8c", "#D55E00", "#0072B2", "#009E73", "#CC79A7"
"""Colours of Okabe and Ito, which remain distinct with a colour vision deficiency."""

MILLISECONDS = 1e3
"""Milliseconds in a second, the unit of times on the page."""

Widget: TypeAlias = Any
"""A widget or pane of Panel, whose parameters no type checker can follow."""

Option: TypeAlias = Any
"""A keyword argument of a plot or a pane of Panel and Bokeh, of any type."""

Model: TypeAlias = Any
"""A plot, a range or a source of Bokeh, or their module: the type stubs allow less than Bokeh takes."""

models: Model = bokeh.models
"""The models of Bokeh."""

PAGE = """
body { margin: 0; background: #fff; font-family: "Liberation Sans", Arial, Helvetica, sans-serif; font-size: 13px; }
"""

COLUMN_WIDTH = 384

COMPACT = """
:host { margin: 0 !important; }
.bk-input { height: 24px; min-height: 24px; padding: 0 4px; font-size: 12px; text-align: right; }
.bk-input-group { margin: 0; }
"""
"""Style of fields beside sliders, and of choices."""

LEFT = COMPACT.replace(":host { margin: 0 !important; }", "").replace("right", "left").replace("24px", "28px")
"""Style of fields that hold no number."""

MESSAGE = {"font-size": "12px", "overflow-wrap": "anywhere", "max-height": "66px", "overflow-y": "auto"}
"""Style of a line for the user, which may be long."""

CUT = ".cut { display: block; max-width: 300px; white-space: nowrap; overflow: hidden; text-overflow: ellipsis; }"
"""Style of a name given by the user, which may be long."""

TABLE = """
table { border-collapse: collapse; font-size: 12px; white-space: nowrap; }
th { text-align: left; font-weight: 600; border-bottom: 1px solid #999; padding: 1px 14px 1px 0; }
td { padding: 1px 14px 1px 0; border-bottom: 1px solid #eee; }
td.number, th.number { text-align: right; }
tr.chosen td { font-weight: 600; background: #eaf3fa; }
td.poor { color: #D55E00; }
p { margin: 4px 0; }
"""


def plain_figure(x: str, y: str, **more: Option) -> Model:
    """An empty plot with labelled axes, which fills its place."""
    plot: Model = bokeh.plotting.figure(
        x_axis_label=x,
        y_axis_label=y,
        tools=more.pop("tools", "pan,wheel_zoom,box_zoom,reset"),
        active_scroll=None,
        toolbar_location=more.pop("toolbar_location", None),
        output_backend="canvas",
        sizing_mode="stretch_both",
        min_height=70,
        **more,
    )
    plain(plot)
    return plot


def plain(plot: Model) -> None:
    """Give a plot the look of the page."""
    plot.outline_line_color = None
    plot.min_border = 4
    plot.min_border_right = 10
    for axis in plot.axis:
        axis.axis_label_text_font_style = "normal"
        axis.axis_label_text_font_size = "12px"
        axis.major_label_text_font_size = "11px"
        axis.axis_label_standoff = 3
        axis.minor_tick_line_color = None
        axis.axis_line_color = "#666666"
    plot.grid.grid_line_color = "#ececec"
    plot.title.text_font_size = "12px"
    plot.title.text_font_style = "normal"


def plain_legend(plot: Model, place: str, size: str = "10px") -> None:
    """Give the legend of a plot, at a `place` such as "top_left", the look of the page."""
    plot.legend.location = place
    plot.legend.background_fill_alpha = 0.6
    plot.legend.border_line_color = None
    plot.legend.label_text_font_size = size


def second_axis(plot: Model, source: Model, name: str, label: str, colour: str, **line: Option) -> None:
    """Draw the column `name` of a `source` over "time", against an axis of its own to the right."""
    values = models.DataRange1d()
    plot.extra_y_ranges = {name: values}
    plot.add_layout(models.LinearAxis(y_range_name=name, axis_label=label), "right")
    values.renderers = [plot.line("time", name, source=source, color=colour, y_range_name=name, **line)]
    plain(plot)


def button(label: str, act: Callable[[], None], name: str, height: int = 28, **more: Option) -> Widget:
    """A button that calls `act`; `name` is its class in the style sheet."""
    made = pn.widgets.Button(label=label, height=height, css_classes=[name], **more)
    made.on_click(lambda event: act())
    return made


def pane(plot: Model, flex: float = 1.0, **more: Option) -> Widget:
    """A plot in a pane that takes `flex` parts of the space it shares with its neighbours."""
    styles = {"flex": f"{flex} 1 0", "min-width": "0", "min-height": "0"}
    return pn.pane.Bokeh(plot, sizing_mode="stretch_both", margin=0, styles=styles, **more)


def row(*parts: Widget, flex: float = 1.0) -> Widget:
    """Widgets side by side."""
    return pn.Row(*parts, sizing_mode="stretch_both", margin=0, styles={"flex": f"{flex} 1 0", "min-height": "0"})


def column(*parts: Widget, flex: float = 1.0) -> Widget:
    """Widgets one below the other."""
    styles = {"flex": f"{flex} 1 0", "min-height": "0", "min-width": "0"}
    return pn.Column(*parts, sizing_mode="stretch_both", margin=0, styles=styles)
