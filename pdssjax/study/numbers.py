"""Which numbers of a study's parameters are used, and where they come from."""

from collections.abc import Collection
from typing import Any

from .study import Study


def numbers_used(study: Study, but: Collection[str] = ()) -> dict[str, dict[str, Any]]:
    """By path, `value` [SI], `unit` and, in words, `source` of every listed parameter `but` those.

    **Raises:** `InputError` for parameters without a number.
    """
    told = study.parameters
    return {
        path: {"value": number, "unit": told[path].unit, "source": told[path].origin}
        for path, number in study.values(but).items()
    }
