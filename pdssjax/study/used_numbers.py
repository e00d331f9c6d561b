"""Which numbers of a study's parameters are used, and where they come from."""

from collections.abc import Collection
from typing import NotRequired, TypedDict

from .study import Study


class UsedNumber(TypedDict):
    """The number of a parameter, as plain data."""

    value: float
    """In SI."""
    unit: str
    source: str
    """Where it comes from, in words."""
    standard_error: NotRequired[float]
    """In SI; where the points of a sweep scatter about the value."""


def numbers_used(study: Study, but: Collection[str] = ()) -> dict[str, UsedNumber]:
    """By path, the number of every listed parameter `but` those.

    **Raises:** `InputError` for parameters without a number.
    """
    told = study.parameters
    return {
        path: {"value": number, "unit": told[path].unit, "source": told[path].origin}
        for path, number in study.values(but).items()
    }
