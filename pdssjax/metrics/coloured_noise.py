"""Autocovariance of stationary noise: an autoregression on an even grid of times, else a function of the time between.

On an even grid the noise of n samples is taken for an autoregression,

    e_t = a_1 e_(t-1) + ... + a_q e_(t-q) + w_t,

fitted by the recursion of Levinson and Durbin to the sample autocovariances; q is chosen by the criterion of Hannan and
Quinn (J. R. Statist. Soc. B 41(2), 1979).  Its autocovariance follows at all lags.  The order takes the place of the
bandwidth of a kernel estimate (W. J. den Haan and A. T. Levin, Handbook of Statistics 15, 1997): no lag is cut off, so
slow noise is not underestimated, as it is where a kernel's bandwidth rests on an AR(1) (D. W. K. Andrews, Econometrica
59(3), 1991) that the noise is not.  docs/decisions/13-error-models.md has both measured side by side.

At other times it is white noise and a slow one, which may ring,

    cov(t) = s^2 ((1 - a) [t = 0] + a exp(-|t| / tau) cos(w t)).

a, tau and w are those of the highest likelihood, which a Kalman filter computes, one sample after the other (R. H.
Jones, Technometrics 22(3), 1980); whether noise is white, slow or ringing the same criterion tells.
"""

import itertools
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .sensor_samples import Samples


class StationaryNoise(NamedTuple):
    """An autoregression of order q."""

    coefficients: Float[np.ndarray, " q"]
    """a_1 ... a_q; none for white noise."""
    innovation: float
    """Variance of w, in the unit of the noise squared."""

    def autocovariance(self, lags: int) -> Float[np.ndarray, " lags"]:
        """Autocovariance at the lags 0, 1, ... `lags` - 1, in the unit of the noise squared."""
        size = 8 * 2 ** int(np.ceil(np.log2(max(lags, 32))))
        transfer = np.fft.rfft(np.concatenate([[1.0], -self.coefficients]), size)
        return np.fft.irfft(self.innovation / np.abs(transfer) ** 2, size)[:lags]

    @property
    def order(self) -> int:
        """Number of parameters of the colour."""
        return self.coefficients.size

    def evidence(self, freedom: float, time: Samples) -> float:
        """Twice the gain in log-likelihood over white noise, less twice the numbers that it took (Akaike)."""
        if not self.order:
            return 0.0
        variance = self._on_grid(time)[0][0]
        return float(freedom * np.log(variance / self.innovation) - 2.0 * self.order)

    def independent_share(self, time: Samples) -> float:
        """Independent samples per sample, by the variance of their mean square (M. S. Bartlett, 1946)."""
        if not self.order:
            return 1.0
        covariance, _ = self._on_grid(time)
        return float(1.0 / (1.0 + 2.0 * np.sum((covariance[1:] / covariance[0]) ** 2)))

    def covariance_product(self, columns: Float[np.ndarray, "n p"], time: Samples) -> Float[np.ndarray, "n p"]:
        """C X, with C the covariance of samples at `time` [s], on an even grid; no matrix C is made."""
        covariance, places = self._on_grid(time)
        return toeplitz_product(covariance, columns, places)

    def _on_grid(self, time: Samples) -> tuple[Float[np.ndarray, " lags"], Int[np.ndarray, " n"]]:
        """Autocovariance at all lags between samples at `time` [s], and the places of these on their grid."""
        places = grid_positions(time)
        if places is None:
            raise ValueError("found times on no even grid, expected those that the noise was found from")
        return self.autocovariance(int(places[-1]) + 1), places


def grid_positions(time: Samples) -> Int[np.ndarray, " n"] | None:
    """Integer positions of samples on an even grid; None where `time` [s] lies on no such grid.

    A gap in the record then stays a gap.
    """
    if time.size < 2:
        return np.arange(time.size)
    places = (time - time[0]) / float(np.median(np.diff(time)))
    near = np.round(places).astype(int)
    even = np.max(np.abs(places - near)) < 0.25 and near[-1] < 4 * time.size and np.all(np.diff(near) > 0)
    return near if even else None


