"""The interface of every error model: a model of the residuals, and the covariance of the parameters by it.

To first order errors e of a record's samples move the p parameters by G' e.  The fit has the n x p influence G
(`inference/uncertainty/influence.py`), the error model the covariance of e.  A member gives G' cov(e) G for each record
without an n x n matrix; records are independent of each other.
"""

import abc
from collections.abc import Sequence
from typing import ClassVar, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float


class RecordErrors(NamedTuple):
    """One record at the end of a fit, of n samples and p parameters.

    Residuals are whitened: divided by the noise given or estimated, a free zero taken out.
    """

    residual: Float[np.ndarray, " n"]
    """NaN is left out."""
    jacobian: Float[np.ndarray, "n p"]
    """Jacobian of `residual`, on the fit's scale."""
    influence: Float[np.ndarray, "n p"]
    """Change of each parameter per unit of each sample's residual, on the fit's scale."""
    time: Float[np.ndarray, " n"]
    """[s]"""
    frequency: float | None
    """Cycles of the drive a second [Hz]; None where it does not repeat."""
    variance_factor: float = 1.0
    """Variance of the whitened noise, by the residuals of all records whose noise is given."""
    freedom: float = float("inf")
    """Degrees of freedom that the fit leaves of the n samples; all of them where more than n."""
    noise_freedom: float = float("inf")
    """Degrees of freedom from which the size of white noise is known; infinite where it is given and not exceeded."""
    pooled: bool = False
    """Whether both degrees of freedom are those of all records whose noise is given, taken together."""
    outlying: Bool[np.ndarray, " n"] | None = None
    """Which samples stand out of the residuals: glitches, by their size noise and no misfit; None: no sample."""

    def finite(self) -> "RecordErrors":
        """The record without the samples that are NaN."""
        return self._only(np.isfinite(self.residual))

    def without_outliers(self) -> "RecordErrors":
        """The record without the samples that stand out."""
        return self if self.outlying is None else self._only(~self.outlying)

    def _only(self, kept: Bool[np.ndarray, " n"]) -> "RecordErrors":
        whole = self._replace(freedom=min(self.freedom, self.residual.size) - float(np.sum(~kept)))
        names = ["residual", "jacobian", "influence", "time"] + ["outlying"] * (self.outlying is not None)
        return whole._replace(**{name: getattr(self, name)[kept] for name in names})


class RecordShare(NamedTuple):
    """Contribution of one record's errors to the covariance of the parameters."""

    covariance: Float[np.ndarray, "p p"]
    """Covariance on the fit's scale."""
    evidence: float
    """Twice the gain in log-likelihood over the model before it, less twice the number of parameters (Akaike); 0 where
    the model does not apply."""
    freedom: float
    """Degrees of freedom of the noise that the covariance rests on."""
    pooled: bool = False
    """Whether `freedom` is that of all pooled records together."""


class AbstractErrorModel(eqx.Module):
    """A statistical model of the residuals of a fit."""

    rank: ClassVar[int]
    """Place in reports: from the strictest assumption to the weakest."""
    covers: ClassVar[str]
    """What the 95 % intervals cover, and under which assumption: a clause for reports."""

    @abc.abstractmethod
    def share(self, record: RecordErrors) -> RecordShare:
        """Contribution of a record's errors to the parameters' covariance; zero for a record without samples."""

    @property
    def name(self) -> str:
        """The name of the member's file, as reports and files write it."""
        return type(self).__module__.rpartition(".")[2].replace("_", "-")

    def covariance(self, records: Sequence[RecordErrors]) -> tuple[Float[np.ndarray, "p p"], list[float]]:
        """Covariance of the parameters on the fit's scale, and each record's evidence for this model."""
        shares = self.shares(records)
        return total_of(shares), [share.evidence for share in shares]

    def shares(self, records: Sequence[RecordErrors]) -> list[RecordShare]:
        """Contribution of the errors of each record to the parameters' covariance."""
        return [self.share(record.finite()) for record in records]


def total_of(shares: Sequence[RecordShare]) -> Float[np.ndarray, "p p"]:
    """Covariance of the parameters by all records, on the fit's scale."""
    return sum((share.covariance for share in shares), np.zeros_like(shares[0].covariance))
