"""The coordinates of a sweep's dataset, its plots, and bands about its metrics.

Bands carry the uncertainty of the parameters over to the metrics.  From draws: mean, standard deviation and quantiles.
From sigma points (`SigmaPoints`): to first order, with a flag where the metric is too nonlinear for that.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from ..core import Figure, InputError, Quantity, presenter
from .blocks import GRAZING
from .points import AXIS_STEP, AbstractPoints

if TYPE_CHECKING:
    import xarray


def coordinates_of(
    points: AbstractPoints, declared: Mapping[str, Quantity]
) -> dict[str, tuple[str, Float[np.ndarray, " values"], dict[str, str]]]:
    """By name, the coordinates of the `points` as xarray takes them: dimension, values and attributes."""
    return {
        path.replace(".", "_"): (dimension, values, {"units": declared[path].unit or "1", "long_name": path})
        for path, (dimension, values) in points.coordinates().items()
    }


class SweepAccessor:
    """Methods of a sweep's dataset: `data.pdssjax.plot()`."""

    def __init__(self, data: "xarray.Dataset"):
        self._data = data

    def plot(self) -> Figure:
        """A figure of matplotlib: speed, net step, efficiency and back-slip, as lines or maps.

        **Raises:** `InputError` for a single point.
        """
        return presenter().as_figure(self._data)


def register_plot() -> None:
    """Register the accessor `pdssjax` of `xarray.Dataset`, as `sweep` does, to plot a `sweep.nc`."""
    import xarray

    if not hasattr(xarray.Dataset, "pdssjax"):
        xarray.register_dataset_accessor("pdssjax")(SweepAccessor)


COVERED = 0.95
"""Probability of a band."""

NORMAL = 1.959964
"""Half-width of the band of a normal distribution, in standard deviations."""

MOST_CURVATURE = 0.04
"""Largest share of the variance that first order may miss where it counts as valid."""

_BAND_NAMES = {
    "": "",
    "sd": "standard deviation of",
    "low": "lower end of the 95 % band of",
    "high": "upper end of the 95 % band of",
    "straight": "first order holds for",
}


def with_bands(data: "xarray.Dataset") -> "xarray.Dataset":
    """`data` of a sweep over draws or sigma points without that dimension: each metric with its band.

    **Arguments:** `data` has the dimension "draw" of `CovarianceDraws` or "sigma_point" of `SigmaPoints`.

    **Returns:** for every metric its value (the mean of the draws, or that at the estimate), `METRIC_sd`, `METRIC_low`
    and `METRIC_high`; `failure`, of a point that failed; and to first order `METRIC_straight`, 1 where that holds.  A
    draw that failed is left out; a sigma point that failed leaves no band.

    **Raises:** `ValueError` for a dataset with neither dimension.
    """
    dimension = next((name for name in ("draw", "sigma_point") if name in data.dims), None)
    if dimension is None:
        raise ValueError(f"Expected a sweep over draws or sigma points, but its dimensions are {tuple(data.dims)}.")
    bands = _bands_of_draws if dimension == "draw" else _bands_of_sigma_points
    kept = data.drop_vars([name for name in data.coords if dimension in data[name].dims])
    found = kept.drop_vars(list(kept.data_vars))
    # A point with a reversal that grazes has its metrics, so that any other failure counts more.
    failed = kept.failure.where(kept.failure != GRAZING, 0).max(dimension, keep_attrs=True)
    found["failure"] = failed.where(failed > 0, kept.failure.max(dimension))
    for name in [str(name) for name in kept.data_vars if name != "failure"]:
        for kind, values in bands(kept[name], dimension).items():
            unit = "1" if kind == "straight" else kept[name].attrs["units"]
            long_name = f"{_BAND_NAMES[kind]} {kept[name].attrs['long_name']}".strip()
            found[f"{name}_{kind}".strip("_")] = values.assign_attrs(units=unit, long_name=long_name)
    return found.assign_attrs(bands="draws" if dimension == "draw" else "first order")


def _bands_of_draws(values: "xarray.DataArray", dimension: str) -> dict[str, "xarray.DataArray"]:
    low, high = 0.5 * (1.0 - COVERED), 0.5 * (1.0 + COVERED)
    ends = values.quantile([low, high], dimension).drop_vars("quantile")
    mean, sd = values.mean(dimension), values.std(dimension, ddof=1)
    return {"": mean, "sd": sd, "low": ends.isel(quantile=0), "high": ends.isel(quantile=1)}


def _bands_of_sigma_points(values: "xarray.DataArray", dimension: str) -> dict[str, "xarray.DataArray"]:
    # In the order of `SigmaPoints`: the estimate, then pairs, on each axis first, and then in random directions.
    middle = values.isel({dimension: 0}, drop=True)
    up = values.isel({dimension: slice(1, None, 2)})
    down = values.isel({dimension: slice(2, None, 2)})
    axes, directions = slice(None, up.sizes[dimension] // 2), slice(up.sizes[dimension] // 2, None)
    odd, even = (up - down) / 2.0, (up + down) / 2.0 - middle
    variance = ((odd.isel({dimension: axes}) / AXIS_STEP) ** 2).sum(dimension, skipna=False)
    # Apart, since the odd and the even part may compensate each other.
    linear, curved = ((part.isel({dimension: directions}) ** 2).mean(dimension, skipna=False) for part in (odd, even))
    straight = (abs(linear - variance) + curved <= MOST_CURVATURE * variance).astype(float)
    sd = variance**0.5
    return {"": middle, "sd": sd, "low": middle - NORMAL * sd, "high": middle + NORMAL * sd, "straight": straight}


ALONG = "drive_direction"
"""The dimension of the directions in a sweep's dataset."""

_COMPARED = ("speed", "net_step", "efficiency", "stroke", "back_slip")


def compared_directions(data: "xarray.Dataset") -> "xarray.Dataset":
    """The differences between the two directions of a sweep, without their dimension.

    **Returns:** for every metric `METRIC_difference`, forward less backward in the metric's unit, each counted along
    its drive: below zero is the wrong way.  `asymmetry` is the difference of the speeds over the mean of their
    magnitudes: 0 where both are equal, 2 where backward does not move along its drive, -2 where forward does not; NaN
    where neither moves.

    **Raises:** `InputError` for a dataset without both directions.
    """
    if data.sizes.get(ALONG) != 2:
        raise InputError("sweep: found no two directions to compare, expected an axis drive.direction with both.")
    forward, backward = (data.sel({ALONG: way}, drop=True) for way in (1.0, -1.0))
    # The efficiency counts along the drive already.
    along = lambda name: backward[name] if name == "efficiency" else -backward[name]
    found = forward.drop_vars(list(forward.data_vars))
    for name in _COMPARED:
        long_name = f"forward less backward: {data[name].attrs['long_name']}"
        attributes = {"units": data[name].attrs["units"], "long_name": long_name}
        found[f"{name}_difference"] = (forward[name] - along(name)).assign_attrs(attributes)
    mean = 0.5 * (abs(forward["speed"]) + abs(along("speed")))
    long_name = "speed forward less backward, by the mean of their magnitudes"
    found["asymmetry"] = (found["speed_difference"] / mean.where(mean > 0)).assign_attrs(units="1", long_name=long_name)
    return found
