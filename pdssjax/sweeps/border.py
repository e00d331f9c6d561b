"""Where a metric passes a level on its way along an axis: the border of the dead zone, the reversal of a direction.

A coarse grid finds between which neighbours it lies, and those alone are halved, all of them side by side, until they
are near enough: log2 of the ratio of grid to tolerance more points a border in place of that ratio.
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
"""Step efficiency below which a drive counts as dead: the end-effector shakes and stays."""


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

    **Arguments:** `tolerance` [SI] is how near the border has to be told.  The magnitude of `metric` passes `level`; of
    the efficiency, which counts along the drive, and at level 0 the metric itself does.  `coarse` values of `path` are
    looked at first: what passes twice between two of them is not seen.  The rest is as for `sweep`.

    **Returns:** an `xarray.Dataset` over the axes of `over` with `border` [SI], NaN where there is none, `passes`, how
    often the level is passed on the coarse grid, and attributes that say what was asked; `points` is how many were
    simulated.

    **Raises:** `InputError` for ends the wrong way round, a tolerance that is not positive, an unknown metric, and
    what `sweep` refuses.
    """
    import xarray

    check_ranges({path: ends}, coarse)
    if not tolerance > 0 or coarse < 2:
        raise InputError(
            f"sweep: found a tolerance of {tolerance:g} and {coarse} values, expected both positive, 2 at least."
        )
    planned = plan_sweep(study, {**over, path: np.asarray(ends)}, record=record, cycles=cycles)
    if metric not in planned.function.cycle.metrics:
        known = ", ".join(planned.function.cycle.metrics)
        raise InputError(f'sweep: found the unknown metric "{metric}", expected one of {known}.')
    if metric in planned.function.lacking:
        raise InputError(
            f'sweep: found the metric "{metric}", expected one that a drive without a slow and a fast flank has, such '
            'as "speed".'
        )
    grid, paths, asked = Grid(over), (*over, path), 0

    def probe(points: Float[np.ndarray, "points paths"]) -> Float[np.ndarray, " points"]:
        nonlocal asked
        asked += len(points)
        listed = Listed(dict(zip(paths, points.T, strict=True)))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", InputWarning)  # said once, when it was planned
            values = sweep(study, listed, record=record, cycles=cycles, workers=workers)[metric].values
        signed = metric == "efficiency" or level == 0.0
        return (values if signed else np.abs(values)) - level

    border, passes = _search(probe, grid.values(), np.linspace(*ends, coarse), tolerance)
    names, shape = list(grid.dimensions()), tuple(grid.dimensions().values())
    of_border = {"units": planned.declared[path].unit or "1", "long_name": f"border along {path}"}
    unit = planned.function.cycle.metrics[metric].unit
    return xarray.Dataset(
        {
            "border": (names, border.reshape(shape), of_border),
            "passes": (names, passes.reshape(shape), {"long_name": "how often the level is passed on the coarse grid"}),
        },
        coordinates_of(grid, planned.declared),
        {
            "title": planned.study.title,
            "record": planned.base.name,
            "cycles": planned.function.cycle.described,
            **dict(path=path, low=ends[0], high=ends[1], tolerance=tolerance, metric=metric, level=level),
            "of": f"{metric} = {level:g}" + (f" {unit}" if unit != "1" else ""),
            "points": asked,
            "parameters": json.dumps(planned.used),
        },
    )


def _search(
    probe: Callable[[Float[np.ndarray, "points paths"]], Float[np.ndarray, " points"]],
    at: Float[np.ndarray, "points paths"],
    along: Float[np.ndarray, " coarse"],
    tolerance: float,
) -> tuple[Float[np.ndarray, " points"], Float[np.ndarray, " points"]]:
    """The border at each of the points `at`, and how often it is passed on the grid `along`.

    **Arguments:** `probe` says how far the metric is above its level at some points; NaN where it has no value.
    """
    whole = np.concatenate([np.repeat(at, len(along), axis=0), np.tile(along, len(at))[:, None]], axis=1)
    # What has no value has not passed the level.
    is_above = lambda points: np.nan_to_num(probe(points), nan=-1.0) > 0
    above = is_above(whole).reshape(len(at), len(along))
    turns = above[:, 1:] != above[:, :-1]
    passes, first = turns.sum(axis=1), turns.argmax(axis=1)
    there = np.flatnonzero(passes)
    low, high, beneath = along[first[there]], along[first[there] + 1], above[there, first[there]]
    while there.size and (high - low).max() > tolerance:
        middle = 0.5 * (low + high)
        same = is_above(np.column_stack([at[there], middle])) == beneath
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    border = np.full(len(at), np.nan)
    border[there] = 0.5 * (low + high)
    return border, passes.astype(float)
