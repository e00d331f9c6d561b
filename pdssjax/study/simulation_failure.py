"""Why records cannot be simulated, and which parameter causes it."""

from collections.abc import Iterator, Mapping, Sequence

import jax
import numpy as np

from ..core import Quantity, display_unit
from ..integration import FAILURES, Accuracy
from .models import Values
from .parameter_use import ELECTRONICS
from .prediction import Predictor, failures, predicted
from .record import Record


def failure_cause(predictor: Predictor, records: Sequence[Record], values: Values, accuracy: Accuracy) -> str:
    """What fails and the parameter with which it would not, in one or two sentences; "" where nothing fails.

    **Arguments:** the `records` that the `predictor` predicts, and the numbers [SI] of all parameters.  Every
    parameter is changed by itself, those of the rig's electronics first.
    """
    at = {path: float(number) for path, number in values.items()}
    codes = _codes(predictor, at, accuracy)
    failed = [record.name for record, code in zip(records, codes, strict=True) if code]
    if not failed:
        return ""
    names = ", ".join(f'"{name}"' for name in failed)
    reason = f"in {names} {FAILURES[max(codes)]}"
    for path, declared, number in _changes(predictor, at):
        if not any(_codes(predictor, at | {path: number}, accuracy)):
            unit, scale = display_unit(declared.unit)
            here, there = (f"{value * scale:.4g} {unit}".rstrip() for value in (at[path], number))
            return f"{reason}. With {path} at {there} instead of {here} it can be: give that another start or value"
    return f"{reason}. No parameter changed by itself makes a difference: check the drive and all parameters"


def _codes(predictor: Predictor, values: Mapping[str, float], accuracy: Accuracy) -> list[int]:
    """Why each record cannot be simulated, as an index into `FAILURES`; 0 where it can."""
    numbers = {path: np.asarray(number, float) for path, number in values.items()}
    motions = predicted(predictor, numbers, accuracy)
    finite = [bool(np.isfinite(motion).all()) for motion in jax.device_get(motions)]
    if all(finite):
        return [0] * len(finite)
    codes = failures(predictor, numbers, accuracy)
    return [0 if fine else int(code) or 2 for fine, code in zip(finite, codes, strict=True)]


def _changes(predictor: Predictor, at: Mapping[str, float]) -> Iterator[tuple[str, Quantity, float]]:
    """Other numbers for each parameter by itself, within its legal range: the nominal one, then the least change."""
    declared = predictor.models.declared()
    paths = sorted((path for path in declared if path in at), key=lambda path: path.split(".")[0] not in ELECTRONICS)
    for factor in (None, 0.3, 3.0, 0.1, 10.0, 0.01, 100.0, 0.001, 1000.0):
        for path in paths:
            quantity = declared[path]
            number = quantity.nominal if factor is None else at[path] * factor
            if quantity.low <= number < quantity.high and number != at[path]:
                yield path, quantity, number
