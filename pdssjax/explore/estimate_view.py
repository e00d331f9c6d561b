"""An estimate as texts and curves for the page, made from the content of estimate.json."""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..core import Document, decimals_for, display_unit, percent, rounded, with_micro_sign


class ParameterRow(NamedTuple):
    """One parameter as texts of a table."""

    path: str
    unit: str
    value: str
    error: str
    """One standard deviation, in the unit and in per cent."""
    interval: str
    """The interval of 95 %."""
    start: str
    note: str


class ProfileCurve(NamedTuple):
    """The likelihood profile of a parameter, in the unit of the page."""

    path: str
    unit: str
    value: Float[np.ndarray, " points"]
    excess: Float[np.ndarray, " points"]
    linear: Float[np.ndarray, " points"]
    threshold: float
    estimate: float
    verdict: str


class EstimateView(NamedTuple):
    """An estimate in texts, tables and curves."""

    headline: str
    advice: str
    rows: list[ParameterRow]
    names: list[str]
    correlation: Float[np.ndarray, "p p"]
    profiles: list[ProfileCurve]
    notes: list[str]


def estimate_view(document: Document) -> EstimateView:
    """The view of an estimate, given as the content of estimate.json."""
    parameters, statistics = document["parameters"], document["statistics"]
    ended = "converged" if document["converged"] else "NOT CONVERGED"
    if document["converged"] and not document.get("explained", True):
        ended += ", BUT DOES NOT EXPLAIN ITS RECORDS"
    headline = (
        f"{document['title']}: {document['method']} fit, {ended}; chi-square a degree of freedom "
        f"{_number(statistics['reduced_chi2']):.4g} over {statistics['samples']} samples"
    )
    advice = document.get("error_advice") or {}
    matrix = document["correlation"]["matrix"]
    return EstimateView(
        headline,
        f"Errors to believe: {advice['model']}. {advice['reason']}" if advice else "",
        [_row(path, entry) for path, entry in parameters.items()],
        list(document["correlation"]["names"]),
        np.array([[_number(entry) for entry in row] for row in matrix], float).reshape(len(matrix), len(matrix)),
        [_profile(entry, parameters[entry["path"]]) for entry in document.get("profiles") or []],
        [document["message"], *document["notes"]],
    )


def values_of(document: Document) -> dict[str, float]:
    """The number [SI] of every parameter."""
    return {path: float(entry["value"]) for path, entry in document["parameters"].items()}


def _number(given: float | None) -> float:
    """A number of a JSON document, where null stands for NaN."""
    return math.nan if given is None else float(given)


def _row(path: str, entry: Document) -> ParameterRow:
    unit, scale = display_unit(entry["unit"])
    value, error = _number(entry["value"]) * scale, _number(entry["standard_error"]) * scale
    low, high = (_number(end) * scale for end in entry["interval"])
    places = decimals_for(error)
    known = math.isfinite(error)
    start = _number(entry.get("start")) * scale
    return ParameterRow(
        path,
        with_micro_sign(unit),
        rounded(value, places),
        f"{rounded(error, places)} ({percent(error, value)})" if known else "",
        f"{rounded(low, places)} to {rounded(high, places)}" if known else "",
        rounded(start, None) if math.isfinite(start) else "",
        _note(entry),
    )


def _note(entry: Document) -> str:
    if not entry["free"]:
        return "fixed"
    if not entry["informed"]:
        return "no information"
    if entry["at_bound"]:
        return "at a bound"
    return "interval ends at a bound" if entry.get("interval_at_bound") else ""


def _profile(entry: Document, parameter: Document) -> ProfileCurve:
    unit, scale = display_unit(parameter["unit"])
    value, excess, linear = (np.array([_number(x) for x in entry[key]]) for key in ("value", "excess", "linear"))
    estimate = _number(parameter["value"]) * scale
    shown = with_micro_sign(unit)
    return ProfileCurve(
        entry["path"], shown, scale * value, excess, linear, entry["threshold"], estimate, entry["verdict"]
    )
