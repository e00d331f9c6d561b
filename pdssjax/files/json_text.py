"""JSON text of results: arrays as lists, null for what JSON has no number for."""

import json
import math
from typing import Any, TypeAlias

Plain: TypeAlias = Any
"""Data for JSON, with arrays and numbers that are not finite before `finite_numbers` replaces them."""


def json_text(document: object) -> str:
    """A `document` as the text of a file."""
    return json.dumps(finite_numbers(document), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def finite_numbers(value: Plain) -> Plain:
    """`value` with arrays as lists and with None for what JSON has no number for."""
    if isinstance(value, dict):
        return {key: finite_numbers(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [finite_numbers(entry) for entry in value]
    if hasattr(value, "tolist"):
        return finite_numbers(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value
