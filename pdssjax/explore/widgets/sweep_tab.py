"""The tab of a sweep: a map in which one clicks a point to see its walk."""

from collections.abc import Callable
from typing import Any

import numpy as np
import panel as pn
from bokeh.palettes import Viridis256

from ...core import MICROMETRES
from ..sweep_map import SweepMap, is_grid, ticks_along, tiles_along
from ..sweep_walk import Walk
from .style import BLUE, GREEN, GREY, MILLISECONDS, VERMILION, Model, Widget, models, pane, plain, plain_figure

_NOTHING = (
    "<p>No sweep yet. <b>Make a small map</b> sweeps voltage and frequency about those of the record shown, or of the "
    "first that walks, at the numbers of the sliders; <code>pdssjax explore STUDY --sweep DIR</code> shows one that "
    "<code>pdssjax sweep</code> made.</p>"
)


class SweepTab:
    """A map to the left, the walk at the point chosen to the right."""

    def __init__(self, chosen: Callable[[int], None], make: Callable[[], None], cancel: Callable[[], None]):
        self._chosen, self._points = chosen, np.zeros(0, int)
        self._map: SweepMap | None = None
        self._quiet = False
        self.make = pn.widgets.Button(label="Make a small map", height=28, margin=(4, 4), css_classes=["make-map"])
        self.make.on_click(lambda event: make())
        self.stop = pn.widgets.Button(label="Cancel", height=28, margin=(4, 4), disabled=True, css_classes=["stop-map"])
        self.stop.on_click(lambda event: cancel())
        self.said = pn.pane.HTML("", margin=(8, 8), css_classes=["map-said"])
        self._selects = {name: _select(name) for name in ("metric", "across", "up")}
        self._count = 0
        self._point = pn.widgets.IntInput(
            label="point", start=0, value=0, width=90, margin=(0, 8), css_classes=["map-point"]
        )
        for select in self._selects.values():
            select.param.watch(lambda event: self._draw(), "value")
        self._point.param.watch(lambda event: self._choose(), "value")
        self._body = pn.Column(pn.pane.HTML(_NOTHING, margin=12), sizing_mode="stretch_both", margin=0)
        top = pn.Row(self.make, self.stop, self.said, margin=0)
        self.view = pn.Column(top, self._body, sizing_mode="stretch_both", margin=0)
        self._walk_source = models.ColumnDataSource({"time": [], "effector": [], "platform": [], "voltage": []})
        self._walk_figure = _walk_plot(self._walk_source)
        self._told = pn.pane.HTML("", margin=(0, 8), css_classes=["point-told"])

    def show(self, found: SweepMap) -> None:
        """Shows a sweep; its middle point is chosen."""
        self._quiet, self._map = True, found
        paths = list(found.axes)
        options = {
            "metric": {label: name for name, (label, _) in found.metrics.items()},
            "across": {path: path for path in paths},
            "up": {path: path for path in paths[1:]} | ({paths[0]: paths[0]} if len(paths) > 1 else {"-": ""}),
        }
        for name, select in self._selects.items():
            select.options = options[name]
            select.value = next(iter(options[name].values()))
        if "speed" in found.metrics:
            self._selects["metric"].value = "speed"
        count = next(iter(found.axes.values())).values.size
        self._count = count
        self._point.end, self._point.value = count - 1, count // 2
        self._quiet = False
        self._draw()
        self._chosen(self._number())

    def show_walk(self, numbers: dict[str, float], motion: Walk) -> None:
        """Shows how the point walks that is chosen."""
        self._walk_source.data = {
            "time": MILLISECONDS * motion.time,
            "effector": MICROMETRES * motion.effector,
            "platform": MICROMETRES * motion.platform,
            "voltage": motion.voltage,
        }
        assert self._map is not None
        said = [_said(self._map, path, numbers[path]) for path in self._map.axes]
        point = self._number()
        said += [
            f"{label.partition(' (')[0].partition(';')[0]}: {values[point]:.4g}{_unit(label)}"
            for label, values in self._map.metrics.values()
        ]
        self._told.object = (
            f"<b>point {point}</b>: " + ", ".join(said) + (f"; {motion.message}" if motion.message else "")
        )

    def _number(self) -> int:
        """The point that is chosen."""
        return int(self._point.value or 0)

    def _choose(self) -> None:
        if not self._quiet and self._map is not None:
            self._draw()
            self._chosen(self._number())

    def _clicked(self, indices: list[int]) -> None:
        if indices:
            self._point.value = int(self._points[indices[0]])

    def _draw(self) -> None:
        if self._quiet or self._map is None:
            return
        across, up, metric = (self._selects[name].value for name in ("across", "up", "metric"))
        shown = [across] if up in ("", across) else [across, up]
        point = self._number()
        grid = is_grid(self._map, shown)
        self._points = np.flatnonzero(self._map.slice_of(shown, point)) if grid else np.arange(self._count)
        source, made = _map_plot(self._map, shown, metric, self._points, point, grid)
        source.selected.on_change("indices", lambda attr, old, new: self._clicked(list(new)))
        controls = pn.Row(*self._selects.values(), self._point, margin=0)
        plots = pn.Row(
            pane(made, 1.1),
            pane(self._walk_figure),
            sizing_mode="stretch_both",
            margin=0,
            styles={"flex": "1 1 0", "min-height": "0"},
            css_classes=["map"],
        )
        self._body.objects = [controls, plots, self._told]


