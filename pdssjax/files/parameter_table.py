"""The [parameters] of a study file, legal and required ones with their entries.

And its [constraints], inequalities between two parameters.
"""

import dataclasses
import math
import re
import warnings
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from ..core import InputError, InputWarning, Quantity, check_range, nearest, unit_given
from ..study import MARK, Constraint, Parameter, Record, Study, bounded_by_constraints, chained, split_path
from .toml_table import Table


def read_parameters(top: Table, study: Study) -> dict[str, Parameter]:
    """The parameters in the table `top` of a study file, by path, in its order; `study` is without parameters."""
    legal = study.legal()
    table = _expanded(top.table("parameters", "a table of parameters"), legal)
    for path in table.entries:
        if any(known.startswith(f"{path}.") for known in legal):
            raise InputError(f'{table.where}: found {path} without quotes, expected the whole path as in "{path}....".')
        base, condition = split_path(path)
        if base not in legal:
            raise InputError(f'{table.where}: found the unknown parameter "{base}"; {nearest(base, legal)}')
        if MARK in path:
            _check_condition(table, base, condition, study.records)
    for path in _required(study, legal, table.entries):
        if path not in table.entries:
            expected = "expected a fixed one as in { value = ... } or a free one as in {}"
            raise InputError(f'{table.where}: the parameter "{path}" is missing, {expected}.')
    expected = "a table such as { start = ... }, { value = ... } or {}"
    entries = {path: Table(table.table(path, expected).entries, table.at(path)) for path in table.entries}
    return {path: _read_parameter(path, entry, legal[split_path(path)[0]]) for path, entry in entries.items()}


def _required(study: Study, legal: dict[str, Quantity], listed: Iterable[str]) -> list[str]:
    """The paths of the parameters that the study must list."""
    needed: set[str] = set().union(*(record.measurement.parts() for record in study.records))
    if not study.records:
        needed |= {"piezo", "friction", "effector"}
    if study.feedback:
        needed |= {"friction", "effector"}
    paths = [path for path, declared in legal.items() if not declared.optional and path.split(".")[0] in needed]
    if study.feedback and "piezo.mass" in legal:
        paths.append("piezo.mass")
    return [*paths, "amplifier.bandwidth"] if "amplifier.slew" in listed else paths


def _expanded(table: Table, legal: Iterable[str]) -> Table:
    """The table with "piezo.play_*" expanded to play_1, play_2, ..., except those that are listed themselves."""
    entries: dict[str, Any] = {}
    for path, entry in table.entries.items():
        base, mark, condition = path.partition(MARK)
        if not base.endswith("_*"):
            entries[path] = entry
            continue
        numbered_paths = re.compile(re.escape(base.removesuffix("*")) + r"\d+")
        numbered = [f"{known}{mark}{condition}" for known in legal if numbered_paths.fullmatch(known)]
        if not numbered:
            raise InputError(f'{table.where}: found "{path}", but no numbered parameter of that name is known.')
        entries |= {known: entry for known in numbered if known not in table.entries}
    return dataclasses.replace(table, entries=entries)


def _check_condition(table: Table, base: str, condition: str, records: Sequence[Record]) -> None:
    """Check that a parameter under a condition has records, a number without the condition, and no rival."""
    where, known = f'{table.where}: "{base}{MARK}{condition}"', sorted({c for r in records for c in r.conditions})
    if condition not in known:
        hint = nearest(condition, known) if known else 'no record has any, as in conditions = ["wet"].'
        raise InputError(f'{where}: found the condition "{condition}" that no record has; {hint}')
    if base not in table.entries:
        raise InputError(f'{where}: the parameter "{base}" is missing, expected it for records without the condition.')
    for record in records:
        rivals = [c for c in record.conditions if c != condition and f"{base}{MARK}{c}" in table.entries]
        if condition in record.conditions and rivals:
            raise InputError(
                f'{where}: record "{record.name}" also has the condition "{rivals[0]}" with a "{base}" of its own, '
                "expected one of them."
            )


def _read_parameter(path: str, table: Table, quantity: Quantity) -> Parameter:
    """The parameter `path` of a `table`, free unless it has a value.

    A value with a standard error was measured apart: the parameter is free, and the fit uses the value as one more
    measurement.
    """
    table.only(["value", "start", "min", "max", "standard_error"])
    given, error = table.entries, table.number("standard_error", quantity.unit, None)
    if "value" in given and error is None:
        if extra := next((key for key in given if key != "value"), None):
            raise InputError(f'{table.where}: found "value" together with "{extra}", expected one or the other.')
        return Parameter(path, quantity.unit, quantity, value=table.quantity("value", quantity))
    if error is not None and ("value" not in given or "start" in given):
        raise InputError(f'{table.where}: found "standard_error", expected it beside the "value" that was measured.')
    if error is not None and not 0 < error < math.inf:
        raise InputError(f"{table.at('standard_error')}: found {error} {quantity.unit}, expected a number above 0.")
    key = "start" if error is None else "value"
    start = table.quantity(key, quantity) if key in given else None
    low, high = _bound(table, "min", quantity, quantity.low), _bound(table, "max", quantity, quantity.high)
    _check_order(table, key, quantity, start, low, high)
    return Parameter(path, quantity.unit, quantity, start=start, low=low, high=high, standard_error=error)


