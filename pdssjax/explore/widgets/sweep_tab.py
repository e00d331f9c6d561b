"""The tab of a sweep: a map, and the motion at the point clicked in it."""

import html
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import panel as pn
from bokeh.palettes import Viridis256

from ...core import MICROMETRES, InputError
from ..background_job import BackgroundJob
from ..settings import Settings
from ..sweep_map import PointMotion, PointSimulation, SweepMap, is_grid, small_map, sweep_map, ticks_along, tiles_along
from ..workbench import Workbench
from .page_thread import PageThread
from .style import (
    BLUE,
    GREEN,
    GREY,
    MILLISECONDS,
    VERMILION,
    Model,
    Widget,
    button,
    models,
    pane,
    plain_figure,
    plain_legend,
    second_axis,
)

if TYPE_CHECKING:
    import xarray

_NOTHING = (
    "<p>No sweep yet. <b>Make a small map</b> sweeps voltage and frequency around those of the record shown, or of the "
    "first one with a periodic drive and an end-effector, at the numbers of the sliders; "
    "<code>pdssjax explore STUDY --sweep DIR</code> shows one that <code>pdssjax sweep</code> made.</p>"
)


class SweepTab:
    """A map to the left, and the motion at the chosen point to the right."""

    def __init__(self, chosen: Callable[[int], None], make: Callable[[], None], cancel: Callable[[], None]):
        self._chosen, self._points = chosen, np.zeros(0, int)
        self._map: SweepMap | None = None
        self._quiet = False
        self.make = button("Make a small map", make, "make-map", margin=(4, 4))
        self.stop = button("Cancel", cancel, "stop-map", margin=(4, 4), disabled=True)
        self.message = pn.pane.HTML("", margin=(8, 8), css_classes=["map-said"])
        self._selects = {
            name: pn.widgets.Select(label=name, options=[], width=200, margin=(0, 8), css_classes=[f"map-{name}"])
            for name in ("metric", "across", "up")
        }
        self._count = 0
        self._point = pn.widgets.IntInput(label="point", value=0, width=90, margin=(0, 8), css_classes=["map-point"])
        for select in self._selects.values():
            select.param.watch(lambda event: self._draw(), "value")
        self._point.param.watch(lambda event: self._choose(), "value")
        self._body = pn.Column(pn.pane.HTML(_NOTHING, margin=12), sizing_mode="stretch_both", margin=0)
        top = pn.Row(self.make, self.stop, self.message, margin=0)
        self.view = pn.Column(top, self._body, sizing_mode="stretch_both", margin=0)
        self._motion_source = models.ColumnDataSource({"time": [], "effector": [], "platform": [], "voltage": []})
        self._motion_figure = _motion_plot(self._motion_source)
        self._summary = pn.pane.HTML("", margin=(0, 8), css_classes=["point-told"])

    def show(self, found: SweepMap) -> None:
        """Show a sweep, with its middle point chosen."""
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
        self._count = next(iter(found.axes.values())).values.size
        self._point.value = self._count // 2
        self._quiet = False
        self._draw()
        self._chosen(self._number())

    def show_motion(self, numbers: dict[str, float], motion: PointMotion) -> None:
        """Show the motion at the chosen point."""
        self._motion_source.data = {
            "time": MILLISECONDS * motion.time,
            "effector": MICROMETRES * motion.effector,
            "platform": MICROMETRES * motion.platform,
            "voltage": motion.voltage,
        }
        assert self._map is not None
        axes, point = self._map.axes.items(), self._number()
        parts = [f"{path}: {numbers[path] * axis.scale:.4g} {axis.unit}".rstrip() for path, axis in axes]
        for label, values in self._map.metrics.values():
            # Of a label such as "speed (µm/s)".
            unit = f" {label.rpartition('(')[2].rstrip(')')}" if label.endswith(")") else ""
            parts.append(f"{label.partition(' (')[0].partition(';')[0]}: {values[point]:.4g}{unit}")
        message = f"; {motion.message}" if motion.message else ""
        self._summary.object = f"<b>point {point}</b>: {', '.join(parts)}{message}"

    def _number(self) -> int:
        """The number of the chosen point."""
        return int(self._point.value or 0)

    def _choose(self) -> None:
        if self._quiet or self._map is None:
            return
        # Without limits of the widget, which would hide a number beyond them, the nearest point is taken here.
        nearest = min(max(self._number(), 0), self._count - 1)
        if self._point.value != nearest:
            self._point.value = nearest  # calls this method again
            return
        self._draw()
        self._chosen(nearest)

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
        source, plot = _map_plot(self._map, shown, metric, self._points, point, grid)
        source.selected.on_change("indices", lambda attr, old, new: self._clicked(list(new)))
        controls = pn.Row(*self._selects.values(), self._point, margin=0)
        plots = pn.Row(
            pane(plot, 1.1),
            pane(self._motion_figure),
            sizing_mode="stretch_both",
            margin=0,
            styles={"flex": "1 1 0", "min-height": "0"},
            css_classes=["map"],
        )
        self._body.objects = [controls, plots, self._summary]


