"""Autocovariance of noise whose samples lie on no even grid: a function of the time between them.

    cov(t) = s^2 ((1 - a) [t = 0] + a exp(-|t| / tau) cos(w t))

White noise and a slow one, which may ring.  a, tau and w are those of the highest likelihood, which a Kalman filter
computes, one sample after the other (R. H. Jones, Technometrics 22(3), 1980); whether noise is white, slow or ringing
the criterion of Hannan and Quinn tells, as it tells the order on an even grid (`autocovariance.py`).
"""

import itertools
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .autocovariance import StationaryNoise, grid_positions, stationary_noise

_ODDS = (0.4, 2.0, 20.0)
"""a / (1 - a) where the search begins."""

_DURATIONS = 9
"""Values of tau, the same."""

_TURNS = (1.0, 3.0, 9.0)
"""w tau of noise that rings, the same."""

_STEPS = (1.8, 1.35, 1.1)
"""Factors by which a search goes on."""

_LEAST, _MOST = 1e-3, 1e7
"""Of a / (1 - a)."""

_QUICKEST = 1e3
"""Largest w tau."""

_FEWEST = 16
"""Samples from which noise may be anything but white."""

_STRETCH = 4096
"""Samples that one filter goes through at most."""

_STRETCHES = 8
"""Such stretches that are looked at, spread over the record: they tell enough."""

_AT_ONCE = 256
"""Samples between which covariances are computed at once."""