def _bound(table: Table, key: str, quantity: Quantity, end: float) -> float | None:
    """The bound in a `table`; None without one, or where it only repeats the `end` of the legal range."""
    bound = table.number(key, quantity.unit, None)
    if bound is None or bound == end:
        return None
    check_range(bound, quantity, table.at(key), table.entries[key])
    return bound


def _check_order(
    table: Table, key: str, quantity: Quantity, start: float | None, low: float | None, high: float | None
) -> None:
    wrong = "min" if low is not None and high is not None and low >= high else key
    unit, size = unit_given(table.entries.get(wrong), quantity.unit)
    text = lambda number: f"{number / size:g} {unit}".rstrip()
    if low is not None and high is not None and low >= high:
        raise InputError(f"{table.at('min')}: found {text(low)}, expected less than the max, {text(high)}.")
    if start is not None and low is not None and start < low:
        raise InputError(f"{table.at(key)}: found {text(start)}, expected at least the min, {text(low)}.")
    if start is not None and high is not None and start > high:
        raise InputError(f"{table.at(key)}: found {text(start)}, expected at most the max, {text(high)}.")


_NUMBER = r"\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?"

_SIDE = rf"(?:({_NUMBER})\s*\*\s*)?(\S.*?)"

CONSTRAINT_EXAMPLE = "friction.f_s >= 1.1 * friction.f_c"
"""A constraint as in a study."""


def read_constraints(top: Table, parameters: Mapping[str, Parameter]) -> tuple[Constraint, ...]:
    """The constraints between the `parameters` in the table `top` of a study file.

    Warns with `InputWarning` where starts break one.
    """
    table = top.table("constraints", f'a table of texts such as "{CONSTRAINT_EXAMPLE}"', {})
    found = tuple(_read_constraint(table, name, parameters) for name in table.entries)
    bounded = bounded_by_constraints(parameters, found, top.where)
    chained(bounded, found, top.where)
    for constraint in found:
        greater, lesser = parameters[constraint.greater], parameters[constraint.lesser]
        if greater.number is None or lesser.number is None or constraint.holds(greater.number, lesser.number):
            continue
        at = f"{greater.path} at {greater.number:g} and {lesser.path} at {lesser.number:g} {lesser.unit}".rstrip()
        warnings.warn(
            f"{table.at(constraint.name)}: found starts that break {constraint.text} ({at}); the fit begins with both "
            "at the limit of the constraint.",
            InputWarning,
            stacklevel=4,
        )
    return found


def _read_constraint(table: Table, name: str, parameters: Mapping[str, Parameter]) -> Constraint:
    expected = f'an inequality between two parameters such as "{CONSTRAINT_EXAMPLE}"'
    text = table.text(name, expected)
    read = re.fullmatch(rf"\s*{_SIDE}\s*(>=|<=)\s*{_SIDE}\s*", text)
    if read is None:
        raise InputError(f'{table.at(name)}: found "{text}", expected {expected}.')
    first, sign, second = (read[1], read[2]), read[3], (read[4], read[5])
    for _, path in (first, second):
        if re.fullmatch(rf"[+-]?(?:{_NUMBER})\b.*", path):
            detail = 'a number is a bound: "min" or "max" of the parameter'
            raise InputError(f'{table.at(name)}: found "{text}", expected {expected}; {detail}.')
        if path not in parameters:
            raise InputError(f'{table.at(name)}: found the unknown parameter "{path}"; {nearest(path, parameters)}')
    (more, greater), (less, lesser) = (first, second) if sign == ">=" else (second, first)
    units = [parameters[path].unit for path in (greater, lesser)]
    if units[0] != units[1]:
        detail = " and ".join(f"{path} in {unit or '1'}" for path, unit in zip((greater, lesser), units, strict=True))
        raise InputError(f"{table.at(name)}: found {detail}, expected two parameters of the same unit.")
    factor = float(less or 1.0) / (float(more or 1.0) or math.nan)
    if not 0.0 < factor < math.inf:
        raise InputError(f'{table.at(name)}: found "{text}", expected factors above 0.')
    return Constraint(name, greater, lesser, factor)