def _select(name: str) -> Widget:
    return pn.widgets.Select(label=name, options=[], width=200, margin=(0, 8), css_classes=[f"map-{name}"])


def _unit(label: str) -> str:
    """The unit at the end of a label, "speed (µm/s)"."""
    return f" {label.rpartition('(')[2].rstrip(')')}" if label.endswith(")") else ""


def _said(found: SweepMap, path: str, number: float) -> str:
    axis = found.axes[path]
    return f"{path}: {number * axis.scale:.4g} {axis.unit}".rstrip()


def _map_plot(
    found: SweepMap, shown: list[str], metric: str, points: np.ndarray, point: int, grid: bool
) -> tuple[Model, Model]:
    """The map, and the source whose selection tells what was clicked."""
    label, values = found.metrics[metric]
    axes = [found.axes[path] for path in shown]
    places = [axis.scale * axis.values[points] for axis in axes]
    flat = len(shown) == 1
    places += [values[points]] if flat else []
    tiles = [tiles_along(p) for p in places]
    ratios = [tile.logarithmic and grid and not (flat and i) for i, tile in enumerate(tiles)]
    kinds = ["log" if ratio else "linear" for ratio in ratios]
    labels = [axis.label for axis in axes] + ([label] if flat else [])
    edges: dict[str, Any] = {"value": values[points], "x": places[0], "y": places[1]}
    for name, tile in zip("xy", tiles, strict=True):
        edges[f"{name}0"], edges[f"{name}1"] = tile.low, tile.high
    made = plain_figure(
        labels[0], labels[1], x_axis_type=kinds[0], y_axis_type=kinds[1], tools="tap,hover",
        title=f"{found.record}: {label}; click a point",
        tooltips=[(labels[0], "@x"), (labels[1], "@y"), (label, "@value")],
    )  # fmt: skip
    for axis, tile, ratio in zip((made.xaxis, made.yaxis), tiles, ratios, strict=True):
        if ratio:
            # Bokeh's own lie at equal distances over less than two decades: 50 and 100 alone from 5 to 80.
            axis.ticker, axis.formatter = ticks_along(np.concatenate(tile[:2])), models.BasicTickFormatter()
    source = models.ColumnDataSource(edges)
    mapper = _mapper(values[points])
    color = {"field": "value", "transform": mapper}
    still = {"nonselection_fill_alpha": 1.0, "selection_fill_alpha": 1.0}
    if flat or not grid:
        made.scatter("x", "y", size=9, source=source, fill_color=color, line_color=GREY, **still)
    else:
        made.quad("x0", "x1", "y0", "y1", source=source, fill_color=color, line_color=None, **still)
    here = np.flatnonzero(points == point)
    made.scatter(
        edges["x"][here],
        edges["y"][here],
        marker="circle_x",
        size=14,
        fill_color=None,
        line_color=VERMILION,
        line_width=2,
    )
    made.grid.grid_line_color = None
    if not flat:
        made.add_layout(
            models.ColorBar(color_mapper=mapper, width=10, label_standoff=4, major_label_text_font_size="10px"), "right"
        )
    return source, made


def _mapper(values: np.ndarray) -> Model:
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    return models.LinearColorMapper(
        palette=list(Viridis256), low=low, high=high if high > low else low + 1.0, nan_color="#dddddd"
    )


def _walk_plot(source: Model) -> Model:
    made = plain_figure("time (ms)", "displacement (µm)", title="the walk at this point, from rest")
    lines = [
        made.line("time", "platform", source=source, color=BLUE, line_width=1, legend_label="platform"),
        made.line("time", "effector", source=source, color=VERMILION, line_width=1.6, legend_label="end-effector"),
    ]
    made.y_range.renderers = lines
    volts = models.DataRange1d()
    made.extra_y_ranges = {"voltage": volts}
    made.add_layout(models.LinearAxis(y_range_name="voltage", axis_label="voltage (V)"), "right")
    drawn = made.line(
        "time", "voltage", source=source, color=GREEN, alpha=0.6, y_range_name="voltage", legend_label="voltage"
    )
    volts.renderers = [drawn]
    plain(made)
    made.legend.location = "top_left"
    made.legend.background_fill_alpha = 0.6
    made.legend.border_line_color = None
    made.legend.label_text_font_size = "10px"
    return made
