"""Coloured noise: neighbouring samples err alike, and what repeats every cycle is no noise.

    cov = sum over records of  G' C G + the sum over glitches of  g g'

C is the autocovariance of the record's noise (`metrics/coloured_noise.py`: `StationaryNoise` on an even time grid, else
`NoiseInTime`).  It is estimated from the residuals, less their mean over the cycles at each phase where the record
repeats.  Samples that stand out are no part of it, since ten among 3000 would colour all others:
those in a row are one glitch, independent of all else, which moves the parameters by g.  With the influence G of a
misspecified model
(H^-1 J', H with the residuals' curvature) this is the sandwich of H. White, Econometrica 50(1), 1982, with the
stationary noise of W. K. Newey and K. D. West, Econometrica 55(3), 1987, in its middle: it covers the pseudo-true
parameters, where the fit would end without noise.  L. Ljung, System Identification, 2nd ed., Prentice Hall 1999, 9.4,
has the case of an output-error model that is right.
"""

import numpy as np
from jaxtyping import Float

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
        moves = _by_glitches(record)
        by_size = moves.T @ moves
        record = record.without_outliers()
        if record.residual.size < 2:
            return RecordShare(record.influence.T @ record.influence + by_size, 0.0, 1.0)
        found = split_residuals(record.residual, record.time, record.frequency, record.freedom)
        covariance = record.influence.T @ found.noise.covariance_product(record.influence, record.time)
        freedom = max(found.freedom * found.noise.independent_share(record.time), 1.0)
        return RecordShare(covariance + by_size, found.noise.evidence(found.freedom, record.time), freedom)


def _by_glitches(record: RecordErrors) -> Float[np.ndarray, "k p"]:
    """Shift of the parameters by each of k glitches (runs of samples that stand out), on the fit's scale."""
    if record.outlying is None or not record.outlying.any():
        return np.zeros((0, record.influence.shape[1]))
    places = np.flatnonzero(record.outlying)
    begins = np.flatnonzero(np.diff(places, prepend=-2) > 1)
    return np.add.reduceat(record.residual[places, None] * record.influence[places], begins, axis=0)
