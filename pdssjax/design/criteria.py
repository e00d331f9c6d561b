"""Design criteria: a number by the information matrix of a plan, lower is better.

With the covariance C = M^-1 of the parameters on a relative scale, under each of several draws of what is not known
yet, whose mean is taken:

- "d": log det C / 2p, the logarithm of the mean axis of the confidence ellipsoid;
- "a": log(tr C / p) / 2, of the root mean square of all errors;
- "parameter": log(c' C c) / 2 of a named parameter, or the mean of several (c-optimality);
- "prediction": the same with c the gradient of a prediction, such as the mean speed at a voltage and frequency;
- "discrimination": minus the expected logarithm of the evidence ratio of two laws, under both.

A. C. Atkinson, A. N. Donev and R. D. Tobias, Optimum Experimental Designs, with SAS, Oxford 2007, chapters 10 and 20.
For laws that are linear about their fits the last is, of the difference d between the two predictions and the rival's
Jacobian J and information P known before, with the noise whitened,

    min over b of  |d - J b|^2 / 2 + b' P b / 2

the chi-square that the best rival leaves (G. E. P. Box and W. J. Hill, Technometrics 9(1), 1967), and the sum of this
and of the same with the laws exchanged.  Plans then are compared by the information of the columns [J, J_rival, d].
"""

import abc
import math
from typing import ClassVar

import equinox as eqx
import numpy as np
from jaxtyping import Float

from .information import inverse_of

CRITERIA = ("d", "a", "parameter", "prediction", "discrimination")
"""Names of the criteria."""


class AbstractCriterion(eqx.Module):
    """Compares plans by their information."""

    name: ClassVar[str]

    @abc.abstractmethod
    def of_draws(self, information: Float[np.ndarray, "*many draws q q"]) -> Float[np.ndarray, "*many draws"]:
        """The criterion under each draw; lower is better."""

    def __call__(self, information: Float[np.ndarray, "*many draws q q"]) -> Float[np.ndarray, "*many"]:
        """The mean over all draws."""
        return np.mean(self.of_draws(information), axis=-1)

    @property
    @abc.abstractmethod
    def measure(self) -> str:
        """The quantity that the criterion is a number of."""

    def figure(self, value: float) -> str:
        """The number that a `value` stands for, with its unit."""
        return f"{100.0 * float(np.exp(value)):.3g} %"

    def in_words(self, value: float, before: float = math.nan) -> str:
        """A value of the criterion in words, beside that `before` the plan where there is one."""
        return f"{self.measure} {self.figure(value)}" + ("" if math.isnan(before) else f" (now {self.figure(before)})")


class Determinant(AbstractCriterion):
    """D-optimality: the mean axis of the confidence ellipsoid of all parameters."""

    name: ClassVar = "d"

    def of_draws(self, information: Float[np.ndarray, "*many draws q q"]) -> Float[np.ndarray, "*many draws"]:
        return -0.5 * np.linalg.slogdet(information)[1] / information.shape[-1]

    @property
    def measure(self) -> str:
        return "mean axis of the confidence ellipsoid"


class Trace(AbstractCriterion):
    """A-optimality: the root mean square of the relative errors of all parameters."""

    name: ClassVar = "a"

    def of_draws(self, information: Float[np.ndarray, "*many draws q q"]) -> Float[np.ndarray, "*many draws"]:
        return 0.5 * np.log(np.mean(np.einsum("...ii->...i", inverse_of(information)), axis=-1))

    @property
    def measure(self) -> str:
        return "root mean square of the relative errors"


class Combinations(AbstractCriterion):
    """The mean log error of linear combinations of the parameters, such as those that are named."""

    name: ClassVar = "parameter"

    directions: Float[np.ndarray, "draws aims q"]
    """The coefficients of each combination under each draw, or one set for all draws."""
    what: str = eqx.field(static=True, default="the named parameters")

    def of_draws(self, information: Float[np.ndarray, "*many draws q q"]) -> Float[np.ndarray, "*many draws"]:
        covariance = inverse_of(information)
        variance = np.einsum("kai,...kij,kaj->...ka", self.directions, covariance, self.directions, optimize=True)
        return 0.5 * np.mean(np.log(np.maximum(variance, np.finfo(float).tiny)), axis=-1)

    @property
    def measure(self) -> str:
        several = self.directions.shape[-2] > 1
        return f"{'geometric mean of the relative errors' if several else 'relative error'} of {self.what}"


class Prediction(Combinations):
    """The log error of a prediction: its gradient by the parameters is the combination."""

    name: ClassVar = "prediction"


class Discrimination(AbstractCriterion):
    """Discrimination of a law from its rival, by information with the columns [J, J_rival, difference]."""

    name: ClassVar = "discrimination"

    own: int = eqx.field(static=True)
    """How many columns are the law's."""

    def of_draws(self, information: Float[np.ndarray, "*many draws q q"]) -> Float[np.ndarray, "*many draws"]:
        return -self.evidence(information)

    def evidence(self, information: Float[np.ndarray, "*many draws q q"]) -> Float[np.ndarray, "*many draws"]:
        """The expected logarithm of the evidence ratio of the right law to the other, the mean of both ways."""
        own, rival = (_remaining_chi2(information, part) for part in (slice(0, self.own), slice(self.own, -1)))
        return 0.5 * (own + rival)

    @property
    def measure(self) -> str:
        return "expected log evidence ratio of the right law"

    def figure(self, value: float) -> str:
        return f"{-value:.3g}"


def _remaining_chi2(information: Float[np.ndarray, "*many q q"], part: slice) -> Float[np.ndarray, "*many"]:
    """Half the chi-square of the difference, the last column, that a fit of the columns of a `part` leaves."""
    whole, mixed = information[..., -1, -1], information[..., part, -1]
    normal = information[..., part, part]
    explained = np.einsum("...i,...ij,...j->...", mixed, inverse_of(normal), mixed, optimize=True)
    return 0.5 * np.maximum(whole - explained, 0.0)
