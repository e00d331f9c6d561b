"""Sweeps: how an actuator moves over a grid of drive quantities and parameters.

Every point of the grid is its own simulation from rest; the last of its cycles is measured
(`cycle_metrics`).  Points are run side by side in blocks, blocks on every core, so that memory
stays that of a few blocks however many points there are.  A point that fails is NaN, and says why.
"""

import dataclasses
import itertools
import json
import math
import os
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int

from ..core import Count, InputError, Quantity, check_range, nearest
from ..drive.base import AbstractDrive
from ..integration import FAILURES, Accuracy, Taylor, integrate_to_times
from ..metrics import FLANK, cycle_metrics
from ..simulation import StickSlip
from ..study import Models, Record, Study, UsedNumber, numbers_used

if TYPE_CHECKING:
    import xarray

LANES = 64
"""Points run side by side: measured, the fastest from 16 to 128."""

ACCURACY = Accuracy(tolerance=3e-11, method=Taylor(8))
"""Side by side a low order is faster; this agrees with single runs to 1e-4 um."""

_LINE = 6
"""Samples by which the line of a flank is found."""

_INSIDE = 1e-6
"""How far inside the fitted part they stay, in parts of a flank: rounding must not put one outside."""

METRICS = {"net_step": "m", "speed": "m/s", "efficiency": "1", "stroke": "m", "back_slip": "m"}
"""What is measured at each point, with its unit."""

SAYS = {
    "net_step": "net step of a cycle",
    "speed": "average speed",
    "efficiency": "step efficiency (3.1)",
    "stroke": "stroke of the stick phase",
    "back_slip": "back-slip",
}


def sweep(
    study: Study,
    over: Mapping[str, Float[ArrayLike, " values"]],
    *,
    record: str | None = None,
    cycles: int = 4,
    accuracy: Accuracy | None = None,
    progress: Callable[[int, int], None] | None = None,
    workers: int | None = None,
) -> "xarray.Dataset":
    """Net step, speed, step efficiency, stroke and back-slip over a grid.

    **Arguments:** the study's parameters keep their values or starts; `study.with_values(estimate)`
    takes those of an estimate.  `over` maps paths to the values [SI] of an axis, in the order of the axes:
    quantities of the drive ("drive.voltage", "drive.frequency", "drive.fall_time") and parameters
    of the study's models ("friction.f_ss_a").  `record` names the effector record whose drive is
    varied, the first one by default.  The last of `cycles` cycles is measured; one more is run,
    whose flank tells the last slip.  `progress(done, points)` is called after each block.
    `workers` is the number of threads, one a core by default.

    **Returns:** an `xarray.Dataset` with one dimension an axis, labelled with units: the metrics,
    and `failure`, 0 or an index into `pdssjax.integration.solution.FAILURES`, whose sentences are in its
    attribute `meanings`.  What was held has an attribute each, and the attribute `parameters`
    (JSON) tells the study's parameters with value, unit and source.

    **Raises:** `InputError` for an unknown path, an illegal value, an empty axis, a study
    without an effector record under a drive with a frequency, or a parameter that is no axis and
    has no number.
    """
    base = _base(study, record)
    axes = {path: np.atleast_1d(np.asarray(values, float)) for path, values in over.items()}
    declared = _check(study, base, axes, cycles)
    points = np.array(list(itertools.product(*axes.values()))) if axes else np.zeros((1, 0))
    used = numbers_used(study, [*axes, *(f"drive.{field}" for field in base.overrides)])
    numbers = {path: told["value"] for path, told in used.items()}
    run = _Block(study.models, _drive_of(base), tuple(axes), numbers, cycles, accuracy or ACCURACY)
    # Neighbours in a block wait for the slowest of them, and what sets the pace is the frequency.
    pace = points[:, list(axes).index("drive.frequency")] if "drive.frequency" in axes else np.zeros(len(points))
    order = np.argsort(pace, kind="stable")
    found = np.empty((len(points), len(METRICS) + 1))
    found[order] = _run(run, points[order], progress, workers or os.cpu_count() or 1)
    return _dataset(study, base, axes, declared, found, cycles, used)


class _Block(eqx.Module):
    """A block of points as one compiled function."""

    models: Models
    drive: AbstractDrive
    paths: tuple[str, ...] = eqx.field(static=True)
    numbers: dict[str, float]
    cycles: int = eqx.field(static=True)
    accuracy: Accuracy

    def __call__(
        self, points: Float[Array, "lanes axes"]
    ) -> tuple[Float[Array, "lanes metrics"], Int[Array, " lanes"]]:
        """Metrics and failure of each point, shape (lanes, metrics) and (lanes,)."""
        return jax.vmap(self._point)(points)

    def _point(self, values: Float[Array, " axes"]) -> tuple[Float[Array, " metrics"], Count]:
        given = dict(zip(self.paths, values, strict=True))
        numbers = {**self.numbers, **given}
        fields = {field: f"drive.{field}" for field in self.drive.declared()}
        changed = {field: jnp.asarray(numbers[path], float) for field, path in fields.items() if path in numbers}
        drive = self.drive.with_numbers(changed)
        actuator = self.models.actuator(numbers)
        frequency, flanks = jnp.asarray(drive.cycle_frequency(), float), drive.flanks()
        period = 1.0 / frequency
        fall = jnp.zeros(()) if flanks is None else jnp.asarray(flanks.fast, float)
        phases = fall + (period - fall) * jnp.linspace(FLANK[0] + _INSIDE, FLANK[1] - _INSIDE, _LINE)
        times = jnp.concatenate([(self.cycles - 1) * period + phases, self.cycles * period + phases])
        state, _, _, failure = integrate_to_times(StickSlip(actuator, drive), times, self.accuracy)
        y, _ = jax.vmap(actuator.driven_platform.platform)(state.driven)
        measured = cycle_metrics(times, y - state.d, frequency, (self.cycles - 1) * period, 1, fall)
        metrics = jnp.stack([getattr(measured, name)[0] for name in METRICS])
        return jnp.where(failure > 0, jnp.nan, metrics), jnp.where(jnp.isfinite(metrics).all(), failure, 2)


