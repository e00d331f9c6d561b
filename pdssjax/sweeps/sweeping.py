"""Sweeps: the motion of an actuator at many points, each with its own drive quantities and parameters.

A point that fails is NaN and has the reason.  Memory stays that of a few blocks, for any number of points.
"""

import contextlib
import dataclasses
import json
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Executor
from typing import TYPE_CHECKING

import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Float

from ..core import (
    Document,
    InputError,
    InputWarning,
    Quantity,
    check_executor,
    check_kind,
    check_whole,
    notebook_counter,
    require_float64,
)
from ..integration import TAYLOR, Accuracy
from ..study import Record, Study, UsedNumber, numbers_used
from .blocks import (
    POINT_FAILURES,
    SKIPPED,
    AbstractBlockStore,
    BlockPlan,
    MemoryStore,
    check_memory,
    default_lanes,
    plan_blocks,
)
from .cycles import measured_cycle
from .dataset import coordinates_of, register_plot
from .execution import first_line, job_document, run_blocks
from .point import PointFunction
from .points import AbstractPoints, Grid
from .request_check import (
    check_axes,
    check_effects,
    check_metrics,
    contradictions,
    derivative_numbers,
    drive_of,
    driven_record,
)

if TYPE_CHECKING:
    import xarray


@dataclasses.dataclass(frozen=True, eq=False)
class PlannedSweep:
    """A sweep, checked and ready to run."""

    study: Study
    """The study with the parameters that hold in the record."""
    base: Record
    """The record whose drive is varied."""
    points: AbstractPoints
    declared: dict[str, Quantity]
    """The declared quantity of each path."""
    used: dict[str, UsedNumber]
    """The numbers that all points share."""
    function: PointFunction
    document: Document
    """The job as plain data."""
    plan: BlockPlan
    """The points to compute; points that are not in it are skipped."""


def plan_sweep(
    study: Study,
    over: Mapping[str, Float[ArrayLike, " values"]] | AbstractPoints,
    *,
    record: str | None = None,
    cycles: int | str = 4,
    accuracy: Accuracy | None = None,
    metrics: Sequence[str] = (),
    derivatives: Sequence[str] = (),
) -> PlannedSweep:
    """Check the arguments of `sweep` and plan its work; **raises** the errors that `sweep` raises before any work."""
    check_kind("study", study, Study, "load_study")
    if not isinstance(over, AbstractPoints):
        check_kind("over", over, Mapping)
    points = over if isinstance(over, AbstractPoints) else Grid(over)
    base, cycle = driven_record(study, record), measured_cycle(cycles)
    if drive_of(base).flanks() is None:
        text = "a cycle without a slow and a fast flank: stroke, back-slip and efficiency are NaN"
        warnings.warn(f'sweep: found the drive {drive_of(base)} in "{base.name}", {text}.', InputWarning, 3)
    study = study.for_record(base)
    check_memory(len(points), len(points.paths), len(cycle.metrics) + len(metrics))
    values = points.values()
    declared = check_axes(study, base, points.paths, values)
    # A scattered parameter may be without effect: its band then has no width.
    check_effects(study, base, [path for path in points.paths if path not in points.scattered()], metrics)
    used = numbers_used(study, [*points.paths, *(f"drive.{field}" for field in base.overrides)])
    numbers = {path: entry["value"] for path, entry in used.items()}
    if accuracy is None:
        accuracy = cycle.accuracy
        if study.solver != TAYLOR:
            accuracy = dataclasses.replace(accuracy, method=study.accuracy.method)
    check_metrics(metrics, cycle, [*points.paths, *numbers])
    numbers |= derivative_numbers(derivatives, study, base, [*points.paths, *numbers])
    check_effects(study, base, derivatives, metrics)
    function = PointFunction(
        study.models_with(points.paths),
        drive_of(base),
        points.paths,
        numbers,
        cycle,
        accuracy,
        tuple(metrics),
        tuple(derivatives),
    )
    sound = np.flatnonzero(~contradictions(drive_of(base), points.paths, values, numbers))
    plan = plan_blocks(points.paths, values[sound], default_lanes())
    plan = dataclasses.replace(plan, order=sound[plan.order])
    return PlannedSweep(study, base, points, declared, used, function, job_document(function), plan)


