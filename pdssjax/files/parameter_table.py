"""A parameter, as its entry in a study's [parameters] describes it."""

from ..core import InputError, Quantity, check_range
from ..study import Parameter
from .toml_table import Table


def read_parameter(path: str, table: Table, quantity: Quantity) -> Parameter:
    """The parameter `path` as the `table` of its entry describes it: free unless it has a value.

    **Raises:** `InputError` if a number is outside the quantity's legal range, the start
    outside its bounds, the bounds crossed, or a value given together with any of them.
    """
    table.only(["value", "start", "min", "max"])
    fixed = "value" in table.entries
    if fixed and len(table.entries) > 1:
        extra = next(key for key in table.entries if key != "value")
        raise InputError(f'{table.where}: found "value" together with "{extra}", expected one or the other.')
    if fixed:
        return Parameter(path, quantity.unit, quantity, value=table.quantity("value", quantity))
    start = table.quantity("start", quantity) if "start" in table.entries else None
    low, high = _bound(table, "min", quantity, quantity.low), _bound(table, "max", quantity, quantity.high)
    _check_order(table, quantity, start, low, high)
    return Parameter(path, quantity.unit, quantity, start=start, low=low, high=high)


def _bound(table: Table, key: str, quantity: Quantity, end: float) -> float | None:
    """A bound given; None also where it only repeats the `end` of the legal range."""
    bound = table.number(key, quantity.unit, None)
    if bound is None or bound == end:
        return None
    check_range(bound, quantity, table.at(key))
    return bound


def _check_order(table: Table, quantity: Quantity, start: float | None, low: float | None, high: float | None) -> None:
    unit = f" {quantity.unit}".rstrip()
    if low is not None and high is not None and low >= high:
        raise InputError(f"{table.at('min')}: found {low:g}{unit}, expected less than the max, {high:g}{unit}.")
    if start is not None and low is not None and start < low:
        raise InputError(f"{table.at('start')}: found {start:g}{unit}, expected at least the min, {low:g}{unit}.")
    if start is not None and high is not None and start > high:
        raise InputError(f"{table.at('start')}: found {start:g}{unit}, expected at most the max, {high:g}{unit}.")
