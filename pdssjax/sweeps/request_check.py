"""Checks of a sweep's arguments: the record whose drive it varies, paths, further metrics, derivatives."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float

from ..core import InputError, Quantity, check_range, choices, nearest
from ..drive.base import AbstractDrive
from ..study import MASS_UNUSED, Record, Study, check_whole_parts, unused_by, without_effect
from .cycles import AbstractCycle, Steady
from .further_metrics import FURTHER


def driven_record(study: Study, name: str | None) -> Record:
    """The effector record `name`, by default the first one under a periodic drive.

    Its drive gives the voltage by the peak, however the study gives it, unless the study lists "drive.voltage".

    **Raises:** `InputError` where there is none.
    """
    where = study.path or study.title
    driven = [r for r in study.records if r.measurement.effector_free and drive_of(r).period() is not None]
    if not driven:
        raise InputError(f"{where}: found no effector record under a periodic drive, expected one whose drive to vary.")
    if name is None:
        return _by_peak(driven[0], study)
    for record in driven:
        if record.name == name:
            return _by_peak(record, study)
    raise InputError(f'{where}: found no record "{name}" to sweep; {nearest(name, [r.name for r in driven])}')


def _by_peak(record: Record, study: Study) -> Record:
    if "drive.voltage" in study.parameters:
        return record
    drive, listed = drive_of(record), study.for_record(record).parameters
    shared = {field: p.number for field in drive.numbers() if (p := listed.get(f"drive.{field}")) is not None}
    known = {f: number for f, number in shared.items() if number is not None and f not in record.overrides}
    return dataclasses.replace(record, drive=drive.with_numbers(known).with_peak_voltage())


def drive_of(record: Record) -> AbstractDrive:
    """The drive of a record whose end-effector moves."""
    assert record.drive is not None
    return record.drive


_SENSOR_UNUSED = (
    "a sweep computes the motion itself, not the sensor's reading",
    "the reading of a sensor, as pdssjax simulate and study.predict compute it",
)
_STOP_UNUSED = "no metric asked for depends on a stop", 'the metric "output_force" (--metrics output_force)'
"""Why these parameters change nothing in a sweep, and what depends on them."""


def sweepable(study: Study, base: Record) -> dict[str, Quantity]:
    """The declared quantities that a sweep can vary, by path: those of the drive of `base` and of the models."""
    legal = {f"drive.{field}": q for field, q in drive_of(base).declared().items()}
    return legal | {path: q for path, q in study.legal().items() if not path.startswith("drive.")}


def changes_a_sweep(path: str, study: Study, metrics: Sequence[str]) -> bool:
    """Whether the points of a sweep with these further `metrics` depend on `path`, of those that are `sweepable`."""
    return not _why_unused(path, study, metrics)


def check_effects(study: Study, base: Record, paths: Sequence[str], metrics: Sequence[str]) -> None:
    """**Raises** `InputError` for one of the `paths`, all of them sweepable, that no point would depend on."""
    words = sweepable_choices(base)
    check_whole_parts(paths, study.parameters, "sweep")
    for path in paths:
        reasons = _why_unused(path, study, metrics)
        if reasons:
            used = [other for other in sweepable(study, base) if changes_a_sweep(other, study, metrics)]
            raise without_effect("sweep", path, *reasons, [*used, *words])


def _why_unused(path: str, study: Study, metrics: Sequence[str]) -> tuple[str, str] | tuple[()]:
    """Why a path changes no point, and what depends on it; empty where it changes points."""
    part = path.split(".")[0]
    if part == "sensor":
        return _SENSOR_UNUSED
    if part == "stop" and "output_force" not in metrics:
        return _STOP_UNUSED
    return MASS_UNUSED if path in unused_by(study.models) else ()


def sweepable_choices(base: Record) -> dict[str, dict[str, float]]:
    """The choices of the drive of `base`, by path: each word with the number that stands for it."""
    return {f"drive.{field}": words for field, words in choices(type(drive_of(base))).items()}


def check_axes(
    study: Study, base: Record, paths: Sequence[str], values: Float[np.ndarray, "points paths"]
) -> dict[str, Quantity]:
    """The declared quantity of each path; a choice counts as a pure number.

    **Raises:** `InputError` for an unknown path and for a number outside its legal range.
    """
    legal, words = sweepable(study, base), sweepable_choices(base)
    declared = {}
    for path, column in zip(paths, values.T, strict=True):
        if path in words:
            for value in np.setdiff1d(column, list(words[path].values())):
                expected = " or ".join(f"{number:g} ({word})" for word, number in words[path].items())
                raise InputError(f'sweep: path "{path}": found {value:g}, expected {expected}.')
            declared[path] = Quantity(0.0, "", False, -np.inf, np.inf, True)
            continue
        if path not in legal:
            raise InputError(f'sweep: found the unknown path "{path}"; {nearest(path, [*legal, *words])}')
        for end in (column.min(), column.max()):
            check_range(float(end), legal[path], f'sweep: path "{path}"')
        declared[path] = legal[path]
    return declared


def contradictions(
    drive: AbstractDrive, paths: Sequence[str], values: Float[np.ndarray, "points paths"], shared: Mapping[str, float]
) -> Bool[np.ndarray, " points"]:
    """Whether the numbers of each point's drive contradict each other, such as a fall longer than the period.

    A voltage of zero is legal here: the actuator does not move.
    """
    varied = [i for i, path in enumerate(paths) if path.startswith("drive.") and path != "drive.voltage"]
    if not varied or not len(values):
        return np.zeros(len(values), bool)
    fields = [paths[i].removeprefix("drive.") for i in varied]
    fixed = {path.removeprefix("drive."): n for path, n in shared.items() if path.startswith("drive.")}
    fixed = {field: number for field, number in fixed.items() if hasattr(drive, field)}
    different, which = np.unique(values[:, varied], axis=0, return_inverse=True)
    drives = [drive.with_numbers(fixed | dict(zip(fields, row, strict=True))) for row in different.tolist()]
    return np.array([bool(set(made.broken_conditions()) - {"voltage"}) for made in drives])[which.ravel()]


def check_metrics(metrics: Sequence[str], cycle: AbstractCycle, known: Sequence[str]) -> None:
    """**Raises** `InputError` for further `metrics` that are unknown, or that lack what they need.

    **Arguments:** `known` are the paths that have a number at every point.
    """
    for i, name in enumerate(metrics):
        if name in cycle.metrics or name in metrics[:i]:
            raise InputError(f'sweep: found the metric "{name}" twice, expected further ones: {", ".join(FURTHER)}.')
        if name not in FURTHER:
            raise InputError(f'sweep: found the unknown metric "{name}"; {nearest(name, FURTHER)}')
    if "multiplier" in metrics and not isinstance(cycle, Steady):
        raise InputError(
            f'sweep: found the metric "multiplier" of cycle {cycle.label}, expected cycles = "steady" with it.'
        )
    if "output_force" in metrics and "stop.stiffness" not in known:
        raise InputError(
            'sweep: found the metric "output_force" without "stop.stiffness", expected a number for it among the '
            "study's parameters or the axes: the output force depends on the stiffness of the force sensor."
        )


def derivative_numbers(paths: Sequence[str], study: Study, base: Record, known: Sequence[str]) -> dict[str, float]:
    """The numbers [SI] of those `paths` of derivatives that are in the record's drive alone.

    **Raises:** `InputError` for a path that is unknown, named twice, without a number, or a choice such as a direction.
    """
    legal, words = sweepable(study, base), sweepable_choices(base)
    numbers = {}
    for i, path in enumerate(paths):
        where = f'sweep: derivative by "{path}"'
        if path in words:
            raise InputError(f"{where}: found a choice between {' and '.join(words[path])}, expected a number.")
        if path not in legal:
            raise InputError(f'sweep: found the unknown path "{path}" of a derivative; {nearest(path, legal)}')
        if path in paths[:i]:
            raise InputError(f"{where}: found it twice, expected every path once.")
        if path in known:
            continue
        number = getattr(drive_of(base), path.removeprefix("drive."), None) if path.startswith("drive.") else None
        if number is None:
            raise InputError(f"{where}: found no number for it, expected one among the study's parameters or the axes.")
        numbers[path] = float(number)
    return numbers
