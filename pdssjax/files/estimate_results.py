"""Writes the results of an identification, estimate.json with report, plots and predictions, and reads parts of it.

A study gets values, starts or a covariance from an estimate.json; `estimate_folder.py` reads a whole `Estimate` back.
"""

import dataclasses
import json
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..core import Document, InputError, InputWarning, nearest
from ..inference import leaves_white_noise
from ..report.text import format_comparison, format_report
from ..study import Draws, Estimate, FittedParameter, FittedRecord, Study
from .draws_file import write_draws
from .json_text import Plain, json_text
from .record_results import file_stems, write_records
from .results_folder import read_text, staging_folder, write_text
from .toml_table import Table


class KnownParameters(NamedTuple):
    """Values and covariance of the p free parameters that an estimate's records determine."""

    names: tuple[str, ...]
    covariance: Float[np.ndarray, "p p"]
    """In SI."""
    errors: str
    """The error model of the covariance, such as "with-misfit"; "standard" where the estimate has only one."""


FORMAT = "pdssjax-estimate/1"
"""The format of estimate.json."""


def with_estimate(study: Study, file: Path) -> Study:
    """`study` with its parameters fixed at their values in `file`, an estimate.json.

    **Raises:** `InputError` if the file is missing or no estimate, is of another actuator, or has a parameter that the
    study lacks.  Warns with `InputWarning` if the fit did not converge, or does not explain its records.
    """
    document = read_estimate(file)
    doubt = _doubt(document)
    if doubt:
        clause = "did not converge" if doubt == "not converged" else "does not explain its records"
        warnings.warn(f"{file}: the fit {clause}; its numbers are used all the same.", InputWarning, 2)
    return study.with_values(_values(document, study, file), _source(file, doubt), of_estimate=True)


def starting_at_estimate(study: Study, file: Path) -> Study:
    """`study` with its free parameters starting at their values in `file`, an estimate.json.

    **Raises:** `InputError` as `with_estimate` does.
    """
    document = read_estimate(file)
    numbers = {path: number for path, number in _values(document, study, file).items() if path in study.parameters}
    return study.with_starts(numbers, _source(file, _doubt(document)))


def _source(file: Path, doubt: str) -> str:
    """The source of numbers, in words."""
    return f"estimate {file}" + (f" ({doubt})" if doubt else "")


def _values(document: Document, study: Study, file: Path) -> dict[str, float]:
    """The numbers [SI] of an estimate's parameters by path; **raises** `InputError` where they are not the study's."""
    table, legal = Table(document, str(file)), study.legal()
    if "actuator" in document:  # older versions wrote none
        study.models.check_same(table.table("actuator", 'a table such as { "friction": "lugre" }').entries, str(file))
    parameters, numbers = table.table("parameters", "a table of parameters"), {}
    for path in parameters.entries:
        if path not in legal:
            raise InputError(f'{file}: found the parameter "{path}", which {study.path} lacks; {nearest(path, legal)}')
        entry, unit = parameters.table(path, 'a table such as { "value": 0.1 }'), legal[path].unit
        if entry.entries.get("unit", unit) != unit:
            raise InputError(f'{entry.at("unit")}: found {json.dumps(entry.entries["unit"])}, expected "{unit}".')
        numbers[path] = entry.number("value", unit)
    return numbers


def read_estimate(file: Path) -> Document:
    """The content of `file`, an estimate.json; **raises** `InputError` if it is missing or no estimate."""
    text = read_text(file, "an estimate.json")
    try:
        document: object = json.loads(text)
    except json.JSONDecodeError as error:
        where = f"{file}: line {error.lineno}, column {error.colno}"
        raise InputError(f"{where}: found no valid JSON: {error.msg}.") from None
    except (ValueError, RecursionError) as error:  # beside syntax: integers and nesting beyond what Python reads
        raise InputError(f"{file}: found no valid JSON: {error}.") from None
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        found = json.dumps(document.get("format") if isinstance(document, dict) else None)
        raise InputError(f'{file}: key "format": found {found}, expected "{FORMAT}".')
    return document


def _doubt(document: Document) -> str:
    """The doubt about the fit in words; "" for none."""
    if document.get("converged") is False:
        return "not converged"
    return "unexplained" if document.get("explained") is False else ""


def read_covariance(file: Path) -> KnownParameters:
    """The free parameters that the records determine, and their covariance, from `file`, an estimate.json.

    Of several error models the covariance is that which the estimate advises.

    **Raises:** `InputError` if the file is missing or no estimate, or determines no parameter.
    """
    document = read_estimate(file)
    try:
        names, matrix, errors = document["covariance"]["names"], document["covariance"]["matrix"], "standard"
        advised, by_model = document.get("error_advice"), document.get("covariances", {})
        if advised is not None and advised["model"] in by_model:
            errors = advised["model"]
            # "covariance" is that of the white model except for rounding; resumed sweeps need the same numbers.
            if errors != "white":
                names, matrix = by_model["names"], by_model[errors]
        covariance = np.array([[np.nan if entry is None else entry for entry in row] for row in matrix], float)
        covariance = covariance.reshape(len(names), len(names))
        known = np.flatnonzero(np.isfinite(np.diag(covariance))) if names else np.zeros(0, int)
        result = KnownParameters(tuple(names[i] for i in known), covariance[np.ix_(known, known)], errors)
    except (KeyError, IndexError, TypeError, ValueError, OverflowError):
        raise InputError(
            f"{file}: covariance: found no square matrix of numbers with a name for each row, "
            "expected an estimate that pdssjax identify wrote."
        ) from None
    if not result.names:
        raise InputError(f"{file}: found no parameter with a standard error, expected one that the records determine.")
    return result


