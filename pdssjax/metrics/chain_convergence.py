"""Whether the chains of a Monte Carlo sampler agree, and how much their draws are worth.

A. Vehtari, A. Gelman, D. Simpson, B. Carpenter and P.-C. Bürkner, Bayesian Analysis 16(2), 2021: chains are cut in
half, draws replaced by the normal scores of their ranks; the effective sample size uses the autocorrelations of all
chains up to where the sum of neighbouring ones turns negative (C. J. Geyer, Statistical Science 7(4), 1992).
"""

import numpy as np
from jaxtyping import Float
from scipy.special import ndtri

TAILS = 0.05, 0.95
"""Quantiles at which the effective sample size of the tails is evaluated."""


def rhat(draws: Float[np.ndarray, "chains draws"]) -> float:
    """R-hat, of place or of spread whichever is larger: 1 where the chains agree, to be below 1.01.

    NaN where there are fewer than four draws, or all are the same.
    """
    halves = _halves(draws)
    if not np.ptp(halves) > 0.0:
        return float("nan")
    spread = np.abs(halves - np.median(halves))
    return max(_plain_rhat(_normal_scores(halves)), _plain_rhat(_normal_scores(spread)))


def effective_size(draws: Float[np.ndarray, "chains draws"]) -> float:
    """Effective sample size of the middle of a distribution ("bulk"); NaN as for `rhat`."""
    halves = _halves(draws)
    return _effective(_normal_scores(halves)) if np.ptp(halves) > 0.0 else float("nan")


def effective_size_of_tails(draws: Float[np.ndarray, "chains draws"]) -> float:
    """The smaller effective sample size of the 5 % and the 95 % quantile; NaN as for `rhat`."""
    halves = _halves(draws)
    return min(_effective((halves <= np.quantile(draws, tail)).astype(float)) for tail in TAILS)


def _halves(draws: Float[np.ndarray, "chains draws"]) -> Float[np.ndarray, "halves half"]:
    """Split each chain into two halves; the middle draw of an odd number is left out."""
    half = draws.shape[1] // 2
    if half < 2:
        return np.zeros((2 * draws.shape[0], 2))
    return np.concatenate([draws[:, :half], draws[:, -half:]])


def _normal_scores(draws: Float[np.ndarray, "chains draws"]) -> Float[np.ndarray, "chains draws"]:
    """Normal scores of the ranks among all draws; equal draws share the mean of their ranks."""
    from scipy.stats import rankdata  # takes a while to load

    return ndtri((rankdata(draws).reshape(draws.shape) - 0.375) / (draws.size + 0.25))


def _variances(draws: Float[np.ndarray, "chains draws"]) -> tuple[float, float]:
    """Variance within the chains, and of all draws."""
    length = draws.shape[1]
    within = float(np.mean(np.var(draws, axis=1, ddof=1)))
    between = float(np.var(np.mean(draws, axis=1), ddof=1)) if draws.shape[0] > 1 else 0.0
    return within, within * (length - 1) / length + between


def _plain_rhat(draws: Float[np.ndarray, "chains draws"]) -> float:
    within, whole = _variances(draws)
    return float(np.sqrt(whole / within)) if within > 0.0 else float("inf")


def _effective(draws: Float[np.ndarray, "chains draws"]) -> float:
    chains, length = draws.shape
    within, whole = _variances(draws)
    if not whole > 0.0:
        return float("nan")
    centred = draws - np.mean(draws, axis=1, keepdims=True)
    spectrum = np.fft.rfft(centred, 2 * length, axis=1)
    covariance = np.mean(np.fft.irfft(np.abs(spectrum) ** 2, axis=1)[:, :length], axis=0) / length
    correlation = 1.0 - (within - covariance) / whole
    correlation[0] = 1.0
    pairs = correlation[: 2 * (length // 2)].reshape(-1, 2).sum(axis=1)
    negative = np.flatnonzero(pairs < 0.0)
    kept = int(negative[0]) if negative.size else pairs.size
    beyond = max(float(correlation[2 * kept]), 0.0) if 2 * kept < length else 0.0
    time = -1.0 + 2.0 * float(np.sum(np.minimum.accumulate(pairs[:kept]))) + beyond
    # Antithetic chains may be worth more than independent draws, but not without limit.
    return chains * length / max(time, 1.0 / np.log10(chains * length))
