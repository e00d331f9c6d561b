"""Validation: whether records that were not fitted are predicted to within noise and parameter errors.

They are a witness that no fit has pulled towards itself: a wrong optimum that explains what was fitted misses them.
What parameters would mend within their errors is not held against it: such records are judged by what

    |r(d)|^2 + d' C^-1 d

leaves of their residuals r where it is least, over steps d of the parameters with their covariance C.  A step beyond
what chance makes of errors mends nothing.
"""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..core import on_device
from ..study import FittedRecord, Record, Study, compare, paths_in
from .beyond_noise import exceeds_noise
from .covariance import correlation
from .initial_values.record_features import noise_of
from .losses.base import AbstractLoss
from .prior import is_by_chance
from .problem import Problem
from .residual import Residual, free_offset

_UNINFORMATIVE_STD = 1e3
"""Standard deviation, on the fit's scale, of a parameter without information in the fitted records."""

_ROUNDS = 3
"""Rounds of looking for samples that stand out: what parameters explain hides them."""

_EVALUATIONS = 30
"""Largest number of evaluations in each round."""


class MissedRecord(NamedTuple):
    """A record that was not fitted and is not predicted down to its noise."""

    record: FittedRecord
    """The record beside its prediction, at the parameters it may move to where all are those of fitted records."""
    unknown: tuple[str, ...]
    """The free parameters of its own that hold in no fitted record, and may be all that is wrong."""


def missed_records(
    study: Study, problem: Problem, free: Float[np.ndarray, " p"], covariance: Float[np.ndarray, "p p"]
) -> tuple[MissedRecord, ...]:
    """The records that were not fitted and leave more than noise, also where parameters move within their errors.

    **Arguments:** the point `free` that the fit ended at, without samples that stand out, and the `covariance` on the
    fit's scale, NaN where a parameter has no information or is held.
    """
    motions, loss = problem.motions(problem.residual.values(free)), problem.residual.loss
    # The free parameters of each record that is not fitted which hold in no fitted record.
    declared = {path for path, parameter in study.parameters.items() if parameter.free}
    hold = {r.name: declared & {*paths_in(study.parameters, r.conditions).values()} for r in study.records}
    fitted = {path for record in study.records if record.role == "fit" for path in hold[record.name]}
    unknown = {r.name: tuple(sorted(hold[r.name] - fitted)) for r in study.records if r.role != "fit"}
    unfitted = [(r, motion) for r, motion in zip(study.records, motions, strict=True) if r.role != "fit"]
    local = [_compare_at(record, motion, loss) for record, motion in unfitted if unknown[record.name]]
    judged = [_compare_at(record, motion, loss) for record, motion in unfitted if not unknown[record.name]]
    if any(map(exceeds_noise, judged)):
        records = tuple(record for record, _ in unfitted if not unknown[record.name])
        judged = _within_errors(records, judged, study, problem, free, covariance)
    return tuple(MissedRecord(found, unknown[found.name]) for found in (*judged, *local) if exceeds_noise(found))


def is_refuted(missed: Sequence[MissedRecord]) -> bool:
    """Whether a record without parameters of its own is `missed`: the model or the optimum does not carry over."""
    return any(not record.unknown for record in missed)


def _compare_at(record: Record, motion: Float[np.ndarray, " samples"], loss: AbstractLoss) -> FittedRecord:
    noise = noise_of(record)
    zero = free_offset(record.measured, motion, record.offset, loss, noise)
    return compare(record, motion, noise=noise, offset=zero, undisturbed=motion)


def _within_errors(
    records: tuple[Record, ...],
    found: list[FittedRecord],
    study: Study,
    problem: Problem,
    free: Float[np.ndarray, " p"],
    covariance: Float[np.ndarray, "p p"],
) -> list[FittedRecord]:
    """The `records` beside their predictions by parameters that move within their errors to explain them all."""
    from scipy.optimize import least_squares  # it takes long to import

    residual, noise = problem.residual, np.array([noise_of(record) for record in records])
    fixed = {path: float(number) for path, number in residual.fixed.items()}
    # As if they were fitted: those are the records that have derivatives to their end.
    fitted = tuple(dataclasses.replace(record, role="fit") for record in records)
    unseen = Residual.of(study.models, fitted, residual.transform, fixed, residual.accuracy)
    whole = Problem(unseen, fitted, noise, predictor=on_device(unseen.predictor), places=tuple(range(len(fitted))))
    # A root of the covariance turns independent errors of standard deviation 1 into those of parameters.
    deviation, held = np.sqrt(np.diag(covariance)), residual.transform.at_bound(free)
    known = np.isfinite(deviation) & (deviation > 0.0)
    sizes, axes = np.linalg.eigh(correlation(covariance[np.ix_(known, known)]))
    of_known = np.zeros((deviation.size, sizes.size))
    of_known[known] = deviation[known, None] * axes * np.sqrt(np.maximum(sizes, 0.0))
    of_unknown = _UNINFORMATIVE_STD * np.eye(deviation.size)[:, ~np.isfinite(deviation) & ~held]
    root, whitened = np.hstack([of_known, of_unknown]), np.asarray(whole.whitened(free))
    motions, errors = [record.predicted - record.offset for record in found], np.zeros(root.shape[1])
    at = lambda errors: np.clip(free + root @ errors, *whole.bounds)
    # What cannot be derived moves nothing.
    slope = lambda errors: np.nan_to_num(np.asarray(whole.jacobian(at(errors))), posinf=0.0, neginf=0.0) @ root
    for _ in range(_ROUNDS if errors.size else 0):
        used = np.isfinite(whitened)
        for record, rows in zip(found, whole.rows, strict=True):
            used[rows][record.outliers] = False
        left = lambda errors, used=used: np.append(np.asarray(whole.whitened(at(errors)))[used], errors)
        slopes = lambda errors, used=used: np.vstack([slope(errors)[used], np.eye(errors.size)])
        errors = least_squares(left, errors, slopes, max_nfev=_EVALUATIONS).x  # pyright: ignore[reportArgumentType]
        errors = errors * is_by_chance(errors)
        moves = np.asarray(whole.whitened(at(errors))) - whitened
        beside = [m - s * moves[rows] for m, s, rows in zip(motions, noise, whole.rows, strict=True)]
        found = [_compare_at(record, motion, residual.loss) for record, motion in zip(records, beside, strict=True)]
    return found
