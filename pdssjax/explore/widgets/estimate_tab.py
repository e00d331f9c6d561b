"""The tab of an estimate: values with errors, correlations, and likelihood profiles if computed."""

import html
import math

import numpy as np
import panel as pn
from bokeh.palettes import RdBu11

from ...core import display_unit, with_micro_sign
from ...report.text import parameter_cells
from ...study import Estimate, FittedParameter, Profile
from .style import BLUE, GREY, TABLE, VERMILION, Model, Widget, models, pane, plain_figure, plain_legend

_NOTHING = (
    "<p>No estimate yet: press <b>Fit from here</b>, or start with "
    "<code>pdssjax explore STUDY --estimate DIR/estimate.json</code>.</p>"
)


class EstimateTab:
    """A table of the parameters, and plots of correlations and profiles."""

    def __init__(self):
        self._text: Widget = pn.pane.HTML(
            _NOTHING,
            stylesheets=[TABLE + "p { white-space: normal; }"],
            sizing_mode="stretch_width",
            margin=(4, 12),
            css_classes=["estimate"],
        )
        # A row that stretches would make the page as wide as all plots side by side.
        styles = {"flex-wrap": "wrap", "width": "calc(100% - 16px)"}
        self._plots: Widget = pn.Row(margin=(0, 8), styles=styles, css_classes=["estimate-plots"])
        self.view: Widget = pn.Column(
            self._text, self._plots, sizing_mode="stretch_both", margin=0, styles={"overflow": "auto"}
        )

    def show(self, estimate: Estimate) -> None:
        """Show an estimate."""
        advice = estimate.error_advice
        errors = [] if advice is None else [f"Errors to believe: {advice.model}. {advice.reason}"]
        paragraphs = [f"<p>{html.escape(text)}</p>" for text in (*errors, estimate.message, *estimate.notes) if text]
        verdict = estimate.verdict if estimate.success else estimate.verdict.upper()
        headline = (
            f"{estimate.title}: {estimate.method} fit, {verdict}; chi-square a degree of freedom "
            f"{estimate.statistics.reduced_chi2:.4g} over {estimate.statistics.samples} samples"
        )
        heads = ["parameter", "unit", "value", "± one standard deviation", "95 % interval", "start", ""]
        rows = _cells("th", heads), *(_cells("td", _row(parameter)) for parameter in estimate.parameters.values())
        table = f"<table>{''.join(f'<tr>{row}</tr>' for row in rows)}</table>"
        self._text.object = f"<p><b>{html.escape(headline)}</b></p>{table}{''.join(paragraphs)}"
        plots = [_correlations(estimate)] if len(estimate.names) > 1 else []
        self._plots.objects = plots + [_profile(p, estimate.parameters[p.path]) for p in estimate.profiles]


def _cells(tag: str, texts: list[str]) -> str:
    sides = ["", "", *[" class=number"] * 4, ""]
    return "".join(f"<{tag}{side}>{html.escape(text)}</{tag}>" for side, text in zip(sides, texts, strict=True))


def _row(parameter: FittedParameter) -> list[str]:
    """The cells of one parameter."""
    cells, known = parameter_cells(parameter), math.isfinite(parameter.standard_error)
    return [
        parameter.path,
        with_micro_sign(cells.unit),
        cells.value,
        f"{cells.error} ({cells.share})" if known else "",
        cells.interval(" to ") if known else "",
        "" if parameter.start is None else cells.start,
        parameter.remark,
    ]


def _correlations(estimate: Estimate) -> Widget:
    """A tile with a number for each pair of parameters."""
    names = [name.partition(".")[2] or name for name in estimate.names]
    if len(set(names)) < len(names):
        names = list(estimate.names)
    pairs = [(i, j) for i in range(len(names)) for j in range(i)]
    values = np.array([estimate.correlation[i, j] for i, j in pairs])
    source = models.ColumnDataSource(
        {
            "x": [names[j] for _, j in pairs],
            "y": [names[i] for i, _ in pairs],
            "value": values,
            "text": [f"{value:.2f}" if np.isfinite(value) else "×" for value in values],
            "ink": ["white" if abs(value) > 0.6 else "black" for value in values],
        }
    )
    plot = plain_figure("", "", x_range=names[:-1], y_range=names[:0:-1], title="Correlations", tools="")
    mapper = models.LinearColorMapper(palette=list(RdBu11), low=-1.0, high=1.0, nan_color="#eeeeee")
    plot.rect("x", "y", 0.96, 0.96, source=source, line_color=None, fill_color={"field": "value", "transform": mapper})
    plot.text(
        "x", "y", "text", source=source, text_color="ink", text_align="center", text_baseline="middle",
        text_font_size="10px",
    )  # fmt: skip
    plot.xaxis.major_label_orientation = 0.8
    plot.grid.grid_line_color = None
    return _sized(plot, 210 + 44 * len(names), max(220, 110 + 26 * len(names)))


def _profile(curve: Profile, parameter: FittedParameter) -> Widget:
    """Chi-square above its minimum against a parameter, with the parabola of the linear model."""
    unit, scale = display_unit(parameter.unit)
    label, title = f"{curve.path} ({with_micro_sign(unit) or '1'})", f"{curve.path}: {curve.verdict}"
    plot = plain_figure(label, "excess of chi-square", title=title, tools="")
    source = models.ColumnDataSource({"value": scale * curve.value, "excess": curve.excess, "linear": curve.linear})
    plot.line("value", "linear", source=source, color=GREY, line_dash="dashed", line_width=1.2, legend_label="linear")
    plot.line("value", "excess", source=source, color=BLUE, line_width=1.5, legend_label="profile")
    plot.add_layout(models.Span(location=curve.threshold, dimension="width", line_color=VERMILION))
    plot.add_layout(models.Span(location=scale * parameter.value, dimension="height", line_color=GREY))
    plot.y_range.update(start=0.0, end=1.55 * curve.threshold)
    plain_legend(plot, "top_center")
    plot.xaxis.ticker.desired_num_ticks = 3
    return _sized(plot, 300, 230)


def _sized(plot: Model, width: int, height: int) -> Widget:
    """A plot of fixed size, since plots on hidden tabs cannot measure their place."""
    return pn.Column(pane(plot), width=width, height=height, margin=4)
