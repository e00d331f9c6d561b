"""What a sweep found, labelled: an `xarray.Dataset` with units, what was held, and why points failed."""

import dataclasses
import json
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from ..core import Figure, Quantity, presenter
from ..study import Record, Study, UsedNumber
from .cycles.base import Metric
from .point import PointFunction
from .point_status import POINT_FAILURES
from .points.base import AbstractPoints
from .varied_record import drive_of

if TYPE_CHECKING:
    import xarray


def labelled(
    study: Study,
    base: Record,
    points: AbstractPoints,
    declared: Mapping[str, Quantity],
    found: Float[np.ndarray, "points columns"],
    function: PointFunction,
    used: Mapping[str, UsedNumber],
) -> "xarray.Dataset":
    """What was `found` at each of the `points`, the metrics and then the failure, laid out along their dimensions."""
    import xarray

    register_plot()
    names, shape = list(points.dimensions()), tuple(points.dimensions().values())
    data = {
        name: (names, found[:, i].reshape(shape), _attributes(metric))
        for i, (name, metric) in enumerate(function.columns.items())
    }
    meanings = "; ".join(f"{i}: {sentence or 'none'}" for i, sentence in enumerate(POINT_FAILURES))
    failure = found[:, -1].astype(np.int8).reshape(shape)
    data["failure"] = (names, failure, {"long_name": "why a point has no value", "meanings": meanings})
    coordinates = {
        path.replace(".", "_"): (dimension, values, {"units": declared[path].unit or "1", "long_name": path})
        for path, (dimension, values) in points.coordinates().items()
    }
    attributes = {
        "title": study.title,
        "record": base.name,
        "cycles": function.cycle.described,
        "drive": type(base.drive).__name__,
    }
    attributes["parameters"] = json.dumps({**used, **_scattered(study, points, declared)})
    of_drive = {
        f"drive.{field.name}": float(getattr(base.drive, field.name))
        for field in dataclasses.fields(drive_of(base))
        if f"drive.{field.name}" not in points.paths and isinstance(getattr(base.drive, field.name), float | int)
    }
    # What the study says of its drives is what was run with, not the record's own defaults.
    held = of_drive | {path: told["value"] for path, told in used.items()}
    return xarray.Dataset(data, coordinates, attributes | held)


def _scattered(study: Study, points: AbstractPoints, declared: Mapping[str, Quantity]) -> dict[str, UsedNumber]:
    """By path, the numbers about which the points scatter, as far as they are known, and how far."""
    told: dict[str, UsedNumber] = {}
    for path, (about, error) in points.scattered().items():
        listed = study.parameters.get(path)
        known = None if listed is None else listed.number
        number = known if about is None else about
        if number is not None:
            source = listed.origin if listed is not None and number == known else "given"
            told[path] = {"value": number, "unit": declared[path].unit, "source": source, "standard_error": error}
    return told


def _attributes(metric: Metric) -> dict[str, str]:
    """Those of a variable; of a derivative they say by what."""
    return {"units": metric.unit, "long_name": metric.says} | ({"by": metric.by} if metric.by else {})


class SweepAccessor:
    """What a dataset of a sweep can do besides: `data.pdssjax.plot()`."""

    def __init__(self, data: "xarray.Dataset"):
        self._data = data

    def plot(self) -> Figure:
        """A figure of matplotlib: speed, net step, efficiency and back-slip, as lines or maps.

        **Raises:** `InputError` for a single point.
        """
        return presenter().as_figure(self._data)


def register_plot() -> None:
    """Gives every `xarray.Dataset` the accessor `pdssjax`; `sweep` does, and who opens a `sweep.nc` may."""
    import xarray

    if not hasattr(xarray.Dataset, "pdssjax"):
        xarray.register_dataset_accessor("pdssjax")(SweepAccessor)