def sweep(
    study: Study,
    over: Mapping[str, Float[ArrayLike, " values"]] | AbstractPoints,
    *,
    record: str | None = None,
    cycles: int | str = 4,
    accuracy: Accuracy | None = None,
    metrics: Sequence[str] = (),
    derivatives: Sequence[str] = (),
    progress: Callable[[int, int], None] | None = None,
    workers: int | None = None,
    executor: Executor | None = None,
    in_flight: int | None = None,
    store: AbstractBlockStore | None = None,
) -> "xarray.Dataset":
    """Net step, speed, step efficiency, stroke and back-slip at many points.

    **Arguments:**

    - `study`: its parameters keep their values or starts; `study.with_values(estimate)` takes those of an estimate.
    - `over`: the values [SI] of each axis by path, in the order of the axes, for every combination of them.  A path is
      a quantity of the drive ("drive.voltage", "drive.frequency", "drive.fall_time") or a parameter of the study's
      models ("friction.f_ss_a"), or of an amplifier that the study lacks.  Or a set of points from `pdssjax.sweeps`:
      `Grid`, `Listed`, `Sobol`, `LatinHypercube`, `CovarianceDraws`, `GivenDraws`, `Crossed`.
    - `record`: the effector record whose drive is varied, the first by default; its conditions hold at all points.
    - `cycles`: the last of these is measured; one more is run, for the last back-slip.  "steady" measures the cycle
      after the transient, with the number of cycles until it repeats, and the decay of a deviation over a cycle.
    - `accuracy`: of the integration, by default that of the cycle.
    - `metrics`: names of further metrics, of `pdssjax.sweeps.FURTHER`.
    - `derivatives`: paths by which all smooth metrics are differentiated, as `speed_by_piezo_gain`.
    - `progress(done, points)`: called after each block; if left out, notebooks show a bar.
    - `workers`: number of threads, one a core by default.  All devices of the machine share a block of points.
    - `executor`: of `concurrent.futures`, runs the blocks in place of the threads, at most `in_flight` at a time.  Its
      processes must be spawned, since JAX does not survive a fork.
    - `store`: keeps the results block by block, and goes on where it stopped.

    **Returns:** an `xarray.Dataset` with units, with one dimension an axis, or those of the set of points: the metrics,
    and `failure`, 0 or an index into `pdssjax.sweeps.POINT_FAILURES`, whose sentences are in its attribute `meanings`.
    Each number that all points share is an attribute.  The attribute `parameters` (JSON) has the study's parameters
    with value, unit and source; of drawn ones the number about which the draws scatter, with the standard error.

    **Raises:** `InputError`, before any work, for an unknown path, or one that changes nothing, an illegal value, an
    empty axis, a study without an effector record under a drive with a frequency, a parameter that is no axis and
    has no number, a store of another sweep or one that another process has, an executor whose processes are forked; and
    where the executor's workers do not answer as they should.
    """
    require_float64("sweep")
    check_executor(executor)
    for name, number in (("workers", workers), ("in_flight", in_flight)):
        if number is not None:
            check_whole(name, number, 1)
    planned = plan_sweep(
        study, over, record=record, cycles=cycles, accuracy=accuracy, metrics=metrics, derivatives=derivatives
    )
    store = MemoryStore() if store is None else store
    progress = progress or notebook_counter("points")
    with contextlib.closing(store):
        plan, pending = store.open(planned.document, planned.plan)
        planned = dataclasses.replace(planned, plan=plan)
        blocks = run_blocks(planned.function, planned.document, plan, pending, executor, workers, in_flight)
        try:
            with contextlib.closing(blocks):
                _keep_blocks(planned, pending, blocks, store, progress)
        except BrokenExecutor as error:
            raise InputError(
                f"sweep: found an executor that gave up ({first_line(error)}), expected workers that can import "
                "pdssjax and have the memory, and a scheduler that stays.  A store has the blocks that are done."
            ) from error
        rows = store.read()
    results = np.full((len(planned.points), rows.shape[1]), np.nan)
    results[:, -1] = SKIPPED
    results[plan.order] = rows
    return labelled(planned, results)


