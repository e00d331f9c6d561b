"""Why an actuator cannot be simulated where a fit starts, and which parameter is to blame."""

from collections.abc import Iterator, Mapping

import jax
import numpy as np

from ..core import Quantity, display_unit
from ..integration import FAILURES
from ..study import Values, failures, predicted
from .problem import Problem

FACTORS = (0.3, 3.0, 0.1, 10.0, 0.01, 100.0, 0.001, 1000.0)
"""By which a parameter is changed to see whether it is the cause, the least change first."""

ELECTRONICS = ("amplifier", "sensor")
"""Parts of the rig whose parameters are changed first."""


def failed_start(problem: Problem, starts: Values) -> str:
    """One or two sentences: what fails, and the parameter with which it would not.

    **Arguments:** `problem` of a fit, and the `starts` [SI] of all parameters, at which some of its records cannot
    be simulated.  Every parameter is changed by itself, those of the rig's electronics first.
    """
    at = {path: float(number) for path, number in (problem.residual.fixed | dict(starts)).items()}
    codes = _codes(problem, at)
    failed = [record.name for record, code in zip(problem.records, codes, strict=True) if code]
    if not failed:
        return "its residuals are not finite"
    names = ", ".join(f'"{name}"' for name in failed)
    reason = f"in {names} {FAILURES[max(codes)]}"
    for path, declared, number in _changes(problem, at):
        if not any(_codes(problem, at | {path: number})):
            here, there = (_shown(value, declared) for value in (at[path], number))
            return f"{reason}. With {path} at {there} instead of {here} it can be: give that another start or value"
    return f"{reason}. No parameter changed by itself makes a difference: check the drive and all parameters"


def _codes(problem: Problem, values: Mapping[str, float]) -> list[int]:
    """For each record fitted an index into `FAILURES`; 0 where it can be simulated."""
    residual = problem.residual
    numbers = {path: np.asarray(number, float) for path, number in values.items()}
    motions = predicted(residual.predictor, numbers, residual.accuracy)
    finite = [bool(np.isfinite(motion).all()) for motion in jax.device_get(motions)]
    if all(finite):
        return [0] * len(finite)
    codes = failures(residual.predictor, numbers, residual.accuracy)
    return [0 if fine else int(code) or 2 for fine, code in zip(finite, codes, strict=True)]


def _changes(problem: Problem, at: Mapping[str, float]) -> Iterator[tuple[str, Quantity, float]]:
    """Other numbers for each parameter by itself, within its legal range."""
    declared = problem.residual.predictor.models.declared()
    paths = sorted((path for path in declared if path in at), key=lambda path: path.split(".")[0] not in ELECTRONICS)
    for factor in (None, *FACTORS):
        for path in paths:
            quantity = declared[path]
            number = quantity.nominal if factor is None else at[path] * factor
            if quantity.low <= number < quantity.high and number != at[path]:
                yield path, quantity, number


def _shown(number: float, declared: Quantity) -> str:
    unit, scale = display_unit(declared.unit)
    return f"{number * scale:.4g} {unit}".rstrip()