class NoiseInTime(NamedTuple):
    """White noise and a slow one."""

    variance: float
    """s^2, in the unit of the noise squared."""
    share: float = 0.0
    """a; 0 of white noise."""
    duration: float = 1.0
    """tau [s]"""
    pulsation: float = 0.0
    """w [rad/s]; 0 of noise that does not ring."""
    gain: float = 0.0
    """By how much twice the logarithm of the likelihood exceeds that of white noise."""

    @property
    def order(self) -> int:
        """How many numbers tell of its colour."""
        return 0 if self.share == 0.0 else 3 if self.pulsation else 2

    def covariance_at(self, apart: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
        """Of samples so far `apart` [s]."""
        slow = np.exp(-np.abs(apart) / self.duration) * np.cos(self.pulsation * apart)
        return self.variance * np.where(apart == 0.0, 1.0, self.share * slow)

    def evidence(self, freedom: float, time: Float[np.ndarray, " n"]) -> float:
        """Twice the gain in log-likelihood over white noise, less twice the numbers that it took (Akaike)."""
        return self.gain - 2.0 * self.order

    def independent(self, time: Float[np.ndarray, " n"]) -> float:
        """Independent samples a sample, as the variance of their mean square tells (M. S. Bartlett, 1946)."""
        # exp(-2 t / tau) cos(w t)^2 in two parts.
        parts = (NoiseInTime(1.0, self.share**2, 0.5 * self.duration, turn) for turn in (0.0, 2.0 * self.pulsation))
        return 2.0 * time.size / float(sum(np.sum(part.times(np.ones((time.size, 1)), time)) for part in parts))

    def times(self, columns: Float[np.ndarray, "n p"], time: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n p"]:
        """C X, with C the covariance of samples at `time` [s], in ascending order; no matrix C is made."""
        out = self.variance * (1.0 - self.share) * columns
        if self.share == 0.0:
            return out
        scale, rate = self.variance * self.share, 1.0 / self.duration - 1j * self.pulsation
        kernel = lambda apart: np.exp(-rate * np.abs(apart))
        blocks = [slice(begin, begin + _AT_ONCE) for begin in range(0, time.size, _AT_ONCE)]
        for rows in blocks:
            out[rows] += scale * kernel(time[rows, None] - time[rows]).real @ columns[rows]
        # All that lies before a block acts on it through one sum, which fades and turns; so does all that lies behind.
        for ordered, end in ((blocks, -1), (blocks[::-1], 0)):
            carried, at = np.zeros(columns.shape[1], complex), 0.0
            for rows in ordered:
                out[rows] += scale * (kernel(time[rows] - at)[:, None] * carried).real
                last = time[rows][end]
                carried = carried * kernel(last - at) + kernel(last - time[rows]) @ columns[rows]
                at = last
        return out


Noise: TypeAlias = StationaryNoise | NoiseInTime
"""On an even grid, or at any times."""


def noise_at(time: Float[np.ndarray, " n"], values: Float[np.ndarray, " n"], freedom: float, most: int) -> Noise:
    """The noise that `values` at `time` [s] are a sample of, about zero; NaN is left out.

    **Arguments:** as of `stationary_noise`; the highest order, `most`, is that on an even grid.
    """
    places = grid_positions(time)
    if places is None:
        return noise_in_time(values, time, freedom)
    return stationary_noise(values, places, freedom, most)


def noise_in_time(values: Float[np.ndarray, " n"], time: Float[np.ndarray, " n"], freedom: float) -> NoiseInTime:
    """The noise that `values` at `time` [s] are a sample of, about zero; NaN is left out.

    **Arguments:** `freedom`, the degrees of freedom that a fit has left of the samples: variances grow by their ratio.
    """
    there = np.isfinite(values)
    values, time = values[there], time[there]
    size = float(np.mean(values**2)) if values.size else 0.0
    grown = values.size / max(freedom, 1.0)
    best, least = NoiseInTime(size * grown), 0.0
    if values.size < _FEWEST or size <= 0.0:
        return best
    gaps, scaled, part = _stretches(time, values / np.sqrt(size))
    judge = lambda numbers: _deviances(gaps, scaled, numbers)
    price = 2.0 * np.log(np.log(max(freedom, 3.0)))
    for turns in ((0.0,), _TURNS):
        numbers = _lowest(judge, float(np.median(np.diff(time))), float(np.ptp(time)), turns)
        deviance, level = (float(found[0]) for found in judge(np.tile(numbers, (3**3, 1))))
        odds, duration, turn = map(float, numbers)
        found = NoiseInTime(size * grown * level, odds / (1.0 + odds), duration, turn / duration, -deviance / part)
        if price * found.order - found.gain < least:
            best, least = found, price * found.order - found.gain
    return best


def _stretches(
    time: Float[np.ndarray, " n"], values: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, "stretches m"], Float[np.ndarray, "stretches m"], float]:
    """Gaps before the samples and values of a long record in stretches, each of which a filter begins anew.

    **Returns:** last, which part of all samples is in them.
    """
    count = -(-values.size // _STRETCH)
    size = values.size // count
    chosen = np.unique(np.linspace(0, count - 1, min(count, _STRETCHES)).astype(int))
    cut = lambda whole: whole[: count * size].reshape(count, size)[chosen]
    return cut(np.diff(time, prepend=time[0])), cut(values), chosen.size * size / values.size


def _lowest(
    judge: Callable[[Float[np.ndarray, "m 3"]], tuple[Float[Array, " m"], Float[Array, " m"]]],
    shortest: float,
    longest: float,
    turns: Sequence[float],
) -> Float[np.ndarray, " 3"]:
    """a / (1 - a), tau and w tau of the lowest deviance; 27 at a time, so that what judges them is compiled once."""
    durations = np.geomspace(0.5 * shortest, 0.5 * longest, _DURATIONS)
    begin = [np.array(list(itertools.product(_ODDS, durations, (turn,)))) for turn in turns]
    low, high = np.array([_LEAST, 0.1 * shortest, 0.0]), np.array([_MOST, longest, _QUICKEST])

    def best_of(batches: Sequence[Float[np.ndarray, "m 3"]]) -> tuple[float, Float[np.ndarray, " 3"]]:
        found = [(np.nan_to_num(np.asarray(judge(batch)[0]), nan=np.inf), batch) for batch in batches]
        return min(((float(np.min(d)), batch[int(np.argmin(d))]) for d, batch in found), key=lambda pair: pair[0])

    value, best = best_of(begin)
    for step in _STEPS:
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
