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

from ....metrics import grid_positions, split_residuals, stationary_product
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
        found = split_residuals(record.residual, record.time, record.frequency, record.freedom)
        places, order = grid_positions(record.time), found.noise.coefficients.size
        covariance = found.noise.autocovariance(int(places[-1]) + 1)
        evidence = 0.0
        if order:
            evidence = found.freedom * np.log(covariance[0] / found.noise.innovation) - 2.0 * order
        return RecordShare(stationary_product(covariance, record.influence, places), float(evidence))
