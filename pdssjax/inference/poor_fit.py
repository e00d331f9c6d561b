"""Whether a fit is poor: which records it explains down to their noise, and which it does not.

Where a record's noise is given, its residuals are judged by chi-square.  Where it is not, the
noise is estimated from the residuals and chi-square is their number whatever the fit; the
witness then is the scatter of second differences (`metrics.scatter_floor`), which a smooth
misfit hardly enters.

In a wrong optimum that is nearly as good as the right one the records ask for different parameters long before their
residuals are visibly too large: each record has a wrong optimum of its own there, at other parameters.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ..metrics import lack_of_fit, neighbour_scatter, rounding_of_counts
from ..study import Agreement, FittedRecord, repeated_residuals
from .covariance import least_squares_covariance
from .diagnosis import records_agreement
from .fit_statistics import degrees_of_freedom, reduced_chi2
from .least_squares import Fit
from .problem import Problem
from .without_outliers import without_outliers

EXCESS = 1.2
"""Chi-square per degree of freedom below which an excess is not worth a word, however certain it is."""

ABOVE_FLOOR = 1.1
"""The same for residuals against the noise floor, as a ratio of standard deviations: the root of `EXCESS`."""

_POOR = 1.15
"""Reduced chi-square above which a fit is poor, where the noise is only guessed from the samples."""

FEWEST = 50
"""Samples from which second differences are a witness."""

SIGMAS = 4.0
"""Standard deviations beyond which an excess is not chance."""

DIGITS = 1e-9
"""Residuals over the swing of a record that no sensor resolves (30 bits): what rounding leaves of exact numbers."""

NOTICEABLE = 2.0
"""Standard errors by which records must move a parameter for their disagreement to count."""


def highest_by_chance(freedom: float) -> float:
    """Upper limit of chi-square per degree of freedom by chance, exceeded once in 30 000.

    The cube root of chi-square is nearly normal: E. B. Wilson and M. M. Hilferty, PNAS 17(12), 1931.
    """
    spread = 2.0 / (9.0 * max(freedom, 1.0))
    return float((1.0 - spread + SIGMAS * np.sqrt(spread)) ** 3)


def lowest_by_chance(freedom: float) -> float:
    """Lower limit of chi-square per degree of freedom by chance."""
    spread = 2.0 / (9.0 * max(freedom, 1.0))
    return float(max(1.0 - spread - SIGMAS * np.sqrt(spread), 0.0) ** 3)


def largest_by_chance(record: FittedRecord) -> float:
    """Chi-square per degree of freedom of a record whose noise is given, from which it is worth a word."""
    return max(EXCESS, highest_by_chance(_freedom(record)))


def exceeds_given_noise(record: FittedRecord) -> bool:
    """Chi-square against the noise given is beyond both chance and `EXCESS`; False where none is given.

    Of the samples that do not stand out.
    """
    return record.rest_chi2 > largest_by_chance(record)


def stays_below_given_noise(record: FittedRecord) -> bool:
    """Chi-square against the noise given is too small for chance, and for `EXCESS` the other way."""
    return record.reduced_chi2 < min(1.0 / EXCESS, lowest_by_chance(_freedom(record)))


def _freedom(record: FittedRecord) -> float:
    """Degrees of freedom that a fit has left of a record's samples: all of them where it is not known."""
    return record.chi2 / record.reduced_chi2 if record.chi2 > 0.0 and record.reduced_chi2 > 0.0 else record.samples


def above_floor(record: FittedRecord) -> float:
    """Residuals over the noise seen between neighbouring samples, as standard deviations; NaN where unknown.

    Of the samples that do not stand out, which neighbours show nothing of.
    """
    return record.rest_rmse / record.noise_floor


def exceeds_floor(record: FittedRecord) -> bool:
    """`above_floor` is beyond both chance and `ABOVE_FLOOR`; never said of fewer than `FEWEST` samples.

    Of white noise it is 1 with a standard deviation of 0.8/sqrt(samples), and 4.8/sqrt(samples) above
    1 at most in thousands of trials, since its upper tail is long.
    """
    least = max(ABOVE_FLOOR, 1.0 + 1.2 * SIGMAS / np.sqrt(record.samples))
    return record.samples >= FEWEST and above_floor(record) > least


def exceeds_noise(record: FittedRecord) -> bool:
    """Residuals are beyond the noise given, or where none is beyond that seen between neighbouring samples."""
    return exceeds_given_noise(record) or (record.noise_estimated and exceeds_floor(record))


def outliers_explain(record: FittedRecord) -> bool:
    """Residuals exceed the noise, but those of the samples that do not stand out do not."""
    whole = dataclasses.replace(record, outliers=record.outliers[:0], undisturbed=None)
    return record.outliers.size > 0 and exceeds_noise(whole) and not exceeds_noise(record)


def is_unresolved(rms: float, measured: Float[np.ndarray, " n"], noise: float | None) -> bool:
    """Whether residuals of this root mean square are smaller than a record can show, so that no pattern tells a misfit.

    They are smaller than the `noise` given beyond chance, no larger than the rounding of the counts of its sensor, or
    as small as rounding makes them of exact numbers.

    **Arguments:** `rms` and `noise` (None where not given) in the unit of the samples `measured`.
    """
    if rms <= max(ABOVE_FLOOR * rounding_of_counts(measured), DIGITS * float(np.ptp(measured))):
        return True
    return noise is not None and (rms / noise) ** 2 < min(1.0 / EXCESS, lowest_by_chance(measured.size))


