"""Equality of results: dataclasses with arrays, which dataclasses themselves cannot compare."""

import dataclasses
from collections.abc import Mapping
from typing import TypeVar

import numpy as np

_Class = TypeVar("_Class", bound=type)


def equal_by_value(kind: _Class) -> _Class:
    """A decorator of dataclasses: two of them are equal where all their fields are, arrays number by number.

    NaN is equal to NaN: what has no number in one has none in the other.
    """

    def equal(self: object, other: object) -> bool:
        return same(self, other) if type(other) is type(self) else NotImplemented

    # As dataclasses that can be changed, or hold arrays, have none.
    kind.__eq__, kind.__hash__ = equal, None  # pyright: ignore[reportAttributeAccessIssue]
    return kind


def same(first: object, second: object) -> bool:
    """Whether two values have the same type and equal contents, nested ones included."""
    if first is second:
        return True
    if hasattr(first, "__array__") and hasattr(second, "__array__"):
        a, b = np.asarray(first), np.asarray(second)
        return a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind in "fc")
    if type(first) is not type(second):
        return False
    if dataclasses.is_dataclass(first) and not isinstance(first, type):
        fields = [field.name for field in dataclasses.fields(first) if field.compare]
        return all(same(getattr(first, name, None), getattr(second, name, None)) for name in fields)
    if isinstance(first, Mapping) and isinstance(second, Mapping):
        return first.keys() == second.keys() and all(same(first[key], second[key]) for key in first)
    if isinstance(first, tuple | list) and isinstance(second, tuple | list):
        return len(first) == len(second) and all(map(same, first, second))
    return bool(first == second) or (first != first and second != second)