def sample_autocovariance(values: Samples, positions: Int[np.ndarray, " n"], lags: int) -> Float[np.ndarray, " lags"]:
    """Mean product of `values` at each lag, about zero; NaN is left out.  Several values may share a position.

    Weighted by 1 - lag/length as is usual, which makes it positive definite where nothing is missing.
    """
    finite = np.isfinite(values)
    if not finite.any():
        return np.zeros(lags)
    length = int(positions[-1]) + 1
    grid, seen = np.zeros(length), np.zeros(length)
    np.add.at(grid, positions[finite], values[finite])
    np.add.at(seen, positions[finite], 1.0)
    size = _quick_size(length)
    products, pairs = (np.fft.irfft(np.abs(np.fft.rfft(x, size)) ** 2, size) for x in (grid, seen))
    apart = np.arange(min(lags, length))
    mean = np.where(pairs[apart] > 0.5, products[apart] / np.maximum(pairs[apart], 1.0), 0.0)
    mean[0] = np.mean(values[finite] ** 2)
    return np.pad(mean * (1.0 - apart / length), (0, lags - apart.size))


def stationary_noise(
    values: Samples, positions: Int[np.ndarray, " n"], freedom: float, max_order: int
) -> StationaryNoise:
    """Fit stationary noise about zero to `values`; NaN is left out.

    **Arguments:** `freedom`, the degrees of freedom that a fit has left of the samples: variances grow by their ratio;
    `max_order`, the highest order looked at.
    """
    finite = np.isfinite(values)
    samples = int(np.sum(finite))
    max_order = max(min(max_order, int(10.0 * np.log10(max(samples, 2))), samples // 8), 0)
    # With scattered gaps autocovariances are not positive definite, and high orders follow their errors.
    if np.sum(np.diff(positions[finite]) == 1) < 0.9 * samples:
        max_order = min(max_order, 1)
    c = sample_autocovariance(values, positions, max_order + 1) * samples / max(freedom, 1.0)
    if c[0] <= 0.0:
        return StationaryNoise(np.zeros(0), 0.0)
    a, variance = np.zeros(0), float(c[0])
    best = (freedom * np.log(variance), StationaryNoise(a, variance))
    price = 2.0 * np.log(np.log(max(freedom, 3.0)))
    for order in range(1, max_order + 1):
        reflection = (c[order] - a @ c[order - 1 : 0 : -1]) / variance
        if abs(reflection) >= 1.0:  # possible where samples are missing
            break
        a = np.append(a - reflection * a[::-1], reflection)
        variance *= 1.0 - reflection**2
        criterion = freedom * np.log(variance) + price * order
        if criterion < best[0]:
            best = (criterion, StationaryNoise(a, variance))
    return best[1]


def toeplitz_product(
    autocovariance: Float[np.ndarray, " lags"], columns: Float[np.ndarray, "n p"], positions: Int[np.ndarray, " n"]
) -> Float[np.ndarray, "n p"]:
    """C X, with C the covariance of noise of this `autocovariance` at the `positions`; no matrix C is made.

    **Arguments:** as many lags as the positions span at least; `columns` X, one row a sample.
    """
    length = int(positions[-1]) + 1
    grid = np.zeros((length, columns.shape[1]))
    grid[positions] = columns
    size = _quick_size(length)
    both = np.concatenate(
        [autocovariance[:length], np.zeros(size - 2 * length + 1), autocovariance[length - 1 : 0 : -1]]
    )
    spectrum = np.fft.rfft(both)[:, None] * np.fft.rfft(grid, size, axis=0)
    return np.fft.irfft(spectrum, size, axis=0)[positions]


def _quick_size(length: int) -> int:
    """A power of two, whose Fourier transform is quick, of twice the `length` at least: nothing wraps around."""
    return 1 << (2 * length - 1).bit_length()


_BLOCK = 256
"""Samples per block of the product with the covariance matrix."""


class NoiseInTime(NamedTuple):
    """White noise plus slow noise, at any times."""

    variance: float
    """Variance s^2 of a sample, in the unit of the noise squared."""
    share: float = 0.0
    """Share a of the slow noise in the variance; 0 for white noise."""
    duration: float = 1.0
    """Correlation time tau of the slow noise [s]."""
    angular_frequency: float = 0.0
    """Angular frequency w of noise that rings [rad/s]; 0 where it does not."""
    gain: float = 0.0
    """Twice the gain in log-likelihood over white noise."""

    @property
    def order(self) -> int:
        """Number of parameters of the colour."""
        return 0 if self.share == 0.0 else 3 if self.angular_frequency else 2

    def covariance_at(self, apart: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
        """Covariance of samples `apart` [s]."""
        slow = np.exp(-np.abs(apart) / self.duration) * np.cos(self.angular_frequency * apart)
        return self.variance * np.where(apart == 0.0, 1.0, self.share * slow)

    def evidence(self, freedom: float, time: Samples) -> float:
        """Twice the gain in log-likelihood over white noise, less twice the numbers that it took (Akaike)."""
        return self.gain - 2.0 * self.order

    def independent_share(self, time: Samples) -> float:
        """Independent samples per sample, by the variance of their mean square (M. S. Bartlett, 1946)."""
        # exp(-2 t / tau) cos(w t)^2 in two parts.
        parts = (
            NoiseInTime(1.0, self.share**2, 0.5 * self.duration, turn) for turn in (0.0, 2.0 * self.angular_frequency)
        )
        ones = np.ones((time.size, 1))
        return 2.0 * time.size / float(sum(np.sum(part.covariance_product(ones, time)) for part in parts))

    def covariance_product(self, columns: Float[np.ndarray, "n p"], time: Samples) -> Float[np.ndarray, "n p"]:
        """C X, with C the covariance of samples at `time` [s], in ascending order; no matrix C is made."""
        out = self.variance * (1.0 - self.share) * columns
        if self.share == 0.0:
            return out
        scale, rate = self.variance * self.share, 1.0 / self.duration - 1j * self.angular_frequency
        kernel = lambda apart: np.exp(-rate * np.abs(apart))
        blocks = [slice(begin, begin + _BLOCK) for begin in range(0, time.size, _BLOCK)]
        for rows in blocks:
            out[rows] += scale * kernel(time[rows, None] - time[rows]).real @ columns[rows]
        # All samples before a block act on it through one complex sum, which decays and rotates; so do those after it.
        for ordered, end in ((blocks, -1), (blocks[::-1], 0)):
            carried, at = np.zeros(columns.shape[1], complex), 0.0
            for rows in ordered:
                out[rows] += scale * (kernel(time[rows] - at)[:, None] * carried).real
                last = time[rows][end]
                carried = carried * kernel(last - at) + kernel(last - time[rows]) @ columns[rows]
                at = last
        return out


Noise: TypeAlias = StationaryNoise | NoiseInTime
"""Noise of a record: `StationaryNoise` for samples on an even grid, `NoiseInTime` for samples at any times."""


def fit_noise(time: Samples, values: Samples, freedom: float, max_order: int) -> Noise:
    """Fit noise about zero to `values` at `time` [s]; NaN is left out.

    **Arguments:** as of `stationary_noise`; `max_order` applies to an even grid.
    """
    places = grid_positions(time)
    if places is None:
        return noise_in_time(values, time, freedom)
    return stationary_noise(values, places, freedom, max_order)


_MOST_PARTS, _LEAST_IN_PART = 20, 8.0
"""Parts at most in which the power of noise is compared, and independent samples in each at least."""


def unevenness(values: Samples, time: Samples) -> float:
    """Bartlett's test whether the power of `values` at `time` [s] varies along a record, as a normal deviate.

    Sensor noise is as large everywhere, whatever its colour; the residuals of a model are large where it is wrong.
    The test of equal variances (Proc. R. Soc. Lond. A 160, 1937) compares equal parts, each with as many independent
    samples as the estimated colour of the noise leaves.  NaN is left out.

    **Returns:** where there are fewer than three such parts, infinity for coloured noise and 0 for white noise.
    """
    finite = np.isfinite(values)
    noise = fit_noise(time, values, float(np.sum(finite)), values.size)
    share = noise.independent_share(time[finite])
    count = int(min(_MOST_PARTS, share * np.sum(finite) / _LEAST_IN_PART))
    if count < 3:
        return np.inf if noise.order else 0.0
    parts = [part[np.isfinite(part)] for part in np.array_split(values, count)]
    freedom = share * np.array([part.size for part in parts])
    powers = np.array([np.mean(part**2) if part.size else np.nan for part in parts])
    powers, freedom = powers[freedom > 0.0], freedom[freedom > 0.0]
    whole, above = float(np.sum(freedom)), powers.size - 1
    if above < 1 or not (powers > 0.0).all():
        return 0.0 if not powers.any() else np.inf
    statistic = whole * np.log(freedom @ powers / whole) - freedom @ np.log(powers)
    statistic /= 1.0 + (np.sum(1.0 / freedom) - 1.0 / whole) / (3.0 * above)
    spread = 2.0 / (9.0 * above)
    return float((np.cbrt(statistic / above) - 1.0 + spread) / np.sqrt(spread))


def noise_in_time(values: Samples, time: Samples, freedom: float) -> NoiseInTime:
    """Fit white plus slow noise about zero to `values` at `time` [s]; NaN is left out.

    **Arguments:** `freedom`, the degrees of freedom that a fit has left of the samples: variances grow by their ratio.
    """
    finite = np.isfinite(values)
    values, time = values[finite], time[finite]
    size = float(np.mean(values**2)) if values.size else 0.0
    grown = values.size / max(freedom, 1.0)
    best, least = NoiseInTime(size * grown), 0.0
    # Fewer samples do not show a correlation.
    if values.size < 16 or size <= 0.0:
        return best
    # Eight stretches of a long record, in each of which the filter begins anew, determine the noise well enough.
    count = -(-values.size // 4096)
    length = values.size // count
    chosen = np.unique(np.linspace(0, count - 1, min(count, 8)).astype(int))
    stretches = lambda whole: whole[: count * length].reshape(count, length)[chosen]
    gaps, scaled = stretches(np.diff(time, prepend=time[0])), stretches(values / np.sqrt(size))
    part = scaled.size / values.size
    judge = lambda numbers: _deviances(gaps, scaled, numbers)
    price = 2.0 * np.log(np.log(max(freedom, 3.0)))
    for turns in ((0.0,), (1.0, 3.0, 9.0)):
        numbers = _minimise_deviance(judge, float(np.median(np.diff(time))), float(np.ptp(time)), turns)
        # As many at once as the search judges, so that nothing is compiled for this one.
        deviance, level = (float(found[0]) for found in judge(np.tile(numbers, (3**3, 1))))
        odds, duration, turn = map(float, numbers)
        found = NoiseInTime(size * grown * level, odds / (1.0 + odds), duration, turn / duration, -deviance / part)
        if price * found.order - found.gain < least:
            best, least = found, price * found.order - found.gain
    return best


def _minimise_deviance(
    judge: Callable[[Float[np.ndarray, "m 3"]], tuple[Float[Array, " m"], Float[Array, " m"]]],
    shortest: float,
    longest: float,
    turns: Sequence[float],
) -> Float[np.ndarray, " 3"]:
    """a / (1 - a), tau and w tau of the lowest deviance; 27 at a time, so that what judges them is compiled once."""
    # Starts of the search; the 27 of each are three values of a / (1 - a) by nine of tau.
    durations = np.geomspace(0.5 * shortest, 0.5 * longest, 9)
    begin = [np.array(list(itertools.product((0.4, 2.0, 20.0), durations, (turn,)))) for turn in turns]
    low, high = np.array([1e-3, 0.1 * shortest, 0.0]), np.array([1e7, longest, 1e3])

    def best_of(batches: Sequence[Float[np.ndarray, "m 3"]]) -> tuple[float, Float[np.ndarray, " 3"]]:
        found = [(np.nan_to_num(np.asarray(judge(batch)[0]), nan=np.inf), batch) for batch in batches]
        return min(((float(np.min(d)), batch[int(np.argmin(d))]) for d, batch in found), key=lambda pair: pair[0])

    value, best = best_of(begin)
    for step in (1.8, 1.35, 1.1):
        around = np.array(list(itertools.product((1.0 / step, 1.0, step), repeat=3)))
        while True:
            lower, there = best_of([np.clip(best * around, low, high)])
            if not lower < value - 1e-3:
                break
            value, best = lower, there
    return best


@jax.jit
def _deviances(
    gaps: Float[Array, "stretches n"], values: Float[Array, "stretches n"], numbers: Float[Array, "m 3"]
) -> tuple[Float[Array, " m"], Float[Array, " m"]]:
    """Minus twice the log-likelihood of `values`, above that of white noise, and their variance.

    **Arguments:** `gaps` [s] before each of the values; `numbers` a / (1 - a), tau and w tau.
    """

    def of(odds: Array, duration: Array, turn: Array) -> tuple[Array, Array]:
        share = odds / (1.0 + odds)

        def step(state: tuple[Array, Array], sample: tuple[Array, Array]):
            (mean, spread), (gap, value) = state, sample
            fade, angle = jnp.exp(-gap / duration), turn * gap / duration
            move = fade * jnp.array([[jnp.cos(angle), -jnp.sin(angle)], [jnp.sin(angle), jnp.cos(angle)]])
            mean, spread = move @ mean, move @ spread @ move.T + share * (1.0 - fade**2) * jnp.eye(2)
            variance, off = spread[0, 0] + 1.0 - share, value - mean[0]
            gain = spread[:, 0] / variance
            return (mean + gain * off, spread - jnp.outer(gain, spread[0])), (off**2 / variance, jnp.log(variance))

        start = jnp.zeros(2), share * jnp.eye(2)
        through = jax.vmap(lambda gaps, values: jax.lax.scan(step, start, (gaps, values))[1])
        squares, logarithms = through(gaps, values)
        level = jnp.mean(squares)
        return values.size * (jnp.log(level) - jnp.log(jnp.mean(values**2))) + jnp.sum(logarithms), level

    return jax.vmap(of)(*numbers.T)
