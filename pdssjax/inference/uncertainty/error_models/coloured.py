"""Coloured noise: neighbouring samples err alike, and what repeats every cycle is no noise.

    cov = sum over records of  G' C G

C is the autocovariance of the record's noise (`metrics/autocovariance.py`, at uneven times
`metrics/noise_at_times.py`): of its residuals less their mean over the cycles at each phase, where the record repeats,
else of all its residuals.  With the influence G of a misspecified model
(H^-1 J', H with the residuals' curvature) this is the sandwich of H. White, Econometrica 50(1), 1982, with the
stationary noise of W. K. Newey and K. D. West, Econometrica 55(3), 1987, in its middle: it covers the pseudo-true
parameters, where the fit would end without noise.  L. Ljung, System Identification, 2nd ed., Prentice Hall 1999, 9.4,
has the case of an output-error model that is right.
"""

from ....metrics import split_residuals
from .base import AbstractErrorModel, RecordErrors, RecordShare


class Coloured(AbstractErrorModel):
    """Stationary noise, of a colour of its own in every record."""

    rank = 1
    covers = (
        "where the fit would end without noise (the pseudo-true parameters; the true ones, if the model is right), "
        "whatever the colour of the noise"
    )

    def share(self, record: RecordErrors) -> RecordShare:
        if record.residual.size < 2:
            return RecordShare(record.influence.T @ record.influence, 0.0, 1.0)
        found = split_residuals(record.residual, record.time, record.frequency, record.freedom)
        covariance = record.influence.T @ found.noise.times(record.influence, record.time)
        freedom = max(found.freedom * found.noise.independent(record.time), 1.0)
        return RecordShare(covariance, found.noise.evidence(found.freedom, record.time), freedom)
