"""A sweep as a map: its points and metrics, and the motion at a chosen point."""

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ..core import InputError, display_unit, with_micro_sign
from ..study import Study
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
    shared: dict[str, float]
    """Parameters that all points share [SI], by path."""
    record: str
    """The record whose drive was varied."""

    def numbers(self, point: int) -> dict[str, float]:
        """Parameters of a point [SI], by path."""
        return self.shared | {path: float(axis.values[point]) for path, axis in self.axes.items()}

    def slice_of(self, shown: Sequence[str], point: int) -> Bool[np.ndarray, " points"]:
        """Whether each point agrees with `point` in all axes but those `shown`."""
        same = np.ones(next(iter(self.axes.values())).values.size, bool)
        for path, axis in self.axes.items():
            same &= (path in shown) | (axis.values == axis.values[point])
        return same


def sweep_map(data: "xarray.Dataset") -> SweepMap:
    """The map of a dataset made by `pdssjax.sweep`; bands are left out."""
    names = [str(name) for name, values in data.data_vars.items() if name != "failure" and "long_name" in values.attrs]
    names = [name for name in names if not name.endswith(("_sd", "_low", "_high", "_straight"))]
    first = data[names[0]]
    known = {str(c.attrs.get("long_name", name)): c for name, c in data.coords.items() if "units" in c.attrs}
    axes = {}
    for path, coordinate in known.items():
        if set(coordinate.dims) <= set(first.dims):
            spread = coordinate.broadcast_like(first).transpose(*first.dims).values.ravel()
            if np.unique(spread).size > 1 or len(data.coords) == 1:
                unit = str(coordinate.attrs["units"])
                display, scale = display_unit("" if unit == "1" else unit)
                axes[path] = MapAxis(path, with_micro_sign(display), scale, spread.astype(float))
    metrics = {}
    for name in names:
        unit, scale = ("%", 100.0) if name == "efficiency" else display_unit(str(data[name].attrs.get("units", "1")))
        label = str(data[name].attrs["long_name"]).replace(" (3.1)", "")
        label += "" if unit in ("", "1") else f" ({with_micro_sign(unit)})"
        metrics[name] = label, scale * data[name].values.ravel().astype(float)
    shared = {path: float(entry["value"]) for path, entry in json.loads(data.attrs["parameters"]).items()}
    shared |= {str(key): float(value) for key, value in data.attrs.items() if str(key).startswith("drive.")}
    # A coordinate that is the same at every point is no axis.
    shared |= {path: float(c.values.ravel()[0]) for path, c in known.items() if path not in axes}
    return SweepMap(axes, metrics, shared, str(data.attrs["record"]))


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
    logarithmic = places.size > 2 and places[0] > 0 and _equal(places[1:] / places[:-1]) and not _equal(np.diff(places))
    at = np.log(places) if logarithmic else places
    middles = 0.5 * (at[1:] + at[:-1])
    edges = np.concatenate([[2 * at[0] - middles[0]], middles, [2 * at[-1] - middles[-1]]])
    edges = np.exp(edges) if logarithmic else edges
    return Tiles(edges[:-1][which.ravel()], edges[1:][which.ravel()], bool(logarithmic))


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
"""Cycles of the motion shown at a point."""

_INSTANTS = 1500
"""Number of instants of the motion drawn at a point."""

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
    """Reason of a failed simulation, else ""."""


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
        assert self.record.drive is not None
        names = {field.name for field in dataclasses.fields(inner_drive(self.record.drive))}
        fields = {path.removeprefix("drive."): n for path, n in numbers.items() if path.startswith("drive.")}
        drive = self.record.drive.with_numbers({field: n for field, n in fields.items() if field in names})
        frequency = drive.cycle_frequency()
        assert frequency is not None
        end = CYCLES / float(frequency)
        record = dataclasses.replace(self.record, drive=drive, time=np.linspace(0.0, end, 2), measured=np.zeros(2))
        # Numbers of the drive are no parameters of the study here.
        legal = self.study.legal()
        values = {path: n for path, n in numbers.items() if path in legal and not path.startswith("drive.")}
        parameters = {p: q for p, q in self.study.parameters.items() if not p.startswith("drive.")}
        values = dataclasses.replace(self.study, parameters=parameters).values(values) | values
        instants = np.linspace(0.0, end, _INSTANTS)
        self._live = self._live or LiveRecord(self.study, record, values)
        found = self._live.run(record, values, instants)
        inside, platform = found.inside, np.asarray(found.inside.platform)
        effector = platform - np.asarray(inside.relative)
        return PointMotion(instants, np.asarray(inside.voltage), platform, effector, found.message)


def small_map(study: Study, settings: Settings, report: Report, chosen: str) -> "xarray.Dataset":
    """Sweep voltage and frequency around those of a record, at the numbers of `settings`.

    The record is that called `chosen` if this one has a periodic drive and an end-effector, else the first that has.

    **Raises:** `InputError` where no record has a periodic drive and an end-effector, or where this drive has no
    voltage and frequency.
    """
    adjusted = study_at(study, settings)
    try:
        record = driven_record(adjusted, chosen)
    except InputError:
        record = driven_record(adjusted, None)
    assert record.drive is not None
    numbers = record.drive.numbers()
    if not {"voltage", "frequency"} <= set(numbers):
        raise InputError(f'record "{record.name}": found a drive without voltage and frequency, expected both.')
    voltage, frequency = float(numbers["voltage"]), float(numbers["frequency"])
    axes = {
        "drive.voltage": voltage * np.linspace(0.25, 1.25, _EACH_WAY),
        "drive.frequency": frequency * np.geomspace(0.25, 4.0, _EACH_WAY),
    }
    report("sweeping: compiling")
    progress = lambda done, points: report(f"sweeping: {done} of {points} points")
    return sweep(adjusted, Grid(axes), record=record.name, progress=progress)
