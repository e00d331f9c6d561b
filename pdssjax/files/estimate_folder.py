"""Reads a folder of results: the estimate that `pdssjax identify` wrote, or a page to send."""

import dataclasses
import json
import math
import types
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args, get_origin, get_type_hints

import numpy as np
from jaxtyping import AbstractArray

from ..core import Document, InputError, choices, member
from ..report.page import Illustration, Page, Section, estimate_page
from ..study import Draws, Estimate, FittedParameter, FittedRecord, Multistart, ParameterDraws, ParameterError
from .draws_file import read_draws
from .estimate_results import read_estimate
from .record_results import COMPARED, VOLTAGE, file_stems, prescribed_column
from .results_folder import read_text

Entry: TypeAlias = Any
"""A value of a JSON document, or the type that it is read as."""

_INFINITE = {(FittedParameter, "degrees_of_freedom"), (ParameterError, "degrees_of_freedom"), (Multistart, "chi2")}
"""Numbers that are infinite where JSON has null; all others are NaN."""


def read_estimate_folder(place: Path) -> Estimate:
    """The estimate in a folder of results, with the samples of its records in `predictions/`.

    Samples have the nine digits of those files.  A record without a file, as of an interrupted fit, has no samples.
    Draws are read where their file exists.

    **Arguments:** `place` is the folder, or the estimate.json in it.

    **Raises:** `InputError` where there is no estimate, or a file that `pdssjax identify` did not write.
    """
    file = place / "estimate.json" if place.is_dir() else place
    document = read_estimate(file)
    try:
        return _estimate(document, file)
    except InputError:
        raise
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError) as error:
        found = f"no key {error}" if isinstance(error, KeyError) else str(error).partition("\n")[0]
        raise InputError(f"{file}: found {found}, expected an estimate that pdssjax identify wrote.") from None


def _estimate(document: Document, file: Path) -> Estimate:
    names = tuple(document["covariance"]["names"])
    matrix = lambda rows: _numbers(rows).reshape(len(names), len(names))
    covariances = {name: rows for name, rows in document.get("covariances", {}).items() if name != "names"}
    stems = file_stems(record["name"] for record in document["records"])
    files = [file.parent / "predictions" / f"{stem}.csv" for stem in stems]
    fields: Document = {
        "names": names,
        "covariance": matrix(document["covariance"]["matrix"]),
        "correlation": matrix(document["correlation"]["matrix"]),
        "covariances": {name: matrix(rows) for name, rows in covariances.items()},
        "parameters": {path: _parameter(path, entry) for path, entry in document["parameters"].items()},
        "records": tuple(_record(*pair) for pair in zip(document["records"], files, strict=True)),
        "draws": None if document.get("draws") is None else _draws(document["draws"], file),
    }
    # The document has the other fields as the estimate has them; earlier versions did not write all of them.
    kinds = get_type_hints(Estimate)
    others = {key: _decoded(kinds[key], document[key]) for key in kinds if key in document and key not in fields}
    return Estimate(**fields, **others)


def _decoded(kind: Entry, entry: Entry, missing: float = math.nan) -> Entry:
    """An `entry` of the document as the type `kind`, an annotation of a field; `missing` replaces null.

    **Raises:** `KeyError`, `TypeError` or `ValueError` where it is not of that type.
    """
    inner = get_args(kind)
    origin = get_origin(kind) or kind
    if origin is types.UnionType and types.NoneType in inner:
        return None if entry is None else _decoded(inner[0], entry, missing)
    if origin is float:
        return missing if entry is None else float(entry)
    if origin is Literal and entry not in inner:
        raise ValueError(repr(entry))
    if origin is tuple:
        kinds = inner[:1] * len(entry) if inner[-1] is ... else inner
        return tuple(_decoded(each, value, missing) for each, value in zip(kinds, entry, strict=True))
    if isinstance(entry, dict) and len(inner) == 2:
        return {key: _decoded(inner[1], value, missing) for key, value in entry.items()}
    if isinstance(kind, type) and issubclass(kind, AbstractArray):
        return _numbers(entry, missing)
    if isinstance(entry, dict):
        kinds, null = get_type_hints(kind), lambda key: math.inf if (kind, key) in _INFINITE else math.nan
        return kind(**{key: _decoded(kinds[key], entry[key], null(key)) for key in entry})
    return entry


def _numbers(entry: Entry, missing: float = math.nan) -> np.ndarray:
    """A list, or a list of lists, as an array of the type of its entries; `missing` replaces null."""
    objects = np.array(entry, object)
    is_null = np.array([value is None for value in objects.ravel()], bool).reshape(objects.shape)
    if is_null.any() or not objects.size:
        return np.where(is_null, missing, objects).astype(float)
    numbers = np.array(entry)
    if numbers.dtype.kind not in "bif":
        raise ValueError(f"{entry!r:.80} in place of numbers")
    return numbers


def _parameter(path: str, entry: Document) -> FittedParameter:
    renamed = {"informed": "identifiable", "interval_verdicts": "verdicts"}
    fields = {renamed.get(key, key): value for key, value in entry.items() if key != "interval_at_bound"}
    low, high = fields.pop("bounds", (None, None))
    bounds = (-math.inf if low is None else low, math.inf if high is None else high)
    return _decoded(FittedParameter, {"path": path, "bounds": bounds, **fields})


