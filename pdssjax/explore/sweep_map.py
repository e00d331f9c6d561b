"""A sweep as points on a map: where each lies, what was found there, and the numbers with which it walks."""

import json
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ..core import display_unit

if TYPE_CHECKING:
    import xarray


class MapAxis(NamedTuple):
    """A coordinate of every point."""

    path: str
    unit: str
    """As shown."""
    scale: float
    """From SI to it."""
    values: Float[np.ndarray, " points"]
    """[SI]"""

    @property
    def label(self) -> str:
        """What the axis of a map says."""
        return f"{self.path} ({self.unit})" if self.unit else self.path


class SweepMap(NamedTuple):
    """The points of a sweep."""

    axes: dict[str, MapAxis]
    """By path, what differs from point to point."""
    metrics: dict[str, tuple[str, Float[np.ndarray, " points"]]]
    """By name: what it is, with the unit shown, and its value at every point in that unit; NaN where it failed."""
    held: dict[str, float]
    """By path, the numbers [SI] that all points share."""
    record: str
    """Whose drive was varied."""

    def numbers(self, point: int) -> dict[str, float]:
        """The numbers [SI] of a point, by path."""
        return self.held | {path: float(axis.values[point]) for path, axis in self.axes.items()}

    def slice_of(self, shown: Sequence[str], point: int) -> Bool[np.ndarray, " points"]:
        """Which points are on the map of the axes `shown` that goes through `point`: all else is as there."""
        others = [axis.values for path, axis in self.axes.items() if path not in shown]
        same = np.ones(next(iter(self.axes.values())).values.size, bool)
        for values in others:
            same &= values == values[point]
        return same


def sweep_map(data: "xarray.Dataset") -> SweepMap:
    """The points of the dataset that `pdssjax.sweep` gives; bands are left out."""
    metrics = [name for name, found in data.data_vars.items() if name != "failure" and "long_name" in found.attrs]
    metrics = [name for name in metrics if not str(name).endswith(("_sd", "_low", "_high", "_straight"))]
    shape = data[metrics[0]].dims
    axes = {}
    for name, coordinate in data.coords.items():
        path = str(coordinate.attrs.get("long_name", name))
        if "units" not in coordinate.attrs or not set(coordinate.dims) <= set(shape):
            continue
        spread = coordinate.broadcast_like(data[metrics[0]]).transpose(*shape).values.ravel()
        if np.unique(spread).size > 1 or len(data.coords) == 1:
            axes[path] = _axis(path, str(coordinate.attrs["units"]), spread)
    shared = {path: float(told["value"]) for path, told in json.loads(data.attrs["parameters"]).items()}
    drive = {str(key): float(value) for key, value in data.attrs.items() if str(key).startswith("drive.")}
    alone = _alone(data, axes)
    found = {str(name): _metric(data[name]) for name in metrics}
    return SweepMap(axes, found, shared | drive | alone, str(data.attrs["record"]))


def _alone(data: "xarray.Dataset", axes: dict[str, MapAxis]) -> dict[str, float]:
    """Coordinates that are the same at every point."""
    told = {str(c.attrs.get("long_name", name)): c for name, c in data.coords.items() if "units" in c.attrs}
    return {path: float(c.values.ravel()[0]) for path, c in told.items() if path not in axes}


def _axis(path: str, unit: str, values: Float[np.ndarray, " points"]) -> MapAxis:
    shown, scale = display_unit("" if unit == "1" else unit)
    return MapAxis(path, shown.replace("um", "µm"), scale, values.astype(float))


def _metric(values: "xarray.DataArray") -> tuple[str, Float[np.ndarray, " points"]]:
    unit, scale = display_unit(str(values.attrs.get("units", "1")))
    if values.name == "efficiency":
        unit, scale = "%", 100.0
    says = str(values.attrs["long_name"]).replace(" (3.1)", "")
    label = says if unit in ("", "1") else f"{says} ({unit.replace('um', 'µm')})"
    return label, scale * values.values.ravel().astype(float)


class Tiles(NamedTuple):
    """From where to where the tiles of points reach along an axis: half-way to their neighbours."""

    low: Float[np.ndarray, " points"]
    high: Float[np.ndarray, " points"]
    logarithmic: bool
    """The points lie at equal ratios."""


def tiles_along(values: Float[np.ndarray, " points"]) -> Tiles:
    """The tiles of points at `values` on an axis."""
    places, which = np.unique(values, return_inverse=True)
    if places.size < 2:
        half = abs(float(places[0])) * 0.1 or 1.0
        return Tiles(values - half, values + half, False)
    ratios = bool(
        places.size > 2 and places[0] > 0 and _equal(places[1:] / places[:-1]) and not _equal(np.diff(places))
    )
    at = np.log(places) if ratios else places
    middles = 0.5 * (at[1:] + at[:-1])
    edges = np.concatenate([[2 * at[0] - middles[0]], middles, [2 * at[-1] - middles[-1]]])
    edges = np.exp(edges) if ratios else edges
    return Tiles(edges[:-1][which.ravel()], edges[1:][which.ravel()], ratios)


def ticks_along(values: Float[np.ndarray, " points"]) -> list[float]:
    """Where a logarithmic axis over `values` has ticks: 1, 2 and 5 of a decade; of more than two decades each one."""
    low, high = float(np.min(values)), float(np.max(values))
    begins = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    each = (1, 2, 5) if high <= 100.0 * low else (1,)
    ticks = [float(f"{number}e{decade}") for decade in begins for number in each]
    return [tick for tick in ticks if low <= tick <= high]


def _equal(numbers: Float[np.ndarray, " n"]) -> bool:
    return bool(np.ptp(numbers) < 1e-6 * abs(float(numbers[0])))


def is_grid(data: SweepMap, shown: Sequence[str]) -> bool:
    """Whether the points lie on a grid of the axes `shown`, or are a sample."""
    counts = [np.unique(data.axes[path].values).size for path in shown]
    return math.prod(counts) <= next(iter(data.axes.values())).values.size
