"""Coloured noise: neighbouring samples err alike, and what repeats every cycle is no noise.

    cov = sum over records of  G' C G

C is the autocovariance of the record's noise (`metrics/autocovariance.py`): of its residuals less their mean over the
cycles at each phase, where the record repeats, else of all its residuals.  With the influence G of a misspecified model
(H^-1 J', H with the residuals' curvature) this is the sandwich of H. White, Econometrica 50(1), 1982, with the
stationary noise of W. K. Newey and K. D. West, Econometrica 55(3), 1987, in its middle: it covers the pseudo-true
parameters, where the fit would end without noise.  L. Ljung, System Identification, 2nd ed., Prentice Hall 1999, 9.4,
has the case of an output-error model that is right.
"""

import numpy as np

from ...metrics import CycleSplit, StationaryNoise, grid_positions, split_by_phase, stationary_noise, stationary_product
from .base import AbstractErrorModel, RecordErrors, RecordShare


class Coloured(AbstractErrorModel):
    """Stationary noise, an autoregression of automatic order a record."""

    rank = 1
    covers = (
        "where the fit would end without noise (the pseudo-true parameters; the true ones, if the model is right), "
        "whatever the colour of the noise"
    )

    def share(self, record: RecordErrors) -> RecordShare:
        if record.residual.size < 2:
            return RecordShare(record.influence.T @ record.influence, 0.0)
        noise, freedom = noise_of(record, cycle_split(record))
        places = grid_positions(record.time)
        covariance = noise.autocovariance(int(places[-1]) + 1)
        evidence = 0.0
        if noise.coefficients.size:
            evidence = freedom * np.log(covariance[0] / noise.innovation) - 2.0 * noise.coefficients.size
        return RecordShare(stationary_product(covariance, record.influence, places), float(evidence))


def cycle_split(record: RecordErrors) -> CycleSplit | None:
    """What repeats of a record's residuals and what does not; None where it does not repeat."""
    return None if record.frequency is None else split_by_phase(record.residual, record.time, record.frequency)


def noise_of(record: RecordErrors, split: CycleSplit | None) -> tuple[StationaryNoise, float]:
    """The noise of a record without NaN, and its degrees of freedom.

    Variances are corrected for what the fit, or the mean at each phase, has taken out of the residuals.
    """
    places = grid_positions(record.time)
    if split is None:
        freedom = min(record.freedom, record.residual.size)
        return stationary_noise(record.residual, places, freedom, record.residual.size), freedom
    # Enlarged in the split by m/(m - 1) already: as many as there are, then.
    rest = split.rest
    freedom = float(np.sum(np.isfinite(rest)))
    return stationary_noise(rest, places, freedom, split.sizes.size // 2), freedom
