"""Maps of a sweep: one panel a metric, over one or two axes."""

from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...core import display_unit
from ._style import STYLE

if TYPE_CHECKING:
    import xarray

PANELS = ("speed", "net_step", "efficiency", "back_slip")


def sweep_figure(data: "xarray.Dataset") -> Figure:
    """Speed, net step, efficiency and back-slip of a `sweep`: lines over one axis, maps over the first two.

    Further axes are held at their middle, as the title says.  Points that failed are left white.
    """
    names = [str(name) for name in data.sizes]
    middle = {name: data.sizes[name] // 2 for name in names[2:]}
    shown = data.isel(middle)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.4, 5.6), layout="constrained")
        for axes, name in zip(figure.subplots(2, 2).ravel(), PANELS, strict=True):
            (_lines if len(names) == 1 else _map)(axes, shown, name, names[:2])
        held = [f"{n} = {_number(data[n][i])}" for n, i in middle.items()]
        failed = int((data.failure.values != 0).sum())
        failures = [f"{failed} of {data.failure.size} points failed"] if failed else []
        title = ", ".join([str(data.attrs["title"]), f"drive of {data.attrs['record']}", *held, *failures])
        figure.suptitle(title, x=0.01, ha="left", fontsize=9.5)
    return figure


def _lines(axes: Axes, data: "xarray.Dataset", name: str, over: list[str]) -> None:
    (x,) = over
    values, label = _shown(data[name])
    places, place = _shown(data[x])
    axes.plot(places, values, ".-", color="#0072B2", markersize=4)
    axes.set_xlabel(place)
    axes.set_ylabel(label)


def _map(axes: Axes, data: "xarray.Dataset", name: str, over: list[str]) -> None:
    (y, rows), (x, columns) = ((_shown(data[n])) for n in over)
    values, label = _shown(data[name].transpose(*over))
    # Where a load wins the net step is backward: there zero is the middle of the colours.
    known = values[np.isfinite(values)]
    top = float(np.abs(known).max(initial=0.0))
    signed = known.min(initial=0.0) < 0 < known.max(initial=0.0)
    colours: dict[str, Any] = {"cmap": "RdBu_r", "vmin": -top, "vmax": top} if signed else {"cmap": "viridis"}
    image = axes.pcolormesh(x, y, values, shading="nearest", rasterized=True, **colours)
    assert axes.figure is not None
    axes.figure.colorbar(image, ax=axes, label=label)
    axes.set_xlabel(columns)
    axes.set_ylabel(rows)


def _shown(values: "xarray.DataArray") -> tuple[Float[np.ndarray, "..."], str]:
    """Numbers in display units, and what they are called."""
    unit, scale = display_unit(values.attrs["units"])
    if values.name == "efficiency":
        unit, scale = "%", 100.0
    name = values.attrs["long_name"]
    return scale * values.values, name if unit in ("", "1") else f"{name} ({unit.replace('um', 'µm')})"


def _number(value: "xarray.DataArray") -> str:
    unit, scale = display_unit(value.attrs["units"])
    return f"{float(value) * scale:.4g} {'' if unit == '1' else unit}".rstrip()