def _map_plot(
    found: SweepMap, shown: list[str], metric: str, points: np.ndarray, point: int, grid: bool
) -> tuple[Model, Model]:
    """The source whose selection is the clicked point, and the map."""
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
    plot = plain_figure(
        labels[0], labels[1], x_axis_type=kinds[0], y_axis_type=kinds[1], tools="tap,hover",
        title=f"{found.record}: {label}; click a point",
        tooltips=[(labels[0], "@x"), (labels[1], "@y"), (label, "@value")],
    )  # fmt: skip
    for axis, tile, ratio in zip((plot.xaxis, plot.yaxis), tiles, ratios, strict=True):
        if ratio:
            # Bokeh's ticks are equidistant over less than two decades: 50 and 100 alone from 5 to 80.
            axis.ticker, axis.formatter = ticks_along(np.concatenate(tile[:2])), models.BasicTickFormatter()
    source = models.ColumnDataSource(edges)
    known = values[points][np.isfinite(values[points])]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    high = high if high > low else low + 1.0
    mapper = models.LinearColorMapper(palette=list(Viridis256), low=low, high=high, nan_color="#dddddd")
    color = {"field": "value", "transform": mapper}
    still = {"nonselection_fill_alpha": 1.0, "selection_fill_alpha": 1.0}
    if flat or not grid:
        plot.scatter("x", "y", size=9, source=source, fill_color=color, line_color=GREY, **still)
    else:
        plot.quad("x0", "x1", "y0", "y1", source=source, fill_color=color, line_color=None, **still)
    here = np.flatnonzero(points == point)
    plot.scatter(
        edges["x"][here],
        edges["y"][here],
        marker="circle_x",
        size=14,
        fill_color=None,
        line_color=VERMILION,
        line_width=2,
    )
    plot.grid.grid_line_color = None
    if not flat:
        plot.add_layout(
            models.ColorBar(color_mapper=mapper, width=10, label_standoff=4, major_label_text_font_size="10px"), "right"
        )
    return source, plot


def _motion_plot(source: Model) -> Model:
    plot = plain_figure("time (ms)", "displacement (µm)", title="the motion at this point, from rest")
    lines = [
        plot.line("time", "platform", source=source, color=BLUE, line_width=1, legend_label="platform"),
        plot.line("time", "effector", source=source, color=VERMILION, line_width=1.6, legend_label="end-effector"),
    ]
    plot.y_range.renderers = lines
    second_axis(plot, source, "voltage", "voltage (V)", GREEN, alpha=0.6, legend_label="voltage")
    plain_legend(plot, "top_left")
    return plot


class SweepPage:
    """The tab of a sweep with its jobs: a small map, and the motion at a point."""

    def __init__(self, bench: Workbench, here: Callable[[], Settings], chosen: Callable[[], str], thread: PageThread):
        """`here` returns the settings of the page, `chosen` the name of its record."""
        self._bench, self._here, self._chosen, self._thread = bench, here, chosen, thread
        self._tab = SweepTab(self._choose, self._make, self._cancel)
        self._map: SweepMap | None = None
        self._simulation: PointSimulation | None = None
        self._job: BackgroundJob[xarray.Dataset] | None = None
        self._motion_job: BackgroundJob[PointMotion] | None = None
        self._wanted: int | None = None
        if bench.sweep is not None:
            self._show(bench.sweep)

    @property
    def view(self) -> Widget:
        """The tab."""
        return self._tab.view

    def _show(self, data: "xarray.Dataset") -> None:
        try:
            self._map = sweep_map(data)
            self._simulation = PointSimulation(self._bench.study, self._map.record)
            if not self._map.axes:
                raise InputError("the sweep has no axis, expected one at least.")
        except (InputError, KeyError) as error:
            self._say(f"The sweep cannot be shown: {error}")
            return
        self._tab.show(self._map)

    def _choose(self, point: int) -> None:
        """Simulate the chosen point; of points chosen during a simulation only the last is simulated."""
        self._wanted = point
        if self._motion_job is None or not self._motion_job.is_running:
            self._simulate_wanted()

    def _simulate_wanted(self) -> None:
        point, found, simulation = self._wanted, self._map, self._simulation
        if point is None or found is None or simulation is None:
            return
        self._wanted = None
        numbers = found.numbers(point)
        self._motion_job = self._thread.start(
            lambda report: simulation.motion(numbers), lambda motion, error: self._simulated(numbers, motion, error)
        )

    def _simulated(self, numbers: dict[str, float], motion: PointMotion | None, error: BaseException | None) -> None:
        self._motion_job = None
        if motion is None:
            self._say(f"The point cannot be simulated: {error}")
        else:
            self._tab.show_motion(numbers, motion)
        self._simulate_wanted()

    def _make(self) -> None:
        settings, chosen = self._here(), self._chosen()
        self._tab.make.disabled, self._tab.stop.disabled = True, False
        work = lambda report: small_map(self._bench.study, settings, report, chosen)
        self._job = self._thread.start(work, self._made, self._say)

    def _cancel(self) -> None:
        if self._job is not None:
            self._job.cancel()

    def _made(self, data: "xarray.Dataset | None", error: BaseException | None) -> None:
        self._tab.make.disabled, self._tab.stop.disabled = False, True
        if data is not None:
            self._say("")
            self._show(data)
        else:
            self._say("cancelled" if isinstance(error, KeyboardInterrupt) else f"No map: {error}")

    def _say(self, line: str) -> None:
        self._tab.message.object = html.escape(line)
