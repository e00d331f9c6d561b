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

    **Returns:** for every metric `METRIC_difference`, how much more forward has of it than backward, in the metric's
    unit, each counted along its drive: below zero is the wrong way.  `asymmetry` is the speeds' difference by the mean
    of their magnitudes: 0 where both are alike, 2 where backward does not move along its drive at all, -2 where
    forward does not; NaN where neither moves.

    **Raises:** `InputError` for a dataset that has not both directions.
    """
    if data.sizes.get(ALONG) != 2:
        raise InputError("sweep: found no two directions to compare, expected an axis drive.direction with both.")
    forward, backward = (data.sel({ALONG: way}, drop=True) for way in (1.0, -1.0))
    # The efficiency counts along the drive already.
    along = lambda name: backward[name] if name == "efficiency" else -backward[name]
    found = forward.drop_vars(list(forward.data_vars))
    for name in COMPARED:
        told = data[name].attrs
        difference = forward[name] - along(name)
        says = f"forward less backward: {told['long_name']}"
        found[f"{name}_difference"] = difference.assign_attrs(units=told["units"], long_name=says)
    ahead, back = forward["speed"], along("speed")
    mean = 0.5 * (abs(ahead) + abs(back))
    says = "speed forward less backward, by the mean of their magnitudes"
    found["asymmetry"] = ((ahead - back) / mean.where(mean > 0)).assign_attrs(units="1", long_name=says)
    return found
