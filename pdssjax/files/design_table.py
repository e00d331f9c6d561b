"""The [design] table of a study: limits of rig, sensor and recorder, and the budget of the next records.

An option of the command line is a line of the same table, and takes precedence.
"""

import tomllib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from ..actuator import PARTS
from ..core import Document, InputError, member, quantities
from ..design import Knowledge, Limits, Resources, misfit_by_kind
from .estimate_results import read_covariance, read_estimate
from .study_toml import read_toml
from .toml_table import Table

DESIGN_KEYS: dict[str, str] = {
    "kinds": 'What may be measured: "platform", "effector", "velocity", "force", "friction".',
    "waveforms": "Drives that the generator can make.",
    "voltage": "Least and greatest voltage [V].",
    "frequency": "Least and greatest frequency [Hz].",
    "duty": "Shares of the period that the slow flank may take.",
    "amplitude": "Amplitudes of the motion prescribed in friction records [m].",
    "interval": "Least time between samples [s].",
    "duration": "Longest record [s].",
    "noise": "Standard deviation of the noise, by kind.",
    "correlation_time": "Correlation time of the noise [s], by kind; white if left out.",
    "range": "Largest extent that a sensor sees, by kind.",
    "rig": "By path, numbers to which a fixed parameter may be set for a record.",
    "record_cost": "Cost of each record, in a unit of your choice (default 1).",
    "second_cost": "Cost of each second recorded (default 0).",
    "budget": "Samples, records, seconds and cost of all records together.",
}
"""Meaning of each key."""

BUDGET_KEYS = ("samples", "records", "seconds", "cost")
"""Resources that a budget may limit."""


class DesignTable(NamedTuple):
    """Limits and budget of the next records, from study and options."""

    limits: Limits
    budget: Resources
    document: Document
    """The table, for the study of the plan."""


def read_design(study: Path, lines: Sequence[str] = (), budget: Mapping[str, str] | None = None) -> DesignTable:
    """The [design] table of a `study` file; `lines` of TOML and the entries of `budget` take precedence.

    **Raises:** `InputError` for entries that are unknown, missing or of another unit.
    """
    document: Document = dict(Table(read_toml(study), str(study)).table("design", "a table", {}).entries)
    for line in lines:
        try:
            document |= tomllib.loads(line)
        except ValueError as error:
            raise InputError(
                f"option --limit: found {line!r:.80}, expected a line of TOML such as 'interval = \"50 us\"': {error}."
            ) from None
    table = Table(document, f"{study}: design")
    table.only(DESIGN_KEYS)
    example = "a table such as { samples = 2000, records = 4 }"
    options = {key: int(text) if text.isdecimal() else text for key, text in (budget or {}).items()}
    document["budget"] = {**table.table("budget", example, {}).entries, **options}
    limits = table.table("budget", example)
    limits.only(BUDGET_KEYS)
    expected = "a whole number above 0, as in --budget samples=2000 records=4"
    others = {key: limits.number(key, unit) for key, unit in (("seconds", "s"), ("cost", "")) if key in limits.entries}
    resources = Resources(
        samples=limits.whole("samples", expected), records=limits.whole("records", expected), **others
    )
    return DesignTable(_limits(table), resources, document)


def _limits(table: Table) -> Limits:
    rig = table.table("rig", 'a table such as { "effector.tilt" = ["-5 deg", "5 deg"] }', {})
    # Unknown paths are refused afterwards, with those that may be set.
    rig_units = {f"{name}.{field}": q.unit for name, part in PARTS.items() for field, q in quantities(part).items()}

    def pair(key: str, unit: str) -> tuple[float, float] | None:
        if key not in table.entries:
            return None
        ends = _numbers(table, key, unit)
        if len(ends) != 2:
            raise InputError(f"{table.at(key)}: found {table.entries[key]}, expected the least and the greatest.")
        return ends[0], ends[1]

    return Limits(
        kinds=_texts(table, "kinds") or None,
        waveforms=_texts(table, "waveforms") or None,
        voltage=pair("voltage", "V"),
        frequency=pair("frequency", "Hz"),
        duty=_numbers(table, "duty", ""),
        amplitude=_numbers(table, "amplitude", "m"),
        interval=table.number("interval", "s", None),
        duration=table.number("duration", "s", None),
        noise=_by_kind(table, "noise", _unit),
        correlation_time=_by_kind(table, "correlation_time", lambda kind: "s"),
        range=_by_kind(table, "range", _unit),
        rig={path: _numbers(rig, path, rig_units.get(path, "")) for path in rig.entries},
        record_cost=table.number("record_cost", "", 1.0),
        second_cost=table.number("second_cost", "", 0.0),
    )


def _unit(kind: str) -> str:
    try:
        return member("study.measurement", kind)().unit
    except KeyError:
        return ""  # refused by name afterwards


def _texts(table: Table, key: str) -> tuple[str, ...]:
    names = table.get(key, list, "a list of names", [])
    if not all(isinstance(name, str) for name in names) or (key in table.entries and not names):
        raise InputError(f"{table.at(key)}: found {names}, expected a list of names.")
    return tuple(names)


def _numbers(table: Table, key: str, unit: str) -> tuple[float, ...]:
    entries = table.get(key, list, "a list of numbers", [])
    inner = Table(dict(enumerate(entries)), table.at(key))  # pyright: ignore[reportArgumentType]
    return tuple(inner.number(place, unit) for place in inner.entries)


def _by_kind(table: Table, key: str, unit: Callable[[str], str]) -> dict[str, float]:
    inner = table.table(key, 'a table by kind such as { effector = "..." }', {})
    return {kind: inner.number(kind, unit(kind)) for kind in inner.entries}


def read_knowledge(file: Path) -> Knowledge:
    """The values, covariance, misfit and parameters with open intervals in `file`, an estimate.json, for a plan.

    **Raises:** `InputError` if the file is missing or no estimate.
    """
    document = read_estimate(file)
    try:
        parameters = document["parameters"]
        values = {path: float(entry["value"]) for path, entry in parameters.items()}
        fitted = [r for r in document["records"] if r["role"] == "fit"]
        records = [(r["measures"], r.get("reduced_chi2") or float("nan")) for r in fitted]
        verdicts = {path: entry.get("interval_verdicts") or () for path, entry in parameters.items()}
        determined = any(entry.get("standard_error") for entry in parameters.values())
    except (KeyError, TypeError, ValueError, AttributeError):
        raise InputError(f"{file}: found no parameters and records, expected what pdssjax identify wrote.") from None
    known = read_covariance(file) if determined else None
    return Knowledge(
        values=values,
        **({} if known is None else {"names": known.names, "covariance": known.covariance}),
        misfit=misfit_by_kind(records),
        open=tuple(path for path, ends in verdicts.items() if "flat" in ends),
        source=f"estimate {file}",
    )
