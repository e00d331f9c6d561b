"""Coloured noise, and a misfit of the model that every cycle repeats.

    y = f(parameters) + g(phase) + noise,     cov = G' C G + (Z' G)' K (Z' G)

The misfit g is a Gaussian process in the phase of the drive, shared by all cycles of a record (Z says which sample
belongs to which phase): more cycles do not average it away.  It is as M. C. Kennedy and A. O'Hagan, J. R. Statist. Soc.
B 63(3), 2001, have it, marginalised as the zero of a record is; its size and length K are those that explain the mean
residuals best, what the fit could take up set aside.  Samples that stand out are noise, by their
size, and say nothing of a misfit.

Where a record does not repeat, misfit and slow noise cannot be told apart: its residuals are white noise, of the size
that neighbours show, and a process in time.

The misfit's size and length are those of the greatest restricted marginal likelihood:

    mean residual = J d + zero + g + noise,   cov(g) = s(phi) s(phi') k(distance / length),   s^2 = a^2 + b^2 v^2

k is Matern's of order 3/2: a misfit may have kinks, as stick-slip has.  v is the fit's own sensitivity, the root mean
square over the parameters of the Jacobian's columns of unit norm: models err most where they are active, and a misfit
spread evenly over the cycle (b = 0) would be too small there.  d and the zero are what the fit has made of them,
and are integrated out (H. D. Patterson and R. Thompson, Biometrika 58(3), 1971).
"""

import functools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ....metrics import ResidualSplit, neighbour_scatter, split_residuals
from .base import AbstractErrorModel, RecordErrors, RecordShare
from .coloured import Coloured

_STEPS = (1.4, 0.7, 0.35, 0.17)
"""Steps of the search for the best logarithms of a^2, b^2 and the length."""


class _PhaseProcess(NamedTuple):
    """A misfit at so many phases."""

    covariance: Float[np.ndarray, "phases phases"]
    """Covariance of g in squared residual units, times a weight: 0.05 at an evidence of -6, 0.99 at 10."""
    length: float
    """Correlation length as a fraction of the cycle, or of a record that does not repeat."""
    evidence: float
    """Twice the gain in log-likelihood over noise alone, less twice the numbers that it took (Akaike)."""


def matern(distance: Float[np.ndarray, "..."], length: float) -> Float[np.ndarray, "..."]:
    """Correlation at a `distance`, of order 3/2."""
    x = np.sqrt(3.0) * distance / length
    return (1.0 + x) * np.exp(-x)


def distances(phases: Float[np.ndarray, " phases"], periodic: bool) -> Float[np.ndarray, "phases phases"]:
    """Distances between all phases, in cycles; around one by the chord, which keeps a kernel positive definite."""
    apart = np.abs(phases[:, None] - phases[None, :])
    return np.abs(np.sin(np.pi * apart)) / np.pi if periodic else apart


def phase_process(
    mean: Float[np.ndarray, " phases"],
    slopes: Float[np.ndarray, "phases p"],
    noise: Float[np.ndarray, "phases phases"],
    phases: Float[np.ndarray, " phases"],
    periodic: bool,
) -> _PhaseProcess:
    """The misfit that explains the `mean` residuals best.

    **Arguments:** `slopes`, the mean rows of the Jacobian; `noise`, the covariance of the noise of the means; `phases`
    from 0 to 1, around a cycle if `periodic`.
    """
    base, size = _basis(slopes), float(np.mean(mean**2))
    if size <= 0.0 or base.shape[1] >= mean.size - 4:
        return _PhaseProcess(np.zeros_like(noise), 1.0, 0.0)
    # Sensitivity to the parameters at each phase; 1 in the root mean square.
    norms, activity = np.linalg.norm(slopes, axis=0), np.ones(mean.size)
    if (norms > 0).any():
        unit = slopes[:, norms > 0] / norms[norms > 0]
        activity = np.sqrt(np.sum(unit**2, axis=1) / np.sum(unit**2) * mean.size)
    apart = distances(phases, periodic)
    noise = noise + 1e-9 * size * np.eye(mean.size)
    correlation = functools.cache(lambda length: matern(apart, length))  # most steps of the search keep the length

    def kernel(at: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "phases phases"]:
        even, active, length = np.exp(at)
        amplitude = np.sqrt(even + active * activity**2)
        return amplitude[:, None] * amplitude * correlation(length)

    def likelihood(at: Float[np.ndarray, " 3"]) -> float:
        return restricted_likelihood(mean, base, noise + kernel(at))

    nothing, top = np.log(1e-8 * size), np.log(1e4 * size)
    low, high = np.array([nothing, nothing, np.log(1.0 / mean.size)]), np.array([top, top, 0.0])
    begin = [
        np.array([even, active, np.log(length)])
        for even, active in ((np.log(size), nothing), (nothing, np.log(size)), (np.log(size / 4.0),) * 2)
        for length in (0.02, 0.07, 0.25)
    ]
    best, value = _highest(likelihood, [np.clip(at, low, high) for at in begin], low, high)
    # Two for each number of the process: a, b and the length.
    gain = 2.0 * (value - restricted_likelihood(mean, base, noise)) - 2.0 * 3
    # Akaike's weight of two models: a misfit that is hardly seen counts for little, however large its effect.
    weight = 1.0 / (1.0 + np.exp(-0.5 * max(gain, -1e3)))
    return _PhaseProcess(kernel(best) * weight, float(np.exp(best[2])), gain)


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
    """An orthonormal basis of what the parameters and the zero can do to the mean residuals."""
    columns = np.column_stack([slopes, np.ones(slopes.shape[0])])
    columns = columns[:, np.linalg.norm(columns, axis=0) > 0]
    left, singular, _ = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), full_matrices=False)
    return left[:, singular > 1e-9 * singular[0]]