@eqx.filter_jit
def _compiled(
    block: _Block, points: Float[Array, "lanes axes"]
) -> tuple[Float[Array, "lanes metrics"], Int[Array, " lanes"]]:
    return block(points)


def _run(
    block: _Block, points: Float[np.ndarray, "points axes"], progress: Callable[[int, int], None] | None, workers: int
) -> Float[np.ndarray, "points found"]:
    """Metrics and failure of all points, shape (points, metrics + 1)."""
    count = len(points)
    padded = np.concatenate([points, np.repeat(points[-1:], -count % LANES, axis=0)])
    blocks = padded.reshape(-1, LANES, points.shape[1])
    found = np.empty((len(padded), len(METRICS) + 1))

    def run_block(number: int) -> None:
        metrics, failure = _compiled(block, jnp.asarray(blocks[number]))
        place = slice(number * LANES, (number + 1) * LANES)
        found[place, :-1], found[place, -1] = metrics, failure

    done = 0
    with ThreadPoolExecutor(workers) as pool:
        # The first block alone: it compiles what the others share.
        order = itertools.chain(map(run_block, range(1)), pool.map(run_block, range(1, len(blocks))))
        for _ in order:
            done = min(done + LANES, count)
            if progress is not None:
                progress(done, count)
    return found[:count]


def _drive_of(record: Record) -> AbstractDrive:
    """That of a record whose end-effector moves."""
    assert record.drive is not None
    return record.drive


def _base(study: Study, name: str | None) -> Record:
    where = study.path or study.title
    driven = [r for r in study.records if r.measurement.effector_free and _drive_of(r).period() is not None]
    if not driven:
        raise InputError(f"{where}: found no effector record under a periodic drive, expected one whose drive to vary.")
    if name is None:
        return driven[0]
    for record in driven:
        if record.name == name:
            return record
    raise InputError(f'{where}: found no record "{name}" to sweep; {nearest(name, [r.name for r in driven])}')


def _check(
    study: Study, base: Record, axes: Mapping[str, Float[np.ndarray, " values"]], cycles: int
) -> dict[str, Quantity]:
    """What is declared of each axis."""
    if cycles < 1:
        raise InputError(f"sweep: found {cycles} cycles, expected at least 1.")
    legal = {f"drive.{field}": q for field, q in _drive_of(base).declared().items()}
    legal |= {path: q for path, q in study.legal().items() if not path.startswith("drive.")}
    for path, values in axes.items():
        if path not in legal:
            raise InputError(f'sweep: found the unknown path "{path}"; {nearest(path, legal)}')
        if values.size == 0 or values.ndim != 1:
            raise InputError(f'sweep: path "{path}": found an array of shape {values.shape}, expected some values.')
        for value in values:
            if not math.isfinite(value):
                raise InputError(f'sweep: path "{path}": found {value}, expected finite numbers.')
            check_range(float(value), legal[path], f'sweep: path "{path}"')
    return {path: legal[path] for path in axes}


def _dataset(
    study: Study,
    base: Record,
    axes: Mapping[str, Float[np.ndarray, " values"]],
    declared: Mapping[str, Quantity],
    found: Float[np.ndarray, "points found"],
    cycles: int,
    used: Mapping[str, UsedNumber],
) -> "xarray.Dataset":
    import xarray

    shape = tuple(values.size for values in axes.values())
    names = [path.replace(".", "_") for path in axes]
    data = {
        name: (names, found[:, i].reshape(shape), {"units": unit, "long_name": SAYS[name]})
        for i, (name, unit) in enumerate(METRICS.items())
    }
    meanings = "; ".join(f"{i}: {sentence or 'none'}" for i, sentence in enumerate(FAILURES))
    failure = found[:, -1].astype(np.int8).reshape(shape)
    data["failure"] = (names, failure, {"long_name": "why a point has no value", "meanings": meanings})
    coordinates = {
        name: (name, values, {"units": declared[path].unit or "1", "long_name": path})
        for name, (path, values) in zip(names, axes.items(), strict=True)
    }
    attributes = {"title": study.title, "record": base.name, "cycles": cycles, "drive": type(base.drive).__name__}
    attributes["parameters"] = json.dumps(used)
    of_drive = {
        f"drive.{field.name}": float(getattr(base.drive, field.name))
        for field in dataclasses.fields(_drive_of(base))
        if f"drive.{field.name}" not in axes and isinstance(getattr(base.drive, field.name), float | int)
    }
    # What the study says of its drives is what was run with, not the record's own defaults.
    held = of_drive | {path: told["value"] for path, told in used.items()}
    return xarray.Dataset(data, coordinates, attributes | held)
