"""A sweep as a map: where its points lie, what was found there, and the motion at a point once it is chosen."""

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ..core import InputError, display_unit, with_micro_sign
from ..study import Record, Study
from ..sweeps import Grid, driven_record, sweep
from .background_job import Report
from .live_record import LiveRecord
from .settings import Settings, inner_drive, study_at

if TYPE_CHECKING:
    import xarray


class MapAxis(NamedTuple):
    """A quantity that was varied, with its number at every point."""

    path: str
    unit: str
    """The unit on the page."""
    scale: float
    """Factor from SI to that unit."""
    values: Float[np.ndarray, " points"]
    """[SI]"""

    @property
    def label(self) -> str:
        """The label of the axis."""
        return f"{self.path} ({self.unit})" if self.unit else self.path


class SweepMap(NamedTuple):
    """The points of a sweep."""

    axes: dict[str, MapAxis]
    """The quantities that were varied, by path."""
    metrics: dict[str, tuple[str, Float[np.ndarray, " points"]]]
    """The label of each metric, with its unit, and its values in that unit; NaN where a point failed."""
    held: dict[str, float]
    """Parameters that all points share [SI], by path."""
    record: str
    """The record whose drive was varied."""

    def numbers(self, point: int) -> dict[str, float]:
        """Parameters of a point [SI], by path."""
        return self.held | {path: float(axis.values[point]) for path, axis in self.axes.items()}

    def slice_of(self, shown: Sequence[str], point: int) -> Bool[np.ndarray, " points"]:
        """Which points differ from `point` along the axes `shown` alone."""
        others = [axis.values for path, axis in self.axes.items() if path not in shown]
        same = np.ones(next(iter(self.axes.values())).values.size, bool)
        for values in others:
            same &= values == values[point]
        return same


def sweep_map(data: "xarray.Dataset") -> SweepMap:
    """The map of a dataset made by `pdssjax.sweep`; bands are left out."""
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
    shared = {path: float(entry["value"]) for path, entry in json.loads(data.attrs["parameters"]).items()}
    drive = {str(key): float(value) for key, value in data.attrs.items() if str(key).startswith("drive.")}
    alone = _alone(data, axes)
    found = {str(name): _metric(data[name]) for name in metrics}
    return SweepMap(axes, found, shared | drive | alone, str(data.attrs["record"]))


def _alone(data: "xarray.Dataset", axes: dict[str, MapAxis]) -> dict[str, float]:
    """Numbers [SI] of the coordinates that are the same at every point."""
    known = {str(c.attrs.get("long_name", name)): c for name, c in data.coords.items() if "units" in c.attrs}
    return {path: float(c.values.ravel()[0]) for path, c in known.items() if path not in axes}


def _axis(path: str, unit: str, values: Float[np.ndarray, " points"]) -> MapAxis:
    shown, scale = display_unit("" if unit == "1" else unit)
    return MapAxis(path, with_micro_sign(shown), scale, values.astype(float))


def _metric(values: "xarray.DataArray") -> tuple[str, Float[np.ndarray, " points"]]:
    unit, scale = display_unit(str(values.attrs.get("units", "1")))
    if values.name == "efficiency":
        unit, scale = "%", 100.0
    says = str(values.attrs["long_name"]).replace(" (3.1)", "")
    label = says if unit in ("", "1") else f"{says} ({with_micro_sign(unit)})"
    return label, scale * values.values.ravel().astype(float)


class Tiles(NamedTuple):
    """The ends of the tiles of points along an axis, half-way to their neighbours."""

    low: Float[np.ndarray, " points"]
    high: Float[np.ndarray, " points"]
    logarithmic: bool
    """Whether the points lie at equal ratios."""


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
    """Ticks of a logarithmic axis over `values`: 1, 2 and 5 times powers of ten, or these powers over two decades."""
    low, high = float(np.min(values)), float(np.max(values))
    begins = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    each = (1, 2, 5) if high <= 100.0 * low else (1,)
    ticks = [float(f"{number}e{decade}") for decade in begins for number in each]
    return [tick for tick in ticks if low <= tick <= high]


def _equal(numbers: Float[np.ndarray, " n"]) -> bool:
    return bool(np.ptp(numbers) < 1e-6 * abs(float(numbers[0])))


