"""Figures of sweeps: maps and lines of metrics, both directions beside each other, the border that was looked for."""

import itertools
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from jaxtyping import Float
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke

from ...core import InputError, display_unit, with_micro_sign
from ...sweeps import ALONG, DEAD, GRAZING, compared_directions
from ..text.sweep import direction_word
from ._style import BLUE, VERMILION, in_equal_ratios, scale_axes, styled_figure

if TYPE_CHECKING:
    import xarray


_WIDTH = 1.2

_BARE = "0.85"
"""Colour of a cell of a map that has no value to show."""


def _has_border(dead: Float[np.ndarray, "rows columns"]) -> bool:
    """Whether `dead`, below zero in the dead zone, changes its sign on a map."""
    return min(dead.shape) > 1 and bool(np.nanmin(dead, initial=np.inf) < 0 < np.nanmax(dead, initial=-np.inf))


def _draw_border(
    axes: Axes,
    x: Float[np.ndarray, " columns"],
    y: Float[np.ndarray, " rows"],
    dead: Float[np.ndarray, "rows columns"],
    colour: str,
) -> None:
    """Draw the border of the dead zone, where there is one."""
    if _has_border(dead):
        axes.contour(x, y, dead, levels=[0.0], colors=colour, linewidths=_WIDTH).set(path_effects=_edge_effects(colour))


def _border_key(colour: str, says: str) -> Artist:
    """The border's entry in a legend."""
    return Line2D([], [], color=colour, linewidth=_WIDTH, path_effects=_edge_effects(colour), label=says)


def _explain(figure: Figure, keys: Sequence[Artist]) -> None:
    """Put a legend with the `keys` below all panels."""
    if keys:
        figure.legend(handles=list(keys), loc="outside lower center", ncols=len(keys))


def _edge_effects(colour: str) -> list[withStroke]:
    """Edge for white lines, which would not show on a bright map or on paper."""
    return [withStroke(linewidth=_WIDTH + 1.2, foreground="0.2")] if colour == "w" else []


_PANELS = ("speed", "net_step", "efficiency", "back_slip")


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
    names, shown, held = _cut(data, every)
    show = _points if names[0] not in data.coords else _lines if len(names) == 1 else _map
    with styled_figure(7.4, 5.6) as figure:
        for axes, name in zip(figure.subplots(2, 2).ravel(), _PANELS, strict=True):
            show(axes, shown, name, names)
        if show is _map:
            dead, keys = _dead(shown, names), list[Artist]()
            if min(dead.shape) > 2 and _has_border(dead):
                says = f"border of the dead zone (step efficiency of {100 * DEAD:g} %, either way)"
                keys.append(_border_key(VERMILION, says))
            if not all(bool(shown[name].notnull().all()) for name in _PANELS):
                keys.append(Patch(facecolor=_BARE, label="failed"))
            _explain(figure, keys)
        # A point with a reversal that grazes has its metrics.
        failed = int(np.isin(data.failure.values, (0, GRAZING), invert=True).sum())
        failures = [f"{failed} of {data.failure.size} points failed"] if failed else []
        _caption(figure, data, [*held, *failures])
    return figure


