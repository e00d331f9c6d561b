"""Takes a study's numbers from an earlier estimate, so that what was identified can be used."""

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

from .errors import InputError, nearest
from .estimate import FORMAT
from .parameters import Parameter
from .study import Study


def with_estimate(study: Study, file: Path) -> Study:
    """`study` with every parameter that `file`, an estimate.json, has a value of fixed at it.

    **Raises:** `InputError` if the file is missing or no estimate, or has a parameter that the
    study has not.
    """
    values = _read(file)
    legal = study.legal()
    parameters = dict(study.parameters)
    for path, value in values.items():
        if path not in legal:
            raise InputError(
                f'{file}: found the parameter "{path}", which {study.path} has not; {nearest(path, legal)}'
            )
        parameters[path] = Parameter(path, legal[path].unit, legal[path], value=value)
    return dataclasses.replace(study, parameters=parameters)


def _read(file: Path) -> dict[str, float]:
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
    return values
