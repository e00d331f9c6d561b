"""The Fisher information matrix of a planned record, under white or coloured noise.

With the Jacobian J of a record's prediction at n sample times and the covariance S of its noise the information is
J' S^-1 J.  The noise is an Ornstein-Uhlenbeck process of standard deviation s and correlation time T, whose samples at
times t_i correlate by r_i = exp(-(t_i - t_(i-1)) / T), however uneven these are.  Its inverse covariance is
tridiagonal, so that whitening takes one difference of neighbours (white noise: r = 0):

    w_1 = j_1 / s,    w_i = (j_i - r_i j_(i-1)) / (s sqrt(1 - r_i^2))

(C. E. Rasmussen and C. K. I. Williams, Gaussian Processes for Machine Learning, MIT Press 2006, appendix B.)  A free
zero adds one column of ones, which the projection onto its orthogonal complement eliminates: what is left is the
information with the zero unknown.  Informations of records add up.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..core import InputError
from ..metrics import NoiseInTime

NULL_EIGENVALUE = 1e-11
"""Eigenvalue of the scaled information below which a direction is not determined: an error of 3e5 times the least."""

TAKES_PART = 0.02
"""Exponent, against the largest, below which a parameter is left out of a combination."""


class Noise(NamedTuple):
    """The noise of a sensor: an Ornstein-Uhlenbeck process, or white."""

    deviation: float
    """Standard deviation, in the unit of the measurement."""
    correlation_time: float = 0.0
    """Time [s] after which samples correlate by 1/e; 0 for white noise."""

    def correlations(self, times: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n-1"]:
        """Correlation of each sample with the one before it; `times` [s] increase."""
        if self.correlation_time == 0.0:
            return np.zeros(times.size - 1)
        return np.exp(-np.diff(times) / self.correlation_time)

    def drawn(self, times: Float[np.ndarray, " n"], random: np.random.Generator) -> Float[np.ndarray, " n"]:
        """One realisation at `times` [s], in the unit of the measurement."""
        steps = random.normal(0.0, 1.0, times.size)
        drawn = steps.copy()
        for i, correlation in enumerate(self.correlations(times), start=1):
            drawn[i] = correlation * drawn[i - 1] + math.sqrt(1.0 - correlation**2) * steps[i]
        return self.deviation * drawn

    def covariance_product(
        self, columns: Float[np.ndarray, "n q"], times: Float[np.ndarray, " n"]
    ) -> Float[np.ndarray, "n q"]:
        """The covariance of the noise at `times` [s], which ascend, times the `columns`."""
        slow = 1.0 if self.correlation_time else 0.0
        noise = NoiseInTime(self.deviation**2, slow, self.correlation_time or 1.0)
        return noise.covariance_product(columns, times)


def whitened(
    columns: Float[np.ndarray, "n q"], times: Float[np.ndarray, " n"], noise: Noise
) -> Float[np.ndarray, "n q"]:
    """The `columns` of a record times the root of the inverse covariance of its `noise` at `times` [s]."""
    out = columns / noise.deviation
    if noise.correlation_time:
        correlation = noise.correlations(times)[:, None]
        innovation = np.sqrt(-np.expm1(-2.0 * np.diff(times) / noise.correlation_time))[:, None]
        out[1:] = (out[1:] - correlation * out[:-1]) / innovation
    return out


def record_information(
    columns: Float[np.ndarray, "n q"], times: Float[np.ndarray, " n"], noise: Noise
) -> Float[np.ndarray, "q q"]:
    """The information of one record on the q unknowns whose Jacobian is `columns`, its zero free."""
    white = whitened(columns, times, noise)
    zero = whitened(np.ones((times.size, 1)), times, noise)[:, 0]
    white = white - np.outer(zero, zero @ white / (zero @ zero))
    return white.T @ white


def least_squares_errors(
    records: Sequence[tuple[Float[np.ndarray, "n q"], Float[np.ndarray, " n"], Noise]],
    prior: Float[np.ndarray, "q q"],
) -> Float[np.ndarray, "q q"]:
    """Covariance that ordinary least squares with free zeros has under coloured noise: H^-1 (J' S J) H^-1.

    A fit that does not whiten its residuals, as `identify`, reaches this and not the inverse of the information.

    **Arguments:** of each of the `records` Jacobian, times [s] and noise; the information known before is `prior`.
    """
    normal, middle = prior.copy(), prior.copy()
    for columns, times, noise in records:
        centred = (columns - columns.mean(axis=0)) / noise.deviation**2
        normal += centred.T @ columns
        middle += centred.T @ noise.covariance_product(centred, times)
    inverse = inverse_of(normal)
    return inverse @ middle @ inverse


def inverse_of(information: Float[np.ndarray, "*many q q"]) -> Float[np.ndarray, "*many q q"]:
    """The covariance, by a matrix whose diagonal is one: parameters may differ in scale by any factor."""
    scale = np.sqrt(np.maximum(np.einsum("...ii->...i", information), np.finfo(float).tiny))
    pairs = scale[..., :, None] * scale[..., None, :]
    return np.linalg.inv(information / pairs) / pairs


class Unseen(NamedTuple):
    """A combination of parameters that the information says nothing about."""

    exponents: dict[str, float]
    """By path; along it the product of p**exponent changes while no record does.  The largest is 1."""

    @property
    def words(self) -> str:
        """The combination in words, for use within a sentence."""
        if len(self.exponents) == 1:
            return next(iter(self.exponents))
        return " * ".join(path if math.isclose(e, 1.0) else f"{path}^{e:.2g}" for path, e in self.exponents.items())


def unseen_combinations(information: Float[np.ndarray, "q q"], paths: Sequence[str]) -> list[Unseen]:
    """The combinations of parameters without information: the null vectors of the scaled matrix, in their names.

    **Arguments:** `information` of parameters on a relative scale, by the `paths` of its rows.
    """
    diagonal = np.diag(information)
    largest = float(np.max(diagonal, initial=0.0))
    informed = diagonal > NULL_EIGENVALUE * NULL_EIGENVALUE * largest
    found = [Unseen({paths[int(i)]: 1.0}) for i in np.flatnonzero(~informed)]
    kept = np.flatnonzero(informed)
    if not kept.size:
        return found
    scale = np.sqrt(diagonal[kept])
    values, vectors = np.linalg.eigh(information[np.ix_(kept, kept)] / np.outer(scale, scale))
    for vector in vectors.T[values <= NULL_EIGENVALUE * values[-1]]:
        direction = vector / scale
        direction = direction / direction[np.argmax(np.abs(direction))]
        parts = {paths[int(i)]: float(e) for i, e in zip(kept, direction, strict=True) if abs(e) >= TAKES_PART}
        found.append(Unseen(dict(sorted(parts.items(), key=lambda part: -abs(part[1])))))
    return found


def check_seen(unseen: Sequence[Unseen], where: str) -> None:
    """**Raises** `InputError`, which begins with `where`, for combinations that no experiment can determine."""
    if unseen:
        named = "; ".join(combination.words for combination in unseen)
        raise InputError(
            f"{where}: found no experiment within the limits that changes with {named}; expected other kinds, a wider "
            'range, or a parameter of it fixed. One aim alone may do without: criterion = "parameter" or "prediction".'
        )
