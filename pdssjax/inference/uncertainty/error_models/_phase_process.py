"""A misfit as a Gaussian process in phase, its size and length by restricted marginal likelihood.

    mean residual = J d + zero + g + noise,   cov(g) = s(phi) s(phi') k(distance / length),   s^2 = a^2 + b^2 v^2

k is Matern's of order 3/2: a misfit may have kinks, as stick-slip has.  v is the fit's own sensitivity, the root mean
square over the parameters of the Jacobian's columns of unit norm: models err most where they are active, and a misfit
spread evenly over the cycle (b = 0) would be too small there.  d and the zero are what the fit has made of them,
and are integrated out (H. D. Patterson and R. Thompson, Biometrika 58(3), 1971).
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

_STEPS = (1.4, 0.7, 0.35, 0.17)
"""Steps of the search for the best logarithms of a^2, b^2 and the length."""

_NEVER = 1e-8
"""Least a^2 and b^2, relative to the residuals'."""

_NUMBERS = 3
"""That the process takes: a, b and the length."""


class PhaseProcess(NamedTuple):
    """A misfit at so many phases."""

    covariance: Float[np.ndarray, "phases phases"]
    """Of g, in the square of the residuals' unit, times the weight of the evidence: 0.05 of -6, 0.99 of 10."""
    length: float
    """As a share of the cycle, or of a record that does not repeat."""
    evidence: float
    """Twice the gain in log-likelihood over noise alone, less twice the numbers that it took (Akaike)."""


def matern(distance: Float[np.ndarray, "..."], length: float) -> Float[np.ndarray, "..."]:
    """Correlation at a `distance`, of order 3/2."""
    x = np.sqrt(3.0) * distance / length
    return (1.0 + x) * np.exp(-x)


def distances(phases: Float[np.ndarray, " phases"], periodic: bool) -> Float[np.ndarray, "phases phases"]:
    """Between all phases, as shares of a cycle; around it by the chord, which keeps a kernel positive definite."""
    apart = np.abs(phases[:, None] - phases[None, :])
    return np.abs(np.sin(np.pi * apart)) / np.pi if periodic else apart


def phase_process(
    mean: Float[np.ndarray, " phases"],
    slopes: Float[np.ndarray, "phases p"],
    noise: Float[np.ndarray, "phases phases"],
    phases: Float[np.ndarray, " phases"],
    periodic: bool,
) -> PhaseProcess:
    """The misfit that explains the `mean` residuals best.

    **Arguments:** `slopes`, the mean rows of the Jacobian; `noise`, the covariance of the noise of the means; `phases`
    from 0 to 1, around a cycle if `periodic`.
    """
    base = _basis(slopes)
    size = float(np.mean(mean**2))
    if size <= 0.0 or base.shape[1] >= mean.size - 4:
        return PhaseProcess(np.zeros_like(noise), 1.0, 0.0)
    apart, activity = distances(phases, periodic), _activity(slopes)
    noise = noise + 1e-9 * size * np.eye(mean.size)

    def kernel(at: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "phases phases"]:
        even, active, length = np.exp(at)
        amplitude = np.sqrt(even + active * activity**2)
        return amplitude[:, None] * amplitude * matern(apart, length)

    def likelihood(at: Float[np.ndarray, " 3"]) -> float:
        return restricted_likelihood(mean, base, noise + kernel(at))

    nothing, top = np.log(_NEVER * size), np.log(1e4 * size)
    low, high = np.array([nothing, nothing, np.log(1.0 / mean.size)]), np.array([top, top, 0.0])
    begin = [
        np.array([even, active, np.log(length)])
        for even, active in ((np.log(size), nothing), (nothing, np.log(size)), (np.log(size / 4.0),) * 2)
        for length in (0.02, 0.07, 0.25)
    ]
    best, value = _highest(likelihood, [np.clip(at, low, high) for at in begin], low, high)
    gain = 2.0 * (value - restricted_likelihood(mean, base, noise)) - 2.0 * _NUMBERS
    return PhaseProcess(kernel(best) * _weight(gain), float(np.exp(best[2])), gain)


def _weight(evidence: float) -> float:
    """Akaike's, of two models: a misfit that is hardly seen counts for little, however far it would move parameters."""
    return float(1.0 / (1.0 + np.exp(-0.5 * max(evidence, -1e3))))


def restricted_likelihood(
    values: Float[np.ndarray, " n"], base: Float[np.ndarray, "n q"], covariance: Float[np.ndarray, "n n"]
) -> float:
    """Log-likelihood of `values` of this `covariance`, up to a constant, whatever multiples of the `base` they hold."""
    n, columns = values.size, np.column_stack([base, values])
    # The factor of [[C, X], [X', t]] is [[L, 0], [X' L^-T, ...]]: no triangular solver is needed.  t only has to be
    # so large that there is a factor.
    least = float(np.min(np.diag(covariance))) * 1e-12
    corner = np.eye(columns.shape[1]) * (2.0 * float(np.sum(columns**2)) / least)
    root = np.linalg.cholesky(np.block([[covariance, columns], [columns.T, corner]]))
    white = root[n:, :n].T
    q, r = np.linalg.qr(white[:, :-1])
    left = white[:, -1] - q @ (q.T @ white[:, -1])
    logarithm = np.sum(np.log(np.diag(root)[:n])) + np.sum(np.log(np.abs(np.diag(r))))
    return float(-logarithm - 0.5 * left @ left)


def _basis(slopes: Float[np.ndarray, "phases p"]) -> Float[np.ndarray, "phases q"]:
    """Orthonormal: what the parameters and the zero can do to the mean residuals."""
    columns = np.column_stack([slopes, np.ones(slopes.shape[0])])
    norms = np.linalg.norm(columns, axis=0)
    left, singular, _ = np.linalg.svd(columns[:, norms > 0] / norms[norms > 0], full_matrices=False)
    return left[:, singular > 1e-9 * singular[0]]


def _activity(slopes: Float[np.ndarray, "phases p"]) -> Float[np.ndarray, " phases"]:
    """How strongly the parameters show at each phase; 1 in the root mean square."""
    norms = np.linalg.norm(slopes, axis=0)
    if not (norms > 0).any():
        return np.ones(slopes.shape[0])
    unit = slopes[:, norms > 0] / norms[norms > 0]
    return np.sqrt(np.sum(unit**2, axis=1) / np.sum(unit**2) * slopes.shape[0])


def _highest(
    function: Callable[[Float[np.ndarray, " q"]], float],
    begin: Sequence[Float[np.ndarray, " q"]],
    low: Float[np.ndarray, " q"],
    high: Float[np.ndarray, " q"],
) -> tuple[Float[np.ndarray, " q"], float]:
    """Where a function of few numbers is largest, by steps along each of them, and its value there."""
    values = [function(at) for at in begin]
    best, value = begin[int(np.argmax(values))], max(values)
    for step in _STEPS:
        moved = True
        while moved:
            moved = False
            for i in range(best.size):
                for way in (step, -step):
                    trial = best.copy()
                    trial[i] = np.clip(trial[i] + way, low[i], high[i])
                    if trial[i] != best[i] and (found := function(trial)) > value + 1e-3:
                        best, value, moved = trial, found, True
    return best, value