def is_grid(data: SweepMap, shown: Sequence[str]) -> bool:
    """Whether the points lie on a grid over the axes `shown` (rather than being a random sample)."""
    counts = [np.unique(data.axes[path].values).size for path in shown]
    return math.prod(counts) <= next(iter(data.axes.values())).values.size


CYCLES = 5
"""Cycles of the motion that are shown at a point."""

_INSTANTS = 1500
"""Number of instants at which the motion at a point is drawn."""

_EACH_WAY = 9
"""Number of voltages, and of frequencies, of a small map."""


class PointMotion(NamedTuple):
    """A few cycles from rest; arrays of shape (k,)."""

    time: Float[np.ndarray, " k"]
    """[s]"""
    voltage: Float[np.ndarray, " k"]
    """[V]"""
    platform: Float[np.ndarray, " k"]
    """[m]"""
    effector: Float[np.ndarray, " k"]
    """[m]"""
    message: str
    """Why the simulation failed; empty where it did not fail."""


class PointSimulation:
    """Simulates the record of a sweep at any of its points; compiles at the first."""

    def __init__(self, study: Study, record: str | None):
        self.record = driven_record(study, record)
        self.study = study.for_record(self.record)
        self._live: LiveRecord | None = None

    def motion(self, numbers: Mapping[str, float]) -> PointMotion:
        """The first `CYCLES` cycles from rest with the `numbers` [SI] of a point, of parameters and drive by path.

        **Raises:** `InputError` where parameters are left without a number.
        """
        record, values = self._at(numbers)
        instants = np.linspace(0.0, float(record.time[-1]), _INSTANTS)
        self._live = self._live or LiveRecord(self.study, record, values)
        found = self._live.run(record, values, instants)
        inside = found.inside
        platform = np.asarray(inside.platform)
        effector = platform - np.asarray(inside.relative)
        return PointMotion(instants, np.asarray(inside.voltage), platform, effector, found.message)

    def _at(self, numbers: Mapping[str, float]) -> tuple[Record, dict[str, float]]:
        assert self.record.drive is not None
        named = {field.name for field in dataclasses.fields(inner_drive(self.record.drive))}
        fields = {path.removeprefix("drive."): n for path, n in numbers.items() if path.startswith("drive.")}
        drive = self.record.drive.with_numbers({field: n for field, n in fields.items() if field in named})
        frequency = drive.cycle_frequency()
        assert frequency is not None
        time = np.linspace(0.0, CYCLES / float(frequency), 2)
        legal = self.study.legal()
        # What the drive has is no parameter of the study here.
        values = {path: n for path, n in numbers.items() if path in legal and not path.startswith("drive.")}
        study = dataclasses.replace(
            self.study, parameters={p: q for p, q in self.study.parameters.items() if not p.startswith("drive.")}
        )
        whole = study.values(values) | values
        return dataclasses.replace(self.record, drive=drive, time=time, measured=np.zeros(2)), whole


def small_map(study: Study, settings: Settings, report: Report, chosen: str) -> "xarray.Dataset":
    """Sweep voltage and frequency around those of a record, at the numbers of `settings`.

    The record is the one called `chosen`, or the first with a periodic drive and an end-effector where it has none.

    **Raises:** `InputError` where no record has a periodic drive and an end-effector, or where this drive has no
    voltage and frequency.
    """
    here = study_at(study, settings)
    record = _record_to_sweep(here, chosen)
    assert record.drive is not None
    numbers = record.drive.numbers()
    if not {"voltage", "frequency"} <= set(numbers):
        raise InputError(
            f'record "{record.name}": found a drive without voltage and frequency, expected one with both.'
        )
    voltage, frequency = float(numbers["voltage"]), float(numbers["frequency"])
    axes = {
        "drive.voltage": voltage * np.linspace(0.25, 1.25, _EACH_WAY),
        "drive.frequency": frequency * np.geomspace(0.25, 4.0, _EACH_WAY),
    }
    report("sweeping: compiling")
    return sweep(
        here,
        Grid(axes),
        record=record.name,
        progress=lambda done, points: report(f"sweeping: {done} of {points} points"),
    )


def _record_to_sweep(study: Study, chosen: str) -> Record:
    try:
        return driven_record(study, chosen)
    except InputError:
        return driven_record(study, None)