def _record(entry: Document, file: Path) -> FittedRecord:
    """A record, with the samples of its `file` where that exists."""
    kind = member("study.measurement", entry["measures"])
    words = {key: entry.get(key, next(iter(options))) for key, options in choices(kind).items()}
    measurement = kind(**{key: choices(kind)[key][word] for key, word in words.items()})
    kinds = get_type_hints(FittedRecord)
    fields = {key: _decoded(kinds[key], entry[key]) for key in kinds if key in entry and key != "outliers"}
    record = FittedRecord(
        **fields,
        **dict.fromkeys(("time", "measured", "predicted"), np.zeros(0)),
        unit=measurement.unit,
        display=measurement.display,
        prescribed=measurement.prescribed_display,
        words=words,
    )
    if not file.exists():
        return record
    scale, unit = record.display.scale, record.display.unit
    expected = ["time_s", *(f"{name}_{unit}" for name in COMPARED)]
    try:
        with file.open(encoding="utf-8") as lines:
            header = lines.readline().strip().split(",")
            table = np.loadtxt(lines, delimiter=",", ndmin=2)
    except (OSError, ValueError) as error:
        raise InputError(f"{file}: cannot be read ({error}), expected the predictions of pdssjax identify.") from None
    if header[: len(expected)] != expected or table.shape != (record.samples, len(header)):
        raise InputError(
            f"{file}: found {len(table)} samples of {', '.join(header)}; expected the {record.samples} samples of "
            f'{", ".join(expected)} of the record "{record.name}".'
        )
    columns = dict(zip(header, table.T, strict=True))
    motion = columns.get(prescribed_column(record.prescribed))
    time, measured, predicted = (columns[name] for name in expected[:3])
    return dataclasses.replace(
        record,
        time=time,
        measured=measured / scale,
        predicted=predicted / scale,
        motion=None if motion is None else motion / record.prescribed.scale,
        voltage=columns.get(VOLTAGE),
        outliers=np.array([np.argmin(np.abs(time - at)) for at in _numbers(entry.get("outliers", ()))], int),
    )


def _draws(entry: Document, file: Path) -> Draws:
    names, shape = tuple(entry["names"]), (entry["chains"], entry["draws"])
    try:
        paths, values = read_draws(file, entry["kind"])
        values = values[:, [paths.index(name) for name in names]].reshape(*shape, len(names))
    except (InputError, ValueError):
        values = np.zeros((*shape, 0))
    parameters = tuple(_decoded(ParameterDraws, {"path": path, **drawn}) for path, drawn in entry["parameters"].items())
    keys = "kind description failed failure seed".split()
    return Draws(names=names, values=values, parameters=parameters, **{key: entry[key] for key in keys})


_MOST_BYTES = 2_000_000
"""Largest total size of the pictures on a page: they grow by a third as text, and mail refuses more than 3 MB."""


def own_page(folder: Path) -> Path | None:
    """The page of a comparison or a plan in its `folder` of results, or None: no page can be made of their files."""
    pages = [folder / name for name in ("comparison.html", "plan.html")]
    return next((page for page in pages if page.is_file()), None)


def read_page(folder: Path) -> Page:
    """The page of a `folder` of results: the whole page of an estimate, else the texts and pictures in the folder.

    **Raises:** `InputError` where there are no results, or they cannot be read.
    """
    if not folder.is_dir():
        found = "a file" if folder.exists() else "nothing there"
        raise InputError(f"{folder}: found {found}, expected a folder that a command of pdssjax wrote.")
    if (folder / "estimate.json").exists():
        return estimate_page(read_estimate_folder(folder))
    heading = lambda file: file.stem.replace("_", " ").capitalize()
    files = sorted(folder.glob("*.txt"))
    texts = [Section(heading(file), lines=read_text(file, "a plain text").splitlines()) for file in files]
    pictures = [*sorted(folder.glob("*.png")), *sorted((folder / "plots").rglob("*.png"))]
    if not (texts or pictures):
        raise InputError(
            f"{folder}: found no estimate.json, no text and no picture; expected a folder that a command of pdssjax "
            "wrote."
        )
    figures, left_out, room = list[Illustration](), list[str](), _MOST_BYTES
    for file in pictures:
        content = file.read_bytes()
        if len(content) > room:
            left_out.append(file.name)
            continue
        room -= len(content)
        figures.append(Illustration(content, f"{file.stem.replace('_', ' ')}."))
    notes = [f"Left out, since the page would become too large to send: {', '.join(left_out)}."] if left_out else []
    sections = [*texts, Section("Figures", notes, figures=figures)] if pictures else texts
    return Page(_title(folder), sections, subtitle=f"Results in the folder {folder.resolve().name}")


def _title(folder: Path) -> str:
    """The title in one of the JSON files of a `folder`, else the name of the folder."""
    for file in sorted(folder.glob("*.json")):
        try:
            document: object = json.loads(file.read_text(encoding="utf-8-sig"))
        except (OSError, ValueError, RecursionError):
            continue  # the name of the folder serves as well
        title = document.get("title") if isinstance(document, dict) else None
        if isinstance(title, str) and title:
            return title
    return folder.resolve().name