def _highest(
    function: Callable[[Float[np.ndarray, " q"]], float],
    begin: Sequence[Float[np.ndarray, " q"]],
    low: Float[np.ndarray, " q"],
    high: Float[np.ndarray, " q"],
) -> tuple[Float[np.ndarray, " q"], float]:
    """The maximum of a function of few numbers, by steps along each of them, and its value there."""
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


MOST_PHASES = 200
"""Phases in which a misfit is described; finer ones are taken together."""

_AT_ONCE = 20
"""Phases whose covariance with all others is computed at once."""

FEWEST_SAMPLES = 16
"""Samples from which a misfit is looked for."""


class WithMisfit(AbstractErrorModel):
    """A misfit in drive phase, beside stationary noise."""

    rank = 2
    covers = (
        "the physical parameters, provided that the model's misfit biases them no more than a random misfit of the "
        "same size and smoothness would; they cover the pseudo-true parameters more often than 95 %"
    )

    def share(self, record: RecordErrors) -> RecordShare:
        found = Coloured().share(record)
        coloured = found.covariance
        record = record.without_outliers()
        if record.residual.size < FEWEST_SAMPLES:
            return found._replace(evidence=0.0)
        split = split_residuals(record.residual, record.time, record.frequency, record.freedom)
        process, phase = misfit_of(record, split)
        sums = sums_at(phase, record.influence, process.covariance.shape[0])
        misfit = sums.T @ process.covariance @ sums
        if split.cycles is not None:
            return RecordShare(coloured + misfit, process.evidence, found.freedom)
        noise = neighbour_scatter(record.residual) ** 2
        white = misfit + noise * record.influence.T @ record.influence
        # The smallest covariance that is at least the coloured and the white one: a maximum of eigenvalues in
        # coordinates in which the coloured one is the identity.  A parameter without coloured error has the white one.
        scale = np.sqrt(np.maximum(np.diag(coloured), np.diag(white)))
        scale = np.where(scale > 0, scale, 1.0)
        values, axes = np.linalg.eigh(coloured / np.outer(scale, scale))
        root = axes * np.sqrt(np.maximum(values, 1e-14 * max(float(values[-1]), 1e-300)))
        inverse = np.linalg.inv(root)
        gain, turn = np.linalg.eigh(inverse @ (white / np.outer(scale, scale)) @ inverse.T)
        grown = root @ turn * np.sqrt(np.maximum(gain, 1.0))
        return RecordShare(grown @ grown.T * np.outer(scale, scale), process.evidence, found.freedom)


def misfit_of(record: RecordErrors, split: ResidualSplit) -> tuple[_PhaseProcess, Int[np.ndarray, " n"]]:
    """The misfit of a record without NaN, and the phase that each sample belongs to, 0 to `MOST_PHASES` - 1."""
    cycles, time = split.cycles, record.time
    if cycles is not None:
        count = min(MOST_PHASES, cycles.sizes.size)
        phase = cycles.group * count // cycles.sizes.size
    else:  # parts of its span
        count = min(MOST_PHASES, time.size)
        phase = np.minimum(np.floor((time - time[0]) / np.ptp(time) * count), count - 1).astype(int)
    # A phase without samples takes no part.
    there, phase = np.unique(phase, return_inverse=True)
    sizes = np.bincount(phase)
    if cycles is None:
        noise = np.diag(neighbour_scatter(record.residual) ** 2 / sizes)
    else:
        noise = noise_of_means(record, split, phase)
    mean = sums_at(phase, record.residual[:, None], sizes.size)[:, 0] / sizes
    slopes = sums_at(phase, record.jacobian, sizes.size) / sizes[:, None]
    return phase_process(mean, slopes, noise, there / count, periodic=cycles is not None), phase


def noise_of_means(
    record: RecordErrors, split: ResidualSplit, phase: Int[np.ndarray, " n"]
) -> Float[np.ndarray, "phases phases"]:
    """Covariance of the mean noise at each phase; all phases have samples."""
    count = int(phase.max()) + 1
    sizes, out = np.bincount(phase), np.zeros((count, count))
    # A few phases at a time: all of them would be an n x phases matrix.
    for some in np.array_split(np.arange(count), -(-count // _AT_ONCE)):
        member = (phase[:, None] == some) / sizes[some]
        out[:, some] = sums_at(phase, split.noise.covariance_product(member, record.time), count) / sizes[:, None]
    return 0.5 * (out + out.T)


def sums_at(
    phase: Int[np.ndarray, " n"], columns: Float[np.ndarray, "n p"], count: int
) -> Float[np.ndarray, "phases p"]:
    """Sums of the rows of each phase."""
    out = np.zeros((count, columns.shape[1]))
    np.add.at(out, phase, columns)
    return out
