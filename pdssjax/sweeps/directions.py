"""What both directions of a drive differ by, at each point of a sweep that has both."""

from typing import TYPE_CHECKING

from ..core import InputError

if TYPE_CHECKING:
    import xarray

ALONG = "drive_direction"
"""The dimension of the directions in a sweep's dataset."""

COMPARED = ("speed", "net_step", "efficiency", "stroke", "back_slip")


def compared_directions(data: "xarray.Dataset") -> "xarray.Dataset":
    """What the directions of a sweep with both differ by, without their dimension.

    **Returns:** for every metric `METRIC_difference`, how much further forward goes than backward, in the metric's
    unit: magnitudes, since a motion backward counts negative; the efficiency counts along the drive.  `asymmetry` is
    the speeds' difference by their mean: 0 where both are alike, 2 or -2 where only one moves; NaN where neither does.

    **Raises:** `InputError` for a dataset that has not both directions.
    """
    if data.sizes.get(ALONG) != 2:
        raise InputError("sweep: found no two directions to compare, expected an axis drive.direction with both.")
    forward, backward = (data.sel({ALONG: way}, drop=True) for way in (1.0, -1.0))
    magnitude = lambda values, name: values if name == "efficiency" else abs(values)
    found = forward.drop_vars(list(forward.data_vars))
    for name in COMPARED:
        told = data[name].attrs
        difference = magnitude(forward[name], name) - magnitude(backward[name], name)
        says = f"forward less backward: {told['long_name']}"
        found[f"{name}_difference"] = difference.assign_attrs(units=told["units"], long_name=says)
    ahead, back = abs(forward["speed"]), abs(backward["speed"])
    mean = 0.5 * (ahead + back)
    says = "speed forward less backward, by their mean"
    found["asymmetry"] = ((ahead - back) / mean.where(mean > 0)).assign_attrs(units="1", long_name=says)
    return found
