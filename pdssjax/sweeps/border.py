"""The border at which a metric passes a level along an axis: that of the dead zone, or the reversal of a direction.

A coarse grid brackets each border, and the brackets are halved side by side down to the tolerance.  A border takes log2
of the ratio of grid to tolerance more points, in place of that ratio.
"""

import json
import warnings
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Float

from ..core import InputError, InputWarning
from ..study import Study
from .dataset import coordinates_of
from .points import Grid, Listed, check_ranges
from .sweeping import plan_sweep, sweep

if TYPE_CHECKING:
    import xarray

DEAD = 0.01
"""Step efficiency below which a drive counts as dead: the end-effector shakes without net motion."""


def find_border(
    study: Study,
    path: str,
    ends: tuple[float, float],
    over: Mapping[str, Float[ArrayLike, " values"]],
    *,
    tolerance: float,
    metric: str = "efficiency",
    level: float = DEAD,
    coarse: int = 9,
    record: str | None = None,
    cycles: int | str = 4,
    workers: int | None = None,
) -> "xarray.Dataset":
    """The lowest value of `path` between `ends` [SI] at which a metric passes a level, at every point of a grid `over`.

    **Arguments:** `tolerance` [SI] is the largest error of the border.  The magnitude of `metric` passes `level`; for
    the efficiency, which counts along the drive, and at level 0 the metric itself does.  A grid of `coarse` values of
    `path` is computed first; two passes between neighbours of this grid are missed.  The rest is as for `sweep`.

    **Returns:** an `xarray.Dataset` over the axes of `over` with `border` [SI], NaN where there is none, `passes`, the
    number of passes on the coarse grid, and attributes with the arguments; `points` is the number of simulations.

    **Raises:** `InputError` for ends the wrong way round, a tolerance that is not positive, an unknown metric, and
    what `sweep` refuses.
    """
    import xarray

    check_ranges({path: ends}, coarse)
    if not tolerance > 0 or coarse < 2:
        raise InputError(
            f"sweep: found a tolerance of {tolerance:g} and {coarse} coarse values, expected above 0 and at least 2."
        )
    planned = plan_sweep(study, {**over, path: np.asarray(ends)}, record=record, cycles=cycles)
    if metric not in planned.function.cycle.metrics:
        known = ", ".join(planned.function.cycle.metrics)
        raise InputError(f'sweep: found the unknown metric "{metric}", expected one of {known}.')
    if metric in planned.function.undefined:
        raise InputError(
            f'sweep: found the metric "{metric}", expected one that a drive without a slow and a fast flank has, such '
            'as "speed".'
        )
    grid, paths, simulated = Grid(over), (*over, path), 0

    def probe(points: Float[np.ndarray, "points paths"]) -> Float[np.ndarray, " points"]:
        nonlocal simulated
        simulated += len(points)
        listed = Listed(dict(zip(paths, points.T, strict=True)))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", InputWarning)  # given once, by `plan_sweep` above
            values = sweep(study, listed, record=record, cycles=cycles, workers=workers)[metric].values
        return (values if metric == "efficiency" or level == 0.0 else np.abs(values)) - level

    border, passes = _search(probe, grid.values(), np.linspace(*ends, coarse), tolerance)
    names, shape = list(grid.dimensions()), tuple(grid.dimensions().values())
    attributes = {"units": planned.declared[path].unit or "1", "long_name": f"border along {path}"}
    unit = planned.function.cycle.metrics[metric].unit
    return xarray.Dataset(
        {
            "border": (names, border.reshape(shape), attributes),
            "passes": (names, passes.reshape(shape), {"long_name": "how often the level is passed on the coarse grid"}),
        },
        coordinates_of(grid, planned.declared),
        {
            "title": planned.study.title,
            "record": planned.base.name,
            "cycles": planned.function.cycle.label,
            **dict(path=path, low=ends[0], high=ends[1], tolerance=tolerance, metric=metric, level=level),
            "of": f"{metric} = {level:g}" + (f" {unit}" if unit != "1" else ""),
            "points": simulated,
            "parameters": json.dumps(planned.used),
        },
    )


def _search(
    probe: Callable[[Float[np.ndarray, "points paths"]], Float[np.ndarray, " points"]],
    at: Float[np.ndarray, "points paths"],
    along: Float[np.ndarray, " coarse"],
    tolerance: float,
) -> tuple[Float[np.ndarray, " points"], Float[np.ndarray, " points"]]:
    """The border at each of the points `at`, and the number of passes on the grid `along`.

    **Arguments:** `probe` gives the metric less its level at some points; NaN where it has no value.
    """
    whole = np.concatenate([np.repeat(at, len(along), axis=0), np.tile(along, len(at))[:, None]], axis=1)
    # A metric without a value has not passed the level.
    is_above = lambda points: np.nan_to_num(probe(points), nan=-1.0) > 0
    above = is_above(whole).reshape(len(at), len(along))
    turns = above[:, 1:] != above[:, :-1]
    passes = turns.sum(axis=1)
    bracketed = np.flatnonzero(passes)
    first = turns.argmax(axis=1)[bracketed]
    low, high, low_is_above = along[first], along[first + 1], above[bracketed, first]
    while bracketed.size and (high - low).max() > tolerance:
        middle = 0.5 * (low + high)
        same = is_above(np.column_stack([at[bracketed], middle])) == low_is_above
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    border = np.full(len(at), np.nan)
    border[bracketed] = 0.5 * (low + high)
    return border, passes.astype(float)
