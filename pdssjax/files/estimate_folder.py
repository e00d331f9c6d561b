"""Reads an estimate back from the folder that `pdssjax identify` wrote."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias, get_args

import numpy as np
from jaxtyping import Float

from ..core import Document, InputError, choices, member
from ..metrics import LackOfFit
from ..study import (
    Agreement,
    Amplification,
    Combination,
    Diagnosis,
    Draws,
    ErrorAdvice,
    Estimate,
    FittedParameter,
    FittedRecord,
    IntegratorCheck,
    MeasuredApart,
    Multistart,
    ParameterDraws,
    ParameterError,
    Profile,
    Provenance,
    Remedy,
    Statistics,
    Unexplained,
)
from .draws_results import read_draws
from .estimate_json import read_estimate
from .prediction_results import COMPARED, VOLTAGE, file_stems, prescribed_column

Entry: TypeAlias = Any
"""A value of a JSON document."""


def read_estimate_folder(folder: Path) -> Estimate:
    """The estimate in a `folder` of results, with the samples of its records as far as `predictions/` has them.

    Samples have the nine digits of those files, and a record without a file has no samples: a fit that was broken off
    writes none.  Draws are read where their file is still there.

    **Raises:** `InputError` where `folder` holds no estimate, or a file in it is not what `pdssjax identify` wrote.
    """
    file = folder / "estimate.json"
    document = read_estimate(file)
    try:
        return _estimate(document, folder)
    except InputError:
        raise
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError) as error:
        what = f"no key {error}" if isinstance(error, KeyError) else str(error).partition("\n")[0]
        raise InputError(f"{file}: found {what}, expected an estimate that pdssjax identify wrote.") from None


def _estimate(document: Document, folder: Path) -> Estimate:
    covariance, correlation = document["covariance"], document["correlation"]
    names = tuple(covariance["names"])
    matrix = lambda rows: _array(rows).reshape(len(names), len(names))
    covariances = {name: rows for name, rows in document.get("covariances", {}).items() if name != "names"}
    parameters = {path: _parameter(path, entry) for path, entry in document["parameters"].items()}
    optional = {key: document[key] for key in ("loss", "effort", "solver", "minimiser", "explained") if key in document}
    return Estimate(
        title=str(document["title"]),
        method=document["method"],
        converged=document["converged"],
        message=document["message"],
        parameters=parameters,
        names=names,
        correlation=matrix(correlation["matrix"]),
        covariance=matrix(covariance["matrix"]),
        records=_records(document["records"], folder / "predictions"),
        statistics=Statistics(**_numbers(document["statistics"])),
        notes=tuple(document["notes"]),
        seconds=document["seconds"],
        profiles=tuple(_profile(entry) for entry in document.get("profiles") or ()),
        multistart=_multistart(document.get("multistart")),
        draws=_draws(document.get("draws"), folder),
        amplification=_amplification(document.get("amplification")),
        diagnosis=_diagnosis(document.get("diagnosis")),
        error_advice=None if document.get("error_advice") is None else ErrorAdvice(**document["error_advice"]),
        covariances={name: matrix(rows) for name, rows in covariances.items()},
        actuator=document.get("actuator", {}),
        check=None if document.get("check") is None else _check(document["check"]),
        unexplained_by=_reasons(document.get("unexplained_by", ())),
        provenance=Provenance(**document.get("provenance", {})),
        **optional,
    )


def _reasons(entries: Sequence[Entry]) -> tuple[Unexplained, ...]:
    """The reasons why an estimate does not explain its records; **raises** `ValueError` for an unknown one."""
    if unknown := [entry for entry in entries if entry not in get_args(Unexplained)]:
        raise ValueError(f"unexplained_by = {unknown[0]!r}")
    return tuple(entries)


def _number(entry: Entry, missing: float = math.nan) -> float:
    """A number of the file, which has null for what JSON has no number for."""
    return missing if entry is None else float(entry)


def _numbers(entry: Mapping[str, Entry]) -> dict[str, Entry]:
    return {key: math.nan if value is None else value for key, value in entry.items()}


def _array(entry: Entry, missing: float = math.nan) -> np.ndarray:
    """The numbers of a list, or of a list of lists."""
    number = lambda value: _array(value, missing) if isinstance(value, list) else _number(value, missing)
    return np.array([number(value) for value in entry], float)


def _pair(entry: Sequence[Entry], missing: tuple[float, float] = (math.nan, math.nan)) -> tuple[float, float]:
    return _number(entry[0], missing[0]), _number(entry[1], missing[1])


def _parameter(path: str, entry: Document) -> FittedParameter:
    apart, verdicts, errors = entry.get("measured_apart"), entry.get("interval_verdicts"), entry.get("errors", {})
    naive = entry.get("naive_standard_error")
    return FittedParameter(
        path=path,
        value=_number(entry["value"]),
        standard_error=_number(entry["standard_error"]),
        interval=_pair(entry["interval"]),
        unit=entry["unit"],
        free=entry["free"],
        start=entry["start"],
        at_bound=entry["at_bound"],
        identifiable=entry["informed"],
        naive_standard_error=naive,
        verdicts=None if verdicts is None else tuple(verdicts),
        errors={name: _error(told) for name, told in errors.items()},
        degrees_of_freedom=_number(entry.get("degrees_of_freedom"), math.inf),
        bounds=_pair(entry.get("bounds", (None, None)), (-math.inf, math.inf)),
        measured_apart=None if apart is None else MeasuredApart(**_numbers(apart)),
    )


def _error(entry: Document) -> ParameterError:
    freedom = _number(entry.get("degrees_of_freedom"), math.inf)
    return ParameterError(_number(entry["standard_error"]), _pair(entry["interval"]), freedom)


def _records(entries: Sequence[Document], folder: Path) -> tuple[FittedRecord, ...]:
    """The records, with their samples from the files of the `folder`."""
    records = tuple(map(_record, entries))
    read = []
    for record, entry, stem in zip(records, entries, file_stems(records), strict=True):
        file = folder / f"{stem}.csv"
        read.append(_with_samples(record, file, _array(entry.get("outliers", ()))) if file.exists() else record)
    return tuple(read)


_PLAIN = "name role measures samples simulated noise_estimated frequency excitation file".split()
_FIGURES = "r2 error_index rmse noise offset offset_standard_error noise_floor chi2 reduced_chi2".split()


def _record(entry: Document) -> FittedRecord:
    """A record without samples."""
    kind = member("study.measurement", entry["measures"])
    words = {key: entry.get(key, next(iter(options))) for key, options in choices(kind).items()}
    measurement = kind(**{key: choices(kind)[key][word] for key, word in words.items()})
    none = np.zeros(0)
    misfit = entry.get("lack_of_fit")
    told: Document = {key: entry[key] for key in _PLAIN if key in entry}
    told |= {key: _number(entry[key]) for key in _FIGURES if key in entry}
    return FittedRecord(
        **told,
        time=none,
        measured=none,
        predicted=none,
        unit=measurement.unit,
        display=measurement.display,
        prescribed=measurement.prescribed_display,
        words=words,
        lack_of_fit=None if misfit is None else LackOfFit(**_numbers(misfit)),
    )


def _with_samples(record: FittedRecord, file: Path, outliers: Float[np.ndarray, " k"]) -> FittedRecord:
    """A record with the samples of its `file`; `outliers` are times [s].

    **Raises:** `InputError` where the file is not the one that belongs to the record.
    """
    scale, unit = record.display.scale, record.display.unit
    wanted = ["time_s", *(f"{name}_{unit}" for name in COMPARED)]
    try:
        with file.open(encoding="utf-8") as lines:
            head = lines.readline().strip().split(",")
            table = np.loadtxt(lines, delimiter=",", ndmin=2)
    except (OSError, ValueError) as error:
        raise InputError(f"{file}: cannot be read ({error}), expected the predictions of pdssjax identify.") from None
    if head[: len(wanted)] != wanted or table.shape != (record.samples, len(head)):
        raise InputError(
            f"{file}: found {len(table)} samples of {', '.join(head)}; expected the {record.samples} samples of "
            f'{", ".join(wanted)} of the record "{record.name}".'
        )
    columns = dict(zip(head, table.T, strict=True))
    motion = columns.get(prescribed_column(record.prescribed))
    time, measured, predicted = (columns[name] for name in wanted[:3])
    return dataclasses.replace(
        record,
        time=time,
        measured=measured / scale,
        predicted=predicted / scale,
        motion=None if motion is None else motion / record.prescribed.scale,
        voltage=columns.get(VOLTAGE),
        outliers=np.array([np.argmin(np.abs(time - at)) for at in outliers], int),
    )


def _profile(entry: Document) -> Profile:
    arrays = {key: _array(entry[key]) for key in ("value", "excess", "linear")}
    computed = np.array(entry["computed"], bool)
    return Profile(**{**entry, **arrays, "computed": computed, "quality": _number(entry["quality"])})


def _multistart(entry: Document | None) -> Multistart | None:
    if entry is None:
        return None
    return Multistart(
        names=tuple(entry["names"]),
        chi2=_array(entry["chi2"], math.inf),
        converged=np.array(entry["converged"], bool),
        starts=_array(entry["starts"]),
        ends=_array(entry["ends"]),
        optimum=np.array(entry["optimum"], int),
        iterations=np.array(entry["iterations"], int),
        ranges={path: _pair(ends) for path, ends in entry["ranges"].items()},
    )


def _draws(entry: Document | None, folder: Path) -> Draws | None:
    if entry is None:
        return None
    names, shape = tuple(entry["names"]), (entry["chains"], entry["draws"])
    try:
        found, values = read_draws(folder / "estimate.json", entry["kind"])
        values = values[:, [found.index(name) for name in names]].reshape(*shape, len(names))
    except (InputError, ValueError):
        values = np.zeros((*shape, 0))
    told = []
    for path, drawn in entry["parameters"].items():
        ends = {key: None if drawn[key] is None else _pair(drawn[key]) for key in ("percentile", "basic")}
        told.append(ParameterDraws(**{**_missing_as_none(drawn), **ends, "path": path}))
    keys = "kind description failed failure seed".split()
    return Draws(names=names, values=values, parameters=tuple(told), **{key: entry[key] for key in keys})


def _missing_as_none(entry: Document) -> Document:
    """Entries as they are, but for mean and deviation, which are NaN where they are missing."""
    return {**entry, "mean": _number(entry["mean"]), "deviation": _number(entry["deviation"])}


def _amplification(entry: Document | None) -> Amplification | None:
    if entry is None:
        return None
    later, earlier = tuple(entry["later"]), tuple(entry["earlier"])
    return Amplification(later, earlier, _array(entry["matrix"]).reshape(len(later), len(earlier)))


def _diagnosis(entry: Document | None) -> Diagnosis | None:
    if entry is None:
        return None
    remedy = entry["remedy"]
    return Diagnosis(
        combinations=tuple(
            Combination(told["exponents"], _number(told["relative_error"])) for told in entry["combinations"]
        ),
        remedy=None
        if remedy is None
        else Remedy(remedy["path"], {path: _pair(errors) for path, errors in remedy["errors"].items()}),
        agreement=tuple(
            Agreement(tuple(told["records"]), told["what"], _number(told["sigmas"]), _numbers(told["shifts"]))
            for told in entry["agreement"]
        ),
    )


def _check(entry: Document) -> IntegratorCheck:
    return IntegratorCheck(entry["solver"], _numbers(entry["differences"]), entry["converged"], entry["message"])