def _keep_blocks(
    planned: PlannedSweep,
    pending: Sequence[int],
    blocks: Iterable[tuple[int, Callable[[], Float[np.ndarray, "lanes columns"]]]],
    store: AbstractBlockStore,
    progress: Callable[[int, int], None] | None,
) -> None:
    """Keep each of the `blocks` in the `store` as soon as it is computed; `pending` has the numbers of all of them."""
    plan, total = planned.plan, len(planned.points)
    size = lambda number: plan.place(number).stop - plan.place(number).start
    done, kept = total - sum(map(size, pending)), 0
    for number, result in blocks:
        try:
            rows = result()[: size(number)]
        except (InputError, BrokenExecutor):
            raise
        except Exception as error:
            # An error at the first block is not one of its points: the other blocks would fail as well.
            if not kept:
                raise
            warnings.warn(
                f"sweep: a block of {size(number)} points cannot be computed ({type(error).__name__}: {error}); its "
                "points have no value, and a sweep that is resumed computes them again.",
                InputWarning,
                stacklevel=3,
            )
        else:
            store.keep(number, rows)
            kept += 1
        done += size(number)
        if progress is not None:
            progress(done, total)


def labelled(planned: PlannedSweep, found: Float[np.ndarray, "points columns"]) -> "xarray.Dataset":
    """The results at the points, metrics and failure, laid out along the dimensions of the points."""
    import xarray

    register_plot()
    points, base, function = planned.points, planned.base, planned.function
    names, shape = list(points.dimensions()), tuple(points.dimensions().values())
    data = {}
    for i, (name, metric) in enumerate(function.columns.items()):
        described = {"units": metric.unit, "long_name": metric.description} | ({"by": metric.by} if metric.by else {})
        data[name] = (names, found[:, i].reshape(shape), described)
    meanings = "; ".join(f"{i}: {sentence or 'none'}" for i, sentence in enumerate(POINT_FAILURES))
    failure = found[:, -1].astype(np.int8).reshape(shape)
    data["failure"] = (names, failure, {"long_name": "why a point has no value", "meanings": meanings})
    # The numbers about which the points scatter, as far as they are known, with their standard errors.
    scattered: dict[str, UsedNumber] = {}
    for path, (about, error) in points.scattered().items():
        parameter = planned.study.parameters.get(path)
        known = None if parameter is None else parameter.number
        number = known if about is None else about
        if number is not None:
            source = parameter.origin if parameter is not None and number == known else "given"
            unit = planned.declared[path].unit
            scattered[path] = {"value": number, "unit": unit, "source": source, "standard_error": error}
    attributes = {
        "title": planned.study.title,
        "record": base.name,
        "cycles": function.cycle.label,
        "drive": type(base.drive).__name__,
        "parameters": json.dumps({**planned.used, **scattered}),
    }
    drive_numbers = {
        f"drive.{field.name}": float(getattr(base.drive, field.name))
        for field in dataclasses.fields(drive_of(base))
        if f"drive.{field.name}" not in points.paths and isinstance(getattr(base.drive, field.name), float | int)
    }
    # The study's numbers of its drives come last, since the sweep runs with them in place of the record's defaults.
    shared = drive_numbers | {path: entry["value"] for path, entry in planned.used.items()}
    return xarray.Dataset(data, coordinates_of(points, planned.declared), attributes | shared)
