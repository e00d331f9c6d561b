"""What a fit tells beside its numbers, in one result."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from ...study import Agreement, Diagnosis, Record
from ..least_squares import Fit
from ..problem import Problem
from .agreement import agreement, score_of, white_score
from .combinations import best_remedy, combinations


def diagnose(problem: Problem, fit: Fit, covariance: Float[np.ndarray, "p p"]) -> Diagnosis:
    """Combinations that the data determine, what would help, and records that disagree.

    **Arguments:** the `covariance` on the fit's scale, NaN where a parameter has no information or is held.
    """
    transform = problem.residual.transform
    found = problem.decode(fit.free)
    values = np.array([abs(float(found[path])) for path in transform.paths])
    relative = np.where(values > 0.0, np.abs(transform.slope(fit.free)) / np.where(values > 0.0, values, 1.0), np.nan)
    changes = covariance * np.outer(relative, relative)
    parts = records_agreement(problem, fit, covariance)
    return Diagnosis(combinations(changes, transform.paths), best_remedy(changes, transform.paths), parts)


def records_agreement(problem: Problem, fit: Fit, covariance: Float[np.ndarray, "p p"]) -> tuple[Agreement, ...]:
    """How far records, and groups of them, disagree with the others at the joint optimum next to the `fit`.

    **Arguments:** as of `diagnose`.
    """
    known = np.flatnonzero(np.isfinite(np.diag(covariance)))
    groups = record_groups(problem.records)
    if not (groups and known.size):
        return ()
    residual, jacobian = np.asarray(fit.state.residual), np.asarray(fit.state.jacobian)[:, known]
    scores = [score_of(residual[rows], jacobian[rows]) for rows in problem.rows]
    apart = white_score(residual[problem.rows_apart], jacobian[problem.rows_apart])
    errors = np.sqrt(np.diag(covariance))[known]
    return agreement(scores, apart, groups, errors, [problem.residual.transform.paths[i] for i in known])


def record_groups(records: Sequence[Record]) -> dict[tuple[str, tuple[str, ...]], Bool[np.ndarray, " records"]]:
    """Every record by itself, and those that have their direction or kind in common; by what, and their names."""
    count = len(records)
    gathered = {("record", str(i)): [i] for i in range(count)}
    for i, record in enumerate(records):
        gathered.setdefault(("kind", record.measures), []).append(i)
        if direction := _direction(record):
            gathered.setdefault(("direction", direction), []).append(i)
    groups = {}
    for (what, _), members in gathered.items():
        if len(members) < count and (what == "record" or len(members) > 1):
            names = tuple(records[i].name for i in members)
            groups[what, names] = np.isin(np.arange(count), members)
    return groups


def _direction(record: Record) -> str:
    """Where the slow flank of its drive leads; "" where it has none."""
    flanks = None if record.drive is None else record.drive.flanks()
    return "" if flanks is None else "forward" if float(flanks.slope) > 0.0 else "backward"