def leaves_unresolved(record: FittedRecord) -> bool:
    """`is_unresolved` of what a fit leaves of a record, without the samples that stand out."""
    return is_unresolved(record.rest_rmse, record.measured, None if record.noise_estimated else record.noise)


def neighbour_correlation(record: FittedRecord) -> float:
    """Correlation of neighbouring residuals: 0 for white noise, towards 1 for a misfit that is smooth.

    Of the samples that do not stand out: a glitch of a few samples alone would make 0.6.
    """
    rest = record.rest
    return float(np.nansum(rest[1:] * rest[:-1]) / max(np.nansum(rest**2), 1e-300))


def rest_scatter(record: FittedRecord) -> float:
    """The noise that neighbouring residuals show, of the samples that do not stand out.

    Where a motion is sampled coarsely its own bends raise that of the samples, not that of what the model leaves.
    """
    rest = record.rest
    return neighbour_scatter(rest[np.isfinite(rest)])


def repeats(record: FittedRecord) -> bool:
    """Residuals that are large enough to tell repeat from cycle to cycle beyond chance: the model's misfit.

    So do those that a fit would leave that does not see samples that stand out: what these pull repeats, too.
    """
    found = record.lack_of_fit
    if found is None or record.frequency is None or not found.sigmas > SIGMAS or leaves_unresolved(record):
        return False
    if record.undisturbed is not None and record.outliers.size:
        found = lack_of_fit(record.rest, record.time, record.frequency)
    return found is not None and found.sigmas > SIGMAS


def contradicting(found: Sequence[Agreement]) -> list[Agreement]:
    """Which groups of records ask for other parameters than the rest: beyond chance, and visibly."""
    return [group for group in found if group.sigmas > SIGMAS and abs(group.largest()[1]) > NOTICEABLE]


def is_poor(fit: Fit, problem: Problem) -> bool:
    """The fit leaves more than noise, or records contradict each other there."""
    if leaves_more_than_noise(fit, problem):
        return True
    return bool(contradicting(records_agreement(problem, fit, enlarged_covariance(fit, problem))))


def enlarged_covariance(fit: Fit, problem: Problem) -> Float[np.ndarray, "p p"]:
    """The covariance of least squares on the fit's scale, enlarged where residuals exceed the noise given.

    NaN where a parameter has no information or is held at a bound.
    """
    held = problem.residual.transform.at_bound(fit.free)
    covariance = least_squares_covariance(np.asarray(fit.state.jacobian), held).matrix
    return covariance * max(1.0, reduced_chi2(fit, problem))


def leaves_more_than_noise(fit: Fit, problem: Problem) -> bool:
    """Residuals are more than noise: in their size, in what repeats every cycle, or in how neighbours are correlated.

    The size shows little where no noise is given, and a slip at a wrong moment hides in it.  Records that cannot show
    what is left of them (`is_unresolved`) have no say in the other two.  Samples that stand out do not make a fit poor,
    nor what they pull it off by: another optimum would leave them, too.
    """
    if not np.isfinite(fit.chi2):
        return True
    rest = without_outliers(problem, fit)
    parts = [rest.residual[rows] for rows in problem.rows]
    if _exceeds_noise(parts, fit, problem):
        return True
    judged = [
        (record, part)
        for record, part, noise in zip(problem.records, parts, problem.noise, strict=True)
        if not is_unresolved(float(noise) * _root_mean_square(part), record.measured, record.noise)
    ]
    samples = sum(int(np.sum(np.isfinite(part))) for _, part in judged)
    products = sum(np.nansum(part[1:] * part[:-1]) for _, part in judged)
    squares = sum(np.nansum(part**2) for _, part in judged)
    correlation = products / max(squares, 1e-300)
    found = [repeated_residuals(record, part) for record, part in judged]
    sigmas = [repeated.sigmas for repeated in found if repeated is not None]
    return bool(correlation * np.sqrt(samples) > SIGMAS or sum(sigmas) > SIGMAS * np.sqrt(len(sigmas)))


def _root_mean_square(part: Float[np.ndarray, " samples"]) -> float:
    """The root mean square of the residuals that are not NaN; 0 where all are."""
    finite = part[np.isfinite(part)]
    return float(np.sqrt(np.mean(finite**2))) if finite.size else 0.0


def _exceeds_noise(parts: Sequence[Float[np.ndarray, " samples"]], fit: Fit, problem: Problem) -> bool:
    """Whether residuals exceed the noise in size: of any record, all with noise given, or all others; without NaN.

    Each kind, and each record whose noise is given, by itself: many samples that are explained, or whose noise was
    estimated and so is as large as they are, hide what others leave.
    """
    is_given = [record.noise is not None for record in problem.records]
    alone = [part for part, given in zip(parts, is_given, strict=True) if given]
    found = [part for part, given in zip(parts, is_given, strict=True) if not given]
    loss, left = problem.residual.loss, degrees_of_freedom(fit, problem) / np.size(fit.state.residual)

    def exceeds(of_kind: Sequence[Float[np.ndarray, " samples"]], given: bool, least: float = 0.0) -> bool:
        kept = np.concatenate([np.zeros(0), *of_kind])
        kept = kept[np.isfinite(kept)]
        freedom = left * kept.size
        limit = max(highest_by_chance(loss.scatter_efficiency * freedom), least) if given else _POOR
        return bool(kept.size and not loss.scatter(kept, max(freedom, 1.0)) ** 2 < limit)

    return exceeds(alone, True) or exceeds(found, False) or any(exceeds([part], True, EXCESS) for part in alone)
