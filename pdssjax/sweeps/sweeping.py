"""Sweeps: how an actuator moves over many points, each its own drive quantities and parameters.

A point that fails is NaN, and says why.  Memory stays that of a few blocks however many points there are.
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
    lanes_here,
    plan_blocks,
)
from .cycles import measured_cycle
from .dataset import coordinates_of, register_plot
from .execution import job_document, run_blocks
from .point import PointFunction
from .points import AbstractPoints, Grid
from .request_check import check_axes, check_effects, check_metrics, contradictions, drive_of, driven_record, numbers_by

if TYPE_CHECKING:
    import xarray


@dataclasses.dataclass(frozen=True, eq=False)
class PlannedSweep:
    """A sweep, checked and ready to run."""

    study: Study
    """With the parameters that hold in the record."""
    base: Record
    """The record whose drive is varied."""
    points: AbstractPoints
    declared: dict[str, Quantity]
    """What is declared of each path."""
    used: dict[str, UsedNumber]
    """The numbers that all points share."""
    function: PointFunction
    document: Document
    """The job as plain data."""
    plan: BlockPlan
    """The points that are computed; those left out are skipped."""


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
    """What `sweep` of the same does, without doing it; **raises** what it raises before any work."""
    check_kind("study", study, Study, "load_study")
    if not isinstance(over, AbstractPoints):
        check_kind("over", over, Mapping)
    points = over if isinstance(over, AbstractPoints) else Grid(over)
    base, cycle = driven_record(study, record), measured_cycle(cycles)
    if drive_of(base).flanks() is None:
        lacks = "a cycle without a slow and a fast flank, which has no stroke, back-slip and efficiency: they are NaN"
        warnings.warn(f'sweep: found the drive {drive_of(base)} in "{base.name}", {lacks}.', InputWarning, 3)
    study = study.for_record(base)
    check_memory(len(points), len(points.paths), len(cycle.metrics) + len(metrics))
    values = points.values()
    declared = check_axes(study, base, points.paths, values)
    # What is known of a parameter makes bands, and of one without effect a band without width.
    check_effects(study, base, [path for path in points.paths if path not in points.scattered()], metrics)
    used = numbers_used(study, [*points.paths, *(f"drive.{field}" for field in base.overrides)])
    numbers = {path: told["value"] for path, told in used.items()}
    fine = accuracy or cycle.accuracy
    if accuracy is None and study.solver != TAYLOR:
        fine = dataclasses.replace(fine, method=study.accuracy.method)
    check_metrics(metrics, cycle, [*points.paths, *numbers])
    numbers |= numbers_by(derivatives, study, base, [*points.paths, *numbers])
    check_effects(study, base, derivatives, metrics)
    function = PointFunction(
        study.models_with(points.paths),
        drive_of(base),
        points.paths,
        numbers,
        cycle,
        fine,
        tuple(metrics),
        tuple(derivatives),
    )
    sound = np.flatnonzero(~contradictions(drive_of(base), points.paths, values, numbers))
    plan = plan_blocks(points.paths, values[sound], lanes_here())
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

    **Arguments:** the study's parameters keep their values or starts; `study.with_values(estimate)`
    takes those of an estimate.  `over` maps paths to the values [SI] of an axis, in the order of the axes,
    for every combination of them: quantities of the drive ("drive.voltage", "drive.frequency", "drive.fall_time") and
    parameters of the study's models ("friction.f_ss_a"), those of an amplifier that the study
    lacks included; or it is a set of points from `pdssjax.sweeps`: `Grid`, `Listed`, `Sobol`, `LatinHypercube`,
    `CovarianceDraws`, `GivenDraws`, `Crossed`.  `record` names the effector record whose drive is varied, the first one
    by default; parameters that hold under its conditions do so at all points.  The last of `cycles` cycles is measured;
    one more is run, whose flank tells the last slip.  With `cycles="steady"` it is the cycle that is left when the
    transient has died out, and two more numbers say after how many cycles it repeats, and what is
    left of a deviation after a cycle.  `metrics` names what is found besides, of `pdssjax.sweeps.FURTHER`;
    `derivatives` names parameters and quantities of the drive by which all smooth metrics are derived
    (`speed_by_piezo_gain`).  `progress(done, points)` is called after each block; in a notebook a bar shows
    it if there is none.  All devices of the machine share a block of points.
    `workers` is the number of threads, one a core by default.  An `executor` of `concurrent.futures` runs the blocks
    in place of the threads, at most `in_flight` at a time; its processes must be spawned, since JAX does not outlive
    a fork.  A `store` keeps what was found block by block and goes on where it stopped.

    **Returns:** an `xarray.Dataset`, labelled with units, with one dimension an axis, or those of the set of points:
    the metrics, and `failure`, 0 or an index into `pdssjax.sweeps.POINT_FAILURES`, whose sentences are in its
    attribute `meanings`.  What was held has an attribute each, and the attribute `parameters`
    (JSON) tells the study's parameters with value, unit and source; of those that are drawn the number about which
    the draws scatter, with the standard error.

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
            told = next(iter(str(error).strip().splitlines()), type(error).__name__)
            raise InputError(
                f"sweep: found an executor that gave up ({told}), expected workers that can import pdssjax and have "
                "the memory, and a scheduler that stays; what was done is in the store, if there is one."
            ) from error
        rows = store.read()
    found = np.full((len(planned.points), rows.shape[1]), np.nan)
    found[:, -1] = SKIPPED
    found[plan.order] = rows
    return labelled(planned, found)


def _keep_blocks(
    planned: PlannedSweep,
    pending: Sequence[int],
    blocks: Iterable[tuple[int, Callable[[], Float[np.ndarray, "lanes columns"]]]],
    store: AbstractBlockStore,
    progress: Callable[[int, int], None] | None,
) -> None:
    """Let the `store` keep each of the `blocks` as it is computed; `pending` numbers all that will come."""
    plan, total = planned.plan, len(planned.points)
    size = lambda number: plan.place(number).stop - plan.place(number).start
    done, kept = total - sum(map(size, pending)), 0
    for number, found in blocks:
        try:
            rows = found()[: size(number)]
        except (InputError, BrokenExecutor):
            raise
        except Exception as error:
            # What fails at the first block would at every other one: it is no matter of the points.
            if not kept:
                raise
            warnings.warn(
                f"sweep: found that a block of {size(number)} points cannot be computed ({type(error).__name__}: "
                f"{error}); its points have no value, and a sweep that is resumed tries them again.",
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
        said = {"units": metric.unit, "long_name": metric.says} | ({"by": metric.by} if metric.by else {})
        data[name] = (names, found[:, i].reshape(shape), said)
    meanings = "; ".join(f"{i}: {sentence or 'none'}" for i, sentence in enumerate(POINT_FAILURES))
    failure = found[:, -1].astype(np.int8).reshape(shape)
    data["failure"] = (names, failure, {"long_name": "why a point has no value", "meanings": meanings})
    # The numbers about which the points scatter, as far as they are known, and how far.
    scattered: dict[str, UsedNumber] = {}
    for path, (about, error) in points.scattered().items():
        listed = planned.study.parameters.get(path)
        known = None if listed is None else listed.number
        number = known if about is None else about
        if number is not None:
            source = listed.origin if listed is not None and number == known else "given"
            unit = planned.declared[path].unit
            scattered[path] = {"value": number, "unit": unit, "source": source, "standard_error": error}
    attributes = {
        "title": planned.study.title,
        "record": base.name,
        "cycles": function.cycle.described,
        "drive": type(base.drive).__name__,
        "parameters": json.dumps({**planned.used, **scattered}),
    }
    of_drive = {
        f"drive.{field.name}": float(getattr(base.drive, field.name))
        for field in dataclasses.fields(drive_of(base))
        if f"drive.{field.name}" not in points.paths and isinstance(getattr(base.drive, field.name), float | int)
    }
    # What the study says of its drives is what was run with, not the record's own defaults.
    held = of_drive | {path: told["value"] for path, told in planned.used.items()}
    return xarray.Dataset(data, coordinates_of(points, planned.declared), attributes | held)
