"""Autocovariance of noise that is stationary: what neighbouring samples have in common.

The noise of n samples is taken for an autoregression,

    e_t = a_1 e_(t-1) + ... + a_q e_(t-q) + w_t,

fitted by the recursion of Levinson and Durbin to the sample autocovariances; q is chosen by the criterion of Hannan and
Quinn (J. R. Statist. Soc. B 41(2), 1979).  Its autocovariance follows at all lags.  The order takes the place of the
bandwidth of a kernel estimate (W. J. den Haan and A. T. Levin, Handbook of Statistics 15, 1997): no lag is cut off, so
slow noise is not underestimated, as it is where a kernel's bandwidth rests on an AR(1) (D. W. K. Andrews, Econometrica
59(3), 1991) that the noise is not.  docs/error-models.md has both measured side by side.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

_CLOSE = 0.9
"""Share of samples whose next neighbour has to be there for an order above `_FEW`: with scattered gaps sample
autocovariances are not positive definite, and high orders follow their errors."""

_FEW = 1


class StationaryNoise(NamedTuple):
    """An autoregression of order q."""

    coefficients: Float[np.ndarray, " q"]
    """a_1 ... a_q; none for white noise."""
    innovation: float
    """Variance of w, in the unit of the noise squared."""

    def autocovariance(self, lags: int) -> Float[np.ndarray, " lags"]:
        """At the lags 0, 1, ... `lags` - 1, in the unit of the noise squared."""
        size = 8 * 2 ** int(np.ceil(np.log2(max(lags, 32))))
        transfer = np.fft.rfft(np.concatenate([[1.0], -self.coefficients]), size)
        return np.fft.irfft(self.innovation / np.abs(transfer) ** 2, size)[:lags]

    @property
    def order(self) -> int:
        """How many numbers tell of its colour."""
        return self.coefficients.size

    def evidence(self, freedom: float, time: Float[np.ndarray, " n"]) -> float:
        """Twice the gain in log-likelihood over white noise, less twice the numbers that it took (Akaike)."""
        if not self.order:
            return 0.0
        variance = self.autocovariance(_lags(time))[0]
        return float(freedom * np.log(variance / self.innovation) - 2.0 * self.order)

    def independent(self, time: Float[np.ndarray, " n"]) -> float:
        """Independent samples a sample, as the variance of their mean square tells (M. S. Bartlett, 1946)."""
        if not self.order:
            return 1.0
        covariance = self.autocovariance(_lags(time))
        return float(1.0 / (1.0 + 2.0 * np.sum((covariance[1:] / covariance[0]) ** 2)))

    def times(self, columns: Float[np.ndarray, "n p"], time: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n p"]:
        """C X, with C the covariance of samples at `time` [s], on an even grid; no matrix C is made."""
        return stationary_times(self.autocovariance(_lags(time)), columns, _places(time))


def _places(time: Float[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    places = grid_positions(time)
    if places is None:
        raise ValueError("found times on no even grid, expected those that the noise was found from")
    return places


def _lags(time: Float[np.ndarray, " n"]) -> int:
    """All that there are between samples."""
    return int(_places(time)[-1]) + 1


def grid_positions(time: Float[np.ndarray, " n"]) -> Int[np.ndarray, " n"] | None:
    """Where samples lie on an even grid, in its intervals; None where `time` [s] is on no such grid.

    A gap in the record then stays a gap.
    """
    if time.size < 2:
        return np.arange(time.size)
    places = (time - time[0]) / float(np.median(np.diff(time)))
    near = np.round(places).astype(int)
    even = np.max(np.abs(places - near)) < 0.25 and near[-1] < 4 * time.size and np.all(np.diff(near) > 0)
    return near if even else None


def sample_autocovariance(
    values: Float[np.ndarray, " n"], positions: Int[np.ndarray, " n"], lags: int
) -> Float[np.ndarray, " lags"]:
    """Mean product of `values` so many places apart, about zero; NaN is left out.  Several may share a place.

    Weighted by 1 - lag/length as is usual, which makes it positive definite where nothing is missing.
    """
    there = np.isfinite(values)
    if not there.any():
        return np.zeros(lags)
    length = int(positions[-1]) + 1
    grid, seen = np.zeros(length), np.zeros(length)
    np.add.at(grid, positions[there], values[there])
    np.add.at(seen, positions[there], 1.0)
    products, pairs = (np.fft.irfft(np.abs(np.fft.rfft(x, 2 * length)) ** 2, 2 * length) for x in (grid, seen))
    apart = np.arange(min(lags, length))
    mean = np.where(pairs[apart] > 0.5, products[apart] / np.maximum(pairs[apart], 1.0), 0.0)
    mean[0] = np.mean(values[there] ** 2)
    return np.pad(mean * (1.0 - apart / length), (0, lags - apart.size))


def stationary_noise(
    values: Float[np.ndarray, " n"], positions: Int[np.ndarray, " n"], freedom: float, most: int
) -> StationaryNoise:
    """The noise that `values` are a sample of, about zero; NaN is left out.

    **Arguments:** `freedom`, the degrees of freedom that a fit has left of the samples: variances grow by their ratio;
    `most`, the highest order looked at.
    """
    there = np.isfinite(values)
    samples = int(np.sum(there))
    most = max(min(most, int(10.0 * np.log10(max(samples, 2))), samples // 8), 0)
    if np.sum(np.diff(positions[there]) == 1) < _CLOSE * samples:
        most = min(most, _FEW)
    c = sample_autocovariance(values, positions, most + 1) * samples / max(freedom, 1.0)
    if c[0] <= 0.0:
        return StationaryNoise(np.zeros(0), 0.0)
    a, variance = np.zeros(0), float(c[0])
    best = (freedom * np.log(variance), StationaryNoise(a, variance))
    price = 2.0 * np.log(np.log(max(freedom, 3.0)))
    for order in range(1, most + 1):
        reflection = (c[order] - a @ c[order - 1 : 0 : -1]) / variance
        if abs(reflection) >= 1.0:  # possible where samples are missing
            break
        a = np.append(a - reflection * a[::-1], reflection)
        variance *= 1.0 - reflection**2
        criterion = freedom * np.log(variance) + price * order
        if criterion < best[0]:
            best = (criterion, StationaryNoise(a, variance))
    return best[1]


def stationary_times(
    autocovariance: Float[np.ndarray, " lags"], columns: Float[np.ndarray, "n p"], positions: Int[np.ndarray, " n"]
) -> Float[np.ndarray, "n p"]:
    """C X, with C the covariance of noise of this `autocovariance` at the `positions`; no matrix C is made.

    **Arguments:** as many lags as the positions span at least; `columns` X, one row a sample.
    """
    length = int(positions[-1]) + 1
    grid = np.zeros((length, columns.shape[1]))
    grid[positions] = columns
    both = np.concatenate([autocovariance[:length], [0.0], autocovariance[length - 1 : 0 : -1]])
    spectrum = np.fft.rfft(both)[:, None] * np.fft.rfft(grid, 2 * length, axis=0)
    return np.fft.irfft(spectrum, 2 * length, axis=0)[positions]
