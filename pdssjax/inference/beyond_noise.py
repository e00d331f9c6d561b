"""Tests whether the residuals of a record are more than its noise.

Where the noise is given, residuals are judged by chi-square.  Where it is not, it is estimated from the residuals, and
chi-square equals the number of samples for any fit; a misfit then shows beside the scatter of second differences
(`metrics.scatter_floor`), which a smooth misfit hardly enters.  Nor does noise whose neighbours are alike; but that is
as large along all of a record, and a misfit is not (`metrics.unevenness`).
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from ..metrics import lack_of_fit, neighbour_scatter, rounding_of_counts, unevenness
from ..study import FittedRecord

EXCESS = 1.2
"""Chi-square per degree of freedom below which an excess is not worth a note, however certain it is."""

ABOVE_FLOOR = 1.1
"""Residuals over the noise floor, as standard deviations, not worth a note below: the root of `EXCESS`."""

FEWEST_SAMPLES = 50
"""Samples from which second differences are a witness."""

SIGNIFICANT = 4.0
"""Standard deviations beyond which an excess is not chance."""

CORRELATED = 0.3
"""Correlation of neighbouring residuals from which they are no white noise."""

DIGITS = 1e-9
"""Residuals over the swing of a record that no sensor resolves (30 bits): what rounding leaves of exact numbers."""


def highest_by_chance(freedom: float) -> float:
    """Upper limit of chi-square per degree of freedom by chance, exceeded once in 30 000.

    The cube root of chi-square is nearly normal: E. B. Wilson and M. M. Hilferty, PNAS 17(12), 1931.
    """
    return _reduced_chi2(freedom, SIGNIFICANT)


def lowest_by_chance(freedom: float) -> float:
    """Lower limit of chi-square per degree of freedom by chance."""
    return _reduced_chi2(freedom, -SIGNIFICANT)


def _reduced_chi2(freedom: float, deviate: float) -> float:
    """Chi-square per degree of freedom at a normal `deviate`; 0 where there is none so low."""
    spread = 2.0 / (9.0 * max(freedom, 1.0))
    return float(max(1.0 - spread + deviate * np.sqrt(spread), 0.0) ** 3)


def largest_by_chance(freedom: float) -> float:
    """Chi-square per degree of freedom of one record up to which an excess over the given noise is chance or small."""
    return max(EXCESS, highest_by_chance(freedom))


def freedom_of(record: FittedRecord) -> float:
    """Degrees of freedom that a fit has left of a record's samples: their number where chi-square is not known."""
    return record.chi2 / record.reduced_chi2 if record.chi2 > 0.0 and record.reduced_chi2 > 0.0 else record.samples


def exceeds_given_noise(record: FittedRecord) -> bool:
    """Whether chi-square of the samples that do not stand out is beyond chance and `EXCESS` by the noise given.

    False where no noise is given.
    """
    return record.rest_chi2 > largest_by_chance(freedom_of(record))


def stays_below_given_noise(record: FittedRecord) -> bool:
    """Whether chi-square by the noise given is too small for chance and below 1 / `EXCESS`."""
    return record.reduced_chi2 < min(1.0 / EXCESS, lowest_by_chance(freedom_of(record)))


def above_floor(record: FittedRecord) -> float:
    """Residuals over the noise seen between neighbouring samples, as standard deviations; NaN where unknown.

    Samples that stand out are left out, since the scatter of neighbours ignores them, too.
    """
    return record.rest_rmse / record.noise_floor


def exceeds_floor(record: FittedRecord) -> bool:
    """Whether residuals exceed the noise floor beyond chance and `ABOVE_FLOOR`, and cannot be coloured noise.

    False of fewer than `FEWEST_SAMPLES` samples.  Of white noise the ratio is 1 with a standard deviation of
    0.8/sqrt(samples), and 4.8/sqrt(samples) above 1 at most in thousands of trials, since its upper tail is long.
    """
    least = max(ABOVE_FLOOR, 1.0 + 1.2 * SIGNIFICANT / np.sqrt(record.samples))
    return record.samples >= FEWEST_SAMPLES and above_floor(record) > least and not could_be_noise(record)


def could_be_noise(record: FittedRecord) -> bool:
    """Whether residuals may be noise of any colour: they do not repeat, and are as large along all of a record."""
    return not repeats(record) and unevenness(record.rest, record.time) <= SIGNIFICANT


def exceeds_noise(record: FittedRecord) -> bool:
    """Whether residuals exceed the noise given, or where none is that between neighbouring samples."""
    return exceeds_given_noise(record) or (record.noise_estimated and exceeds_floor(record))


def outliers_explain(record: FittedRecord) -> bool:
    """Whether residuals exceed the noise, but those of the samples that do not stand out do not."""
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
    """`is_unresolved` for the residuals of a record, without the samples that stand out."""
    return is_unresolved(record.rest_rmse, record.measured, None if record.noise_estimated else record.noise)


def neighbour_correlation(record: FittedRecord) -> float:
    """Correlation of neighbouring residuals: 0 for white noise, towards 1 for a misfit that is smooth.

    Samples that stand out are left out: one glitch of a few samples would make 0.6.
    """
    rest = record.rest
    return float(np.nansum(rest[1:] * rest[:-1]) / max(np.nansum(rest**2), 1e-300))


def rest_scatter(record: FittedRecord) -> float:
    """The noise that neighbouring residuals show, of the samples that do not stand out.

    A coarsely sampled motion raises the scatter of the samples, but not that of the residuals.
    """
    rest = record.rest
    return neighbour_scatter(rest[np.isfinite(rest)])


def repeats(record: FittedRecord) -> bool:
    """Whether residuals that are large enough to tell repeat from cycle to cycle beyond chance, as a misfit does.

    With outliers, the residuals of a fit without them must repeat, too: outliers shift the fit alike in every cycle.
    """
    found = record.lack_of_fit
    if found is None or record.frequency is None or not found.sigmas > SIGNIFICANT or leaves_unresolved(record):
        return False
    if record.undisturbed is not None and record.outliers.size:
        found = lack_of_fit(record.rest, record.time, record.frequency)
    return found is not None and found.sigmas > SIGNIFICANT


def neighbours_correlate(record: FittedRecord) -> bool:
    """Whether neighbouring residuals that are large enough to tell are correlated by more than `CORRELATED`."""
    return neighbour_correlation(record) > CORRELATED and not leaves_unresolved(record)


def leaves_white_noise(record: FittedRecord) -> bool:
    """Whether a fit leaves of a record no more than its noise, in which nothing repeats and no neighbours are alike."""
    return not (exceeds_noise(record) or repeats(record) or neighbours_correlate(record))