def estimate_text(estimate: Estimate) -> str:
    """The content of `estimate.json`, in SI, as text."""
    plain = lambda names: {name: _plain_data(getattr(estimate, name)) for name in names.split()}
    document = {
        "format": FORMAT,
        **plain("title actuator method loss effort solver minimiser converged explained unexplained_by message"),
        "parameters": {path: _parameter_document(p, estimate.method) for path, p in estimate.parameters.items()},
        "correlation": {"names": estimate.names, "matrix": estimate.correlation},
        "covariance": {"names": estimate.names, "matrix": estimate.covariance},
        "covariances": {"names": estimate.names, **estimate.covariances},
        **plain("error_advice amplification diagnosis profiles multistart"),
        "draws": None if estimate.draws is None else _draws_document(estimate.draws),
        "records": [_record_document(record) for record in estimate.records],
        **plain("statistics notes seconds provenance"),
        **({} if estimate.check is None else plain("check")),
    }
    return json_text(document)


def _plain_data(value: Plain) -> Plain:
    """A `value` of a result as plain data: classes as the data of their fields."""
    if dataclasses.is_dataclass(value):
        value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    elif isinstance(value, tuple) and hasattr(value, "_asdict"):
        value = value._asdict()  # pyright: ignore[reportAttributeAccessIssue]
    if isinstance(value, Mapping):
        return {key: _plain_data(entry) for key, entry in value.items()}
    return [_plain_data(entry) for entry in value] if isinstance(value, tuple) else value


def _parameter_document(parameter: FittedParameter, method: str) -> Document:
    document: Document = _plain_data(parameter) | {"interval_at_bound": parameter.interval_at_bound}
    document["informed"], document["interval_verdicts"] = document.pop("identifiable"), document.pop("verdicts")
    left_out = {"path"} | {key for key in ("interval_verdicts", "measured_apart", "errors") if not document[key]}
    if method == "joint":
        left_out |= {"naive_standard_error"}
    return {key: value for key, value in document.items() if key not in left_out}


def _record_document(record: FittedRecord) -> Document:
    keys = "name role samples r2 error_index rmse noise offset offset_standard_error simulated measures largest_error "
    keys += "noise_estimated noise_floor chi2 reduced_chi2 frequency excitation file"
    document: Document = {key: getattr(record, key) for key in keys.split()} | record.words
    return document | {"outliers": record.time[record.outliers], "lack_of_fit": _plain_data(record.lack_of_fit)}


def _draws_document(draws: Draws) -> Document:
    """The summary of the draws; the draws themselves have a file of their own."""
    chains, each, _ = draws.values.shape
    keys = "kind description names failed failure seed".split()
    document = {key: getattr(draws, key) for key in keys} | {"chains": chains, "draws": each}
    return document | {"parameters": {drawn.path: _plain_data(drawn) for drawn in draws.parameters}}


def write_estimate(estimate: Estimate, folder: Path) -> None:
    """Put `estimate.json`, `report.txt`, plots and predictions into `folder`, in place of older ones.

    Residuals are split into misfit and noise where they are more than white noise.
    """
    from ..report.figures import parameter_figures, residual_split_figure, save_figure

    with staging_folder(folder) as staging:
        _write_essentials(estimate, staging)
        write_records(estimate.records, staging)
        if estimate.draws is not None:
            units = {path: parameter.unit for path, parameter in estimate.parameters.items()}
            write_draws(estimate.draws, units, staging)
        plots, names = staging / "plots", {"errors": "standard_errors", "starts": "multistart"}
        for name, draw in parameter_figures(estimate).items():
            save_figure(draw(), plots / f"{names.get(name, name)}.png")
        for stem, record in zip(file_stems(record.name for record in estimate.records), estimate.records, strict=True):
            if record.role == "fit" and record.simulated and not leaves_white_noise(record):
                (plots / "residuals").mkdir(exist_ok=True)
                save_figure(residual_split_figure(record), plots / "residuals" / f"{stem}.png")


def write_essentials(estimate: Estimate, folder: Path) -> None:
    """Put only `estimate.json` and `report.txt` into `folder`, in place of older results."""
    with staging_folder(folder) as staging:
        _write_essentials(estimate, staging)


def _write_essentials(estimate: Estimate, staging: Path) -> None:
    write_text(staging / "estimate.json", estimate_text(estimate))
    write_text(staging / "report.txt", format_report(estimate))


def write_comparison(estimates: Sequence[Estimate], folder: Path) -> None:
    """Put `comparison.txt` and `comparison.png` into `folder`, in place of older ones.

    **Arguments:** the joint fit first, then those in two steps.
    """
    from ..report.figures import comparison_figure, save_figure

    with staging_folder(folder) as staging:
        write_text(staging / "comparison.txt", format_comparison(*estimates))
        save_figure(comparison_figure(estimates), staging / "comparison.png")
