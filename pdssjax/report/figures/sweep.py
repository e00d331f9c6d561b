"""Maps of a sweep: one panel a metric, over one or two axes."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from jaxtyping import Float
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...core import InputError, display_unit
from ...sweeps import ALONG, DEAD, GRAZING
from ._axis_scale import scale_axes
from ._dead_zone import BARE, bare_key, border_key, draw_border, explain, has_border
from ._style import STYLE, VERMILION

if TYPE_CHECKING:
    import xarray

PANELS = ("speed", "net_step", "efficiency", "back_slip")


def sweep_figure(data: "xarray.Dataset") -> Figure:
    """Speed, net step, efficiency and back-slip of a `sweep`: lines over one axis, maps over the first two.

    Further axes and those of one value are held at their middle, as the title says; a list or sample is shown by its
    points.  On a map a red line is the border of the dead zone, where the step efficiency is `DEAD`, and points that
    failed are grey.

    **Raises:** `InputError` for a single point, which has no axis.
    """
    every = [str(name) for name in data.sizes]
    if not every:
        raise InputError("sweep: found a single point, expected an axis to draw its metrics over.")
    names = drawn_over(data, every)
    middle = {name: (data.sizes[name] - 1) // 2 for name in every if name not in names}
    shown = data.isel(middle)
    show = _points if names[0] not in data.coords else _lines if len(names) == 1 else _map
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.4, 5.6), layout="constrained")
        for axes, name in zip(figure.subplots(2, 2).ravel(), PANELS, strict=True):
            show(axes, shown, name, names)
        if show is _map:
            explain(figure, _keys(shown, names))
        held = held_fixed(data, middle)
        # A point with a reversal that grazes has its metrics.
        failed = int(np.isin(data.failure.values, (0, GRAZING), invert=True).sum())
        failures = [f"{failed} of {data.failure.size} points failed"] if failed else []
        title = ", ".join([str(data.attrs["title"]), f"drive of {data.attrs['record']}", *held, *failures])
        figure.suptitle(title, x=0.01, ha="left", fontsize=9.5, wrap=True)
    return figure


def drawn_over(data: "xarray.Dataset", dimensions: Sequence[str]) -> list[str]:
    """Over which of the `dimensions` a figure goes: the first two with several values, or the first where none has."""
    # The dimension of a list or sample has no values of its own.
    along = [name for name in dimensions if name in data.coords] or list(dimensions)
    return [name for name in along if data.sizes[name] > 1][:2] or along[:1]


def held_fixed(data: "xarray.Dataset", middle: Mapping[str, int]) -> list[str]:
    """In words, at what the dimensions are held of which one entry is shown."""
    return [
        f"{data[n].attrs.get('long_name', n)} = {_number(data[n][i])}" if n in data.coords else f"{n} {i}"
        for n, i in middle.items()
    ]


def _lines(axes: Axes, data: "xarray.Dataset", name: str, over: list[str]) -> None:
    (x,) = over
    values, label = shown(data[name])
    places, place = shown(data[x])
    axes.plot(places, values, ".-", color="#0072B2", markersize=4)
    if f"{name}_low" in data:
        low, high = (shown(data[f"{name}_{end}"].rename(name))[0] for end in ("low", "high"))
        axes.fill_between(places, low, high, color="#0072B2", alpha=0.25, linewidth=0)
    scale_axes(axes, x=places)
    axes.set_xlabel(place)
    axes.set_ylabel(label)


def _points(axes: Axes, data: "xarray.Dataset", name: str, over: list[str]) -> None:
    """The points of a list or sample over the first two things that change along it, their colour the metric."""
    changing = [str(c) for c in data.coords if data[c].dims == (over[0],)][:2]
    values, label = shown(data[name])
    places = [shown(data[c]) for c in changing]
    if len(places) == 1:
        ((x, columns),) = places
        axes.plot(x, values, ".", color="#0072B2", markersize=4)
        axes.set_ylabel(label)
    else:
        (x, columns), (y, rows) = places
        image = axes.scatter(x, y, c=values, s=12, cmap="viridis")
        assert axes.figure is not None
        axes.figure.colorbar(image, ax=axes, label=label)
        axes.set_ylabel(rows)
    axes.set_xlabel(columns)


def _map(axes: Axes, data: "xarray.Dataset", name: str, over: list[str]) -> None:
    (y, rows), (x, columns) = ((shown(data[n])) for n in over)
    values, label = shown(data[name].transpose(*over))
    # Where a load wins the net step is backward: there zero is the middle of the colours.
    known = values[np.isfinite(values)]
    top = float(np.abs(known).max(initial=0.0))
    signed = known.min(initial=0.0) < 0 < known.max(initial=0.0)
    colours: dict[str, Any] = {"cmap": "RdBu_r", "vmin": -top, "vmax": top} if signed else {"cmap": "viridis"}
    axes.set_facecolor(BARE)
    image = axes.pcolormesh(x, y, values, shading="nearest", rasterized=True, **colours)
    assert axes.figure is not None
    axes.figure.colorbar(image, ax=axes, label=label)
    _lines_of_a_map(axes, data, x, y, values, over)
    scale_axes(axes, x=x, y=y)
    axes.set_xlabel(columns)
    axes.set_ylabel(rows)


def _lines_of_a_map(
    axes: Axes,
    data: "xarray.Dataset",
    x: Float[np.ndarray, " columns"],
    y: Float[np.ndarray, " rows"],
    values: Float[np.ndarray, "rows columns"],
    over: list[str],
) -> None:
    """Contours of a metric, and in red the border of the dead zone, within which hardly anything is gained."""
    if min(values.shape) < 3:
        return
    if _varies(values):
        lines = axes.contour(x, y, values, levels=6, colors="k", linewidths=0.4, alpha=0.6)
        axes.clabel(lines, fontsize=6, fmt="%g", inline_spacing=2)
    draw_border(axes, x, y, _dead(data, over), VERMILION)


def _dead(data: "xarray.Dataset", over: list[str]) -> Float[np.ndarray, "rows columns"]:
    """Below zero in the dead zone, whichever way it moves."""
    return np.abs(data["efficiency"].transpose(*over).values) - DEAD


def _keys(data: "xarray.Dataset", over: list[str]) -> list[Artist]:
    """What the legend of maps explains: only what is there."""
    dead, keys = _dead(data, over), []
    if min(dead.shape) > 2 and has_border(dead):
        keys.append(border_key(VERMILION, f"border of the dead zone (step efficiency of {100 * DEAD:g} %, either way)"))
    if not all(bool(data[name].notnull().all()) for name in PANELS):
        keys.append(bare_key("failed"))
    return keys


def _varies(values: Float[np.ndarray, "..."]) -> bool:
    """Whether there is more than rounding to draw contours of."""
    known = values[np.isfinite(values)]
    return known.size > 0 and float(np.ptp(known)) > 1e-9 * float(np.abs(known).max())


def shown(values: "xarray.DataArray") -> tuple[Float[np.ndarray, "..."], str]:
    """Numbers in display units, and what they are called."""
    unit, scale = display_unit(values.attrs["units"])
    if values.name == "efficiency":
        unit, scale = "%", 100.0
    name = values.attrs["long_name"]
    return scale * values.values, name if unit in ("", "1") else f"{name} ({unit.replace('um', 'µm')})"


def _number(value: "xarray.DataArray") -> str:
    if value.name == ALONG:
        return "forward" if float(value) > 0 else "backward"
    unit, scale = display_unit(value.attrs["units"])
    return f"{float(value) * scale:.4g} {'' if unit == '1' else unit}".rstrip()
