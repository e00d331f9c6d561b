"""Takes a study's numbers from an earlier estimate, and tells which numbers are used and where they come from."""

import json
import math
import warnings
from collections.abc import Collection
from pathlib import Path
from typing import Any

from .errors import InputError, InputWarning, nearest
from .estimate import FORMAT
from .study import Study


def with_estimate(study: Study, file: Path) -> Study:
    """`study` with every parameter that `file`, an estimate.json, has a value of fixed at it.

    **Raises:** `InputError` if the file is missing or no estimate, or has a parameter that the
    study has not.  Warns with `InputWarning` if the fit did not converge.
    """
    values, converged = _read(file)
    legal = study.legal()
    for path in values:
        if path not in legal:
            raise InputError(
                f'{file}: found the parameter "{path}", which {study.path} has not; {nearest(path, legal)}'
            )
    if not converged:
        warnings.warn(f"{file}: the fit did not converge; its numbers are used all the same.", InputWarning, 2)
    return study.with_values(values, f"estimate {file}" + (" (not converged)" if not converged else ""))


def numbers_used(study: Study, but: Collection[str] = ()) -> dict[str, dict[str, Any]]:
    """By path, `value` [SI], `unit` and, in words, `source` of every listed parameter `but` those.

    **Raises:** `InputError` for parameters without a number.
    """
    told = study.parameters
    return {
        path: {"value": number, "unit": told[path].unit, "source": told[path].origin}
        for path, number in study.values(but).items()
    }


def _read(file: Path) -> tuple[dict[str, float], bool]:
    """The value of every parameter, and whether the fit converged."""
    try:
        document: Any = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{file}: there is no such file, expected an estimate.json.") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{file}: cannot be read ({error}), expected an estimate.json.") from None
    except json.JSONDecodeError as error:
        raise InputError(
            f"{file}: line {error.lineno}, column {error.colno}: found no valid JSON: {error.msg}."
        ) from None
    found = document.get("format") if isinstance(document, dict) else None
    if found != FORMAT:
        raise InputError(f'{file}: key "format": found {json.dumps(found)}, expected "{FORMAT}".')
    values = {}
    for path, entry in document["parameters"].items():
        value = entry.get("value")
        if not isinstance(value, int | float) or not math.isfinite(value):
            raise InputError(f'{file}: parameters: "{path}": found the value {value}, expected a number.')
        values[path] = float(value)
    return values, document.get("converged") is not False
