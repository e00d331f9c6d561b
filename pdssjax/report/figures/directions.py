"""Both directions of a sweep beside each other, and what they differ by."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from jaxtyping import Float
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure

from ...sweeps import DEAD, compared_directions
from ._axis_scale import scale_axes
from ._dead_zone import BARE, bare_key, border_key, draw_border, explain, has_border
from ._style import STYLE
from .sweep import drawn_over, held_fixed, shown

if TYPE_CHECKING:
    import xarray

FORWARD, BACKWARD = "#0072B2", "#D55E00"

_WIDE = 8.0
"""The largest speed by the median above which a map's colours go by the logarithm."""

_ALIKE = 1e-3
"""Colours of the asymmetry reach this far at least: less is rounding."""


def directions_figure(data: "xarray.Dataset") -> Figure:
    """The speeds along the drive, forward and backward, of a `sweep` with both, and their difference by their mean.

    Lines over one axis, maps over the first two; further axes are held at their middle, as the title says.  On a map
    a line is the border of the dead zone of a direction, where the step efficiency is `DEAD`; what moves the wrong way
    or failed is grey.
    """
    others = [str(name) for name in data.sizes if name != "drive_direction"]
    names = drawn_over(data, others)
    middle = {name: (data.sizes[name] - 1) // 2 for name in others if name not in names}
    cut = data.isel(middle)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(9.6, 3.2), layout="constrained")
        axes = figure.subplots(1, 2 if len(names) == 1 else 3)
        (_lines if len(names) == 1 else _maps)(list(axes), cut, names)
        title = ", ".join([str(data.attrs["title"]), f"drive of {data.attrs['record']}", *held_fixed(data, middle)])
        figure.suptitle(title, x=0.01, ha="left", fontsize=9.5, wrap=True)
    return figure


def _lines(axes: list[Axes], data: "xarray.Dataset", names: list[str]) -> None:
    numbers = data[names[0]] if names[0] in data.coords else None
    places, place = shown(numbers) if numbers is not None else (np.arange(data.sizes[names[0]]), names[0])
    speeds, label = shown(_along_the_drive(data).transpose("drive_direction", ...))
    for way, name, colour in ((1.0, "forward", FORWARD), (-1.0, "backward", BACKWARD)):
        row = int(np.argmax(data.drive_direction.values == way))
        axes[0].plot(places, speeds[row], ".-", color=colour, markersize=4, label=name)
    axes[0].set_ylabel(label)
    axes[0].legend()
    axes[1].plot(places, 100.0 * compared_directions(data).asymmetry.values, ".-", color="k", markersize=4)
    axes[1].axhline(0.0, color="k", linewidth=0.6)
    axes[1].set_ylabel("difference (% of the mean)")
    for panel in axes:
        panel.set_xlabel(place)
        panel.set_xlim(axes[0].get_xlim())


def _maps(axes: list[Axes], data: "xarray.Dataset", names: list[str]) -> None:
    (y, rows), (x, columns) = (shown(data[name]) for name in names)
    speeds, label = shown(_along_the_drive(data))
    scale, found = _speed_scale(speeds), {}
    for panel, way, name, colour in zip(axes, (1.0, -1.0), ("forward", "backward"), (FORWARD, BACKWARD), strict=False):
        part = data.sel(drive_direction=way)
        values, _ = shown(_along_the_drive(data).sel(drive_direction=way).transpose(*names))
        values = np.where(values > 0.0, values, np.nan)
        panel.set_facecolor(BARE)
        panel.pcolormesh(x, y, values, shading="nearest", rasterized=True, cmap="viridis", norm=scale)
        panel.set_title(name, color=colour, loc="left")
        found[colour] = part.efficiency.transpose(*names).values - DEAD
        draw_border(panel, x, y, found[colour], "w")
    figure = axes[0].figure
    assert isinstance(figure, Figure)
    figure.colorbar(axes[0].collections[0], ax=axes[:2], label=label)
    axes[2].set_title("what they differ by", loc="left")
    asymmetry = 100.0 * compared_directions(data).asymmetry.transpose(*names).values
    reach = max(float(np.nanmax(np.abs(asymmetry), initial=0.0)), 100.0 * _ALIKE)
    colours: dict[str, Any] = {"cmap": "RdBu", "vmin": -reach, "vmax": reach}
    image = axes[2].pcolormesh(x, y, asymmetry, shading="nearest", rasterized=True, **colours)
    figure.colorbar(image, ax=axes[2], label="difference (% of the mean)")
    for colour, dead in found.items():
        draw_border(axes[2], x, y, dead, colour)
    for panel in axes:
        panel.set_xlabel(columns)
        scale_axes(panel, x=x, y=y)
    axes[0].set_ylabel(rows)
    explain(figure, _keys(found, speeds))


def _keys(found: Mapping[str, Float[np.ndarray, "rows columns"]], values: Float[np.ndarray, "..."]) -> list[Artist]:
    """What the legend of maps explains, only what is there, of speeds along the drive."""
    drawn = [colour for colour, dead in found.items() if has_border(dead)]
    says = {FORWARD: "that of forward", BACKWARD: "that of backward"}
    keys = [border_key("w", f"border of the dead zone (efficiency of {100 * DEAD:g} %)")] if drawn else []
    keys += [border_key(colour, says[colour]) for colour in drawn]
    bare = ["moves the wrong way"] * bool((values <= 0).any()) + ["failed"] * bool(np.isnan(values).any())
    return keys + [bare_key(" or ".join(bare))] * bool(bare)


def _along_the_drive(data: "xarray.Dataset") -> "xarray.DataArray":
    """The speeds, positive where the motion is the drive's."""
    told = data.speed.attrs | {"long_name": "speed along the drive"}
    return (data.speed * data.drive_direction).assign_attrs(told).rename("speed")


def _speed_scale(speeds: Float[np.ndarray, "..."]) -> Normalize:
    """Colours of speeds: by their logarithm where most are small beside the largest."""
    known = speeds[np.isfinite(speeds) & (speeds > 0)]
    top = float(known.max(initial=0.0))
    if known.size and top > _WIDE * float(np.median(known)):
        return LogNorm(1e-4 * top, top, clip=True)
    return Normalize(0.0, top or 1.0)
