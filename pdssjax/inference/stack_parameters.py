"""Which free parameters and residuals belong to the stack, in fits that find it first."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool

from ..study import Record, split_path
from .problem import Problem

_PREFIXES = "piezo.", "amplifier.", "sensor."
"""Beginnings of the paths of the stack, its amplifier and its sensor."""


def platform_alone_records(records: Sequence[Record]) -> Bool[np.ndarray, " records"]:
    """Which of the records show the platform without the end-effector."""
    return np.array([record.measurement.platform_alone for record in records])


def stack_parameters(problem: Problem) -> Bool[np.ndarray, " p"]:
    """Which free parameters the first of two steps fits: the piezo's, and those of records of the platform alone.

    Piezo parameters that hold only in other records are excepted.
    """
    first = lambda path: path.startswith("piezo.") and shown_by_platform(path, problem)
    paths, records = problem.residual.transform.paths, problem.records
    return np.array([first(path) or _of_its_records(path, records) for path in paths], bool)


def stack_residuals(problem: Problem) -> Bool[np.ndarray, " n"]:
    """Which residuals the first of two steps uses: the platform's samples, and what was measured apart of the stack."""
    sizes = [record.time.size for record in problem.records]
    stack = dict(zip(problem.residual.transform.paths, stack_parameters(problem), strict=True))
    prior = np.array([stack[path] for path in problem.residual.prior.paths], bool)
    return np.concatenate([np.repeat(platform_alone_records(problem.records), sizes), prior])


def shown_by_platform(path: str, problem: Problem) -> bool:
    """Whether records of the platform alone show a parameter: the stack's, its amplifier's or its sensor's."""
    _, condition = split_path(path)
    if not condition:
        return path.startswith(_PREFIXES)
    here = [record for record in problem.records if condition in record.conditions]
    return _of_its_records(path, here) or (path.startswith(_PREFIXES) and bool(platform_alone_records(here).any()))


def platform_parameters(problem: Problem) -> Bool[np.ndarray, " p"]:
    """Which free parameters records of the platform alone show."""
    return np.array([shown_by_platform(path, problem) for path in problem.residual.transform.paths], bool)


def _of_its_records(path: str, records: Sequence[Record]) -> bool:
    """Whether a parameter holds in records of the platform alone, and in no others."""
    _, condition = split_path(path)
    here = [record for record in records if condition in record.conditions]
    return bool(here) and bool(platform_alone_records(here).all())
