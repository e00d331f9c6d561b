"""White noise: samples are independent, as least squares takes them.

    cov = (J' J)^-1

with the whitened Jacobian J, enlarged where the residuals exceed the noise given.
"""

from .base import AbstractErrorModel, RecordErrors, RecordShare


class White(AbstractErrorModel):
    """Independent noise of the standard deviation given, or that of the residuals."""

    rank = 0
    covers = "the true parameters, if the model is right and the noise of each sample is independent"

    def share(self, record: RecordErrors) -> RecordShare:
        covariance = record.variance_factor * record.influence.T @ record.influence
        return RecordShare(covariance, 0.0, record.noise_freedom, record.pooled)