def _cut(data: "xarray.Dataset", dimensions: Sequence[str]) -> tuple[list[str], "xarray.Dataset", list[str]]:
    """The axes of a figure over the `dimensions`, the data at the middle of the others, and which that is in words."""
    # The first two with several values, or the first where none has; that of a list or sample has no values of its own.
    along = [name for name in dimensions if name in data.coords] or list(dimensions)
    names = [name for name in along if data.sizes[name] > 1][:2] or along[:1]
    middle = {name: (data.sizes[name] - 1) // 2 for name in dimensions if name not in names}
    title = lambda name: data[name].attrs.get("long_name", name)
    says = lambda name, i: f"{title(name)} = {_number(data[name][i])}" if name in data.coords else f"{name} {i}"
    held = list(itertools.starmap(says, middle.items()))
    return names, data.isel(middle), held


def _caption(figure: Figure, data: "xarray.Dataset", further: Sequence[str]) -> None:
    """Put the title of a sweep, its record and what is said `further` above all panels."""
    said = ", ".join([str(data.attrs["title"]), f"drive of {data.attrs['record']}", *further])
    figure.suptitle(said, x=0.01, ha="left", fontsize=9.5, wrap=True)


def _lines(axes: Axes, data: "xarray.Dataset", name: str, over: list[str]) -> None:
    (x,) = over
    values, label = shown(data[name])
    places, place = shown(data[x])
    axes.plot(places, values, ".-", color=BLUE, markersize=4)
    if f"{name}_low" in data:
        low, high = (shown(data[f"{name}_{end}"].rename(name))[0] for end in ("low", "high"))
        axes.fill_between(places, low, high, color=BLUE, alpha=0.25, linewidth=0)
    scale_axes(axes, x=places)
    axes.set_xlabel(place)
    axes.set_ylabel(label)


def _points(axes: Axes, data: "xarray.Dataset", name: str, over: list[str]) -> None:
    """The points of a list or sample over the first two things that change along it, their colour the metric."""
    changing = [str(c) for c in data.coords if data[c].dims == (over[0],)][:2]
    values, label = shown(data[name])
    x, columns = shown(data[changing[0]])
    if len(changing) == 1:
        axes.plot(x, values, ".", color=BLUE, markersize=4)
        axes.set_ylabel(label)
    else:
        y, rows = shown(data[changing[1]])
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
    axes.set_facecolor(_BARE)
    image = axes.pcolormesh(x, y, values, shading="nearest", rasterized=True, **colours)
    assert axes.figure is not None
    axes.figure.colorbar(image, ax=axes, label=label)
    if min(values.shape) > 2:
        if known.size and np.ptp(known) > 1e-9 * top:  # more than rounding
            lines = axes.contour(x, y, values, levels=6, colors="k", linewidths=0.4, alpha=0.6)
            axes.clabel(lines, fontsize=6, fmt="%g", inline_spacing=2)
        _draw_border(axes, x, y, _dead(data, over), VERMILION)
    scale_axes(axes, x=x, y=y)
    axes.set_xlabel(columns)
    axes.set_ylabel(rows)


def _dead(data: "xarray.Dataset", over: list[str]) -> Float[np.ndarray, "rows columns"]:
    """Size of the step efficiency less `DEAD`: negative in the dead zone, whichever way it moves."""
    return np.abs(data["efficiency"].transpose(*over).values) - DEAD


def shown(values: "xarray.DataArray") -> tuple[Float[np.ndarray, "..."], str]:
    """Values in display units, and the label of their axis."""
    unit, scale = display_unit(values.attrs["units"])
    if values.name == "efficiency":
        unit, scale = "%", 100.0
    name = values.attrs["long_name"]
    return scale * values.values, name if unit in ("", "1") else f"{name} ({with_micro_sign(unit)})"


def _number(value: "xarray.DataArray") -> str:
    if value.name == ALONG:
        return direction_word(float(value))
    unit, scale = display_unit(value.attrs["units"])
    return f"{float(value) * scale:.4g} {'' if unit == '1' else unit}".rstrip()


_FORWARD, _BACKWARD = BLUE, VERMILION


def directions_figure(data: "xarray.Dataset") -> Figure:
    """The speeds along the drive, forward and backward, of a `sweep` with both, and their difference by their mean.

    Lines over one axis, maps over the first two; further axes are held at their middle, as the title says.  On a map
    a line is the border of the dead zone of a direction, where the step efficiency is `DEAD`; what moves the wrong way
    or failed is grey.
    """
    others = [str(name) for name in data.sizes if name != "drive_direction"]
    names, cut, held = _cut(data, others)
    with styled_figure(9.6, 3.2) as figure:
        axes = figure.subplots(1, 2 if len(names) == 1 else 3)
        (_direction_lines if len(names) == 1 else _direction_maps)(list(axes), cut, names)
        _caption(figure, data, held)
    return figure


def _direction_lines(axes: list[Axes], data: "xarray.Dataset", names: list[str]) -> None:
    numbers = data[names[0]] if names[0] in data.coords else None
    places, place = shown(numbers) if numbers is not None else (np.arange(data.sizes[names[0]]), names[0])
    speeds, label = shown(_along_the_drive(data).transpose("drive_direction", ...))
    for way, colour in ((1.0, _FORWARD), (-1.0, _BACKWARD)):
        row = int(np.argmax(data.drive_direction.values == way))
        axes[0].plot(places, speeds[row], ".-", color=colour, markersize=4, label=direction_word(way))
    axes[0].set_ylabel(label)
    axes[0].legend()
    axes[1].plot(places, 100.0 * compared_directions(data).asymmetry.values, ".-", color="k", markersize=4)
    axes[1].axhline(0.0, color="k", linewidth=0.6)
    axes[1].set_ylabel("difference (% of the mean)")
    for panel in axes:
        panel.set_xlabel(place)
        panel.set_xlim(axes[0].get_xlim())


def _direction_maps(axes: list[Axes], data: "xarray.Dataset", names: list[str]) -> None:
    (y, rows), (x, columns) = (shown(data[name]) for name in names)
    speeds, label = shown(_along_the_drive(data))
    known = speeds[np.isfinite(speeds) & (speeds > 0)]
    top = float(known.max(initial=0.0))
    scale, found = Normalize(0.0, top or 1.0), {}
    if known.size and top > 8.0 * float(np.median(known)):  # most are small beside the largest
        scale = LogNorm(1e-4 * top, top, clip=True)
    for panel, way, colour in zip(axes, (1.0, -1.0), (_FORWARD, _BACKWARD), strict=False):
        part = data.sel(drive_direction=way)
        values, _ = shown(_along_the_drive(data).sel(drive_direction=way).transpose(*names))
        values = np.where(values > 0.0, values, np.nan)
        panel.set_facecolor(_BARE)
        panel.pcolormesh(x, y, values, shading="nearest", rasterized=True, cmap="viridis", norm=scale)
        panel.set_title(direction_word(way), color=colour, loc="left")
        found[colour] = part.efficiency.transpose(*names).values - DEAD
        _draw_border(panel, x, y, found[colour], "w")
    figure = axes[0].figure
    assert isinstance(figure, Figure)
    figure.colorbar(axes[0].collections[0], ax=axes[:2], label=label)
    axes[2].set_title("what they differ by", loc="left")
    asymmetry = 100.0 * compared_directions(data).asymmetry.transpose(*names).values
    reach = max(float(np.nanmax(np.abs(asymmetry), initial=0.0)), 0.1)  # smaller differences are rounding
    colours: dict[str, Any] = {"cmap": "RdBu", "vmin": -reach, "vmax": reach}
    image = axes[2].pcolormesh(x, y, asymmetry, shading="nearest", rasterized=True, **colours)
    figure.colorbar(image, ax=axes[2], label="difference (% of the mean)")
    for colour, dead in found.items():
        _draw_border(axes[2], x, y, dead, colour)
    for panel in axes:
        panel.set_xlabel(columns)
        scale_axes(panel, x=x, y=y)
    axes[0].set_ylabel(rows)
    _explain(figure, _direction_keys(found, speeds))


def _direction_keys(
    found: Mapping[str, Float[np.ndarray, "rows columns"]], values: Float[np.ndarray, "..."]
) -> list[Artist]:
    """What the legend of maps explains, only what is there, of speeds along the drive."""
    drawn = [colour for colour, dead in found.items() if _has_border(dead)]
    says = {_FORWARD: "that of forward", _BACKWARD: "that of backward"}
    keys = [_border_key("w", f"border of the dead zone (efficiency of {100 * DEAD:g} %)")] if drawn else []
    keys += [_border_key(colour, says[colour]) for colour in drawn]
    bare = ["moves the wrong way"] * bool((values <= 0).any()) + ["failed"] * bool(np.isnan(values).any())
    return keys + [Patch(facecolor=_BARE, label=" or ".join(bare))] * bool(bare)


def _along_the_drive(data: "xarray.Dataset") -> "xarray.DataArray":
    """The speeds, positive where the motion is the drive's."""
    attributes = data.speed.attrs | {"long_name": "speed along the drive"}
    return (data.speed * data.drive_direction).assign_attrs(attributes).rename("speed")


def border_figure(data: "xarray.Dataset") -> Figure:
    """The border of a `find_border` over the first axis of its grid, a line for each value of the second.

    Further axes are held at their middle, as the title says.  Where there is no border the line has a gap.
    """
    names, cut, held = _cut(data, [str(name) for name in data.border.dims])
    with styled_figure(5.2, 3.6) as figure:
        axes = figure.subplots()
        _border_lines(axes, cut, names)
        _caption(figure, data, [data.attrs["of"], *held])
    return figure


def _border_lines(axes: Axes, data: "xarray.Dataset", names: list[str]) -> None:
    border, label = shown(data.border)
    axes.set_ylabel(label)
    if not names:
        axes.axhline(float(border), color=BLUE)
        return
    places, place = shown(data[names[0]])
    if len(names) == 1:
        axes.plot(places, border, ".-", color=BLUE, markersize=4)
    else:
        values, what = shown(data[names[1]])
        # Seven at most, the first and the last among them.
        rows = np.unique(np.linspace(0, len(values) - 1, 7).round().astype(int))
        for i, row in enumerate(rows):
            colour = matplotlib.colormaps["viridis"](i / max(len(rows) - 1, 1) * 0.9)
            label = direction_word(float(values[row])) if names[1] == ALONG else f"{values[row]:.4g}"
            axes.plot(places, border[:, row], ".-", color=colour, markersize=4, label=label)
        axes.legend(title=what)
    if in_equal_ratios(places):
        scale_axes(axes, x=places)
    elif len(places) > 1:
        # Where there is no border the axis goes on.
        margin = 0.05 * np.ptp(places)
        axes.set_xlim(places.min() - margin, places.max() + margin)
    axes.set_xlabel(place)
