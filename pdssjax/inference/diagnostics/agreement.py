"""Which records disagree with the others: score tests and one-step deletion at the joint optimum, without a refit.

At the optimum the scores J_k' r_k of all records add up to zero.  If the same parameters hold in all of them, the
score of one is as large as noise makes it; if a record asks for other parameters, it pulls (L. G. Godfrey,
Misspecification Tests in Econometrics, Cambridge 1988; for deletion R. D. Cook and S. Weisberg, Residuals and
Agreement in Regression, Chapman and Hall 1982).
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ...study import Agreement
from ..uncertainty.covariance import NO_INFORMATION


class Score(NamedTuple):
    """What one record says at the optimum, on the fit's scale."""

    gradient: Float[np.ndarray, " p"]
    """J' r of its whitened residuals."""
    information: Float[np.ndarray, "p p"]
    """J' J."""
    variance: Float[np.ndarray, "p p"]
    """Covariance of the gradient."""


def score_of(residual: Float[np.ndarray, " n"], jacobian: Float[np.ndarray, "n p"]) -> Score:
    """Of one record's whitened residuals and their Jacobian.

    The variance is that of residuals as large and as correlated from sample to sample as those that parameters of its
    own would leave (first order autoregression): misfit that no parameter mends must not pass for a contradiction,
    nor a contradiction for misfit.
    """
    information = jacobian.T @ jacobian
    left = residual - jacobian @ (_inverse(information) @ (jacobian.T @ residual))
    squares = max(float(left @ left), 1e-300)
    correlation = min(max(float(left[1:] @ left[:-1]) / squares, 0.0), 0.99)
    variance_factor = max(squares / left.size, 1.0) * (1.0 + correlation) / (1.0 - correlation)
    return Score(jacobian.T @ residual, information, variance_factor * information)


def agreement(
    scores: Sequence[Score],
    groups: Mapping[tuple[str, tuple[str, ...]], Bool[np.ndarray, " records"]],
    errors: Float[np.ndarray, " p"],
    paths: Sequence[str],
) -> tuple[Agreement, ...]:
    """How far each group of records disagrees with the others, and what leaving it out would change.

    **Arguments:** the `scores` of all records in the parameters at `paths`, with their standard `errors` on the fit's
    scale; `groups` by what is common and the records' names: which records belong to it, but never all.
    """
    everything = sum(score.information for score in scores)
    return tuple(
        _of_group(scores, inside, np.asarray(everything), what, names, errors, paths)
        for (what, names), inside in groups.items()
    )


def _of_group(
    scores: Sequence[Score],
    inside: Bool[np.ndarray, " records"],
    everything: Float[np.ndarray, "p p"],
    what: str,
    names: tuple[str, ...],
    errors: Float[np.ndarray, " p"],
    paths: Sequence[str],
) -> Agreement:
    pull = np.sum([s.gradient for s, is_in in zip(scores, inside, strict=True) if is_in], axis=0)
    share = np.sum([s.information for s, is_in in zip(scores, inside, strict=True) if is_in], axis=0)
    fraction = share @ _inverse(everything)
    size = everything.shape[0]
    variance = np.zeros_like(everything)
    for score, is_in in zip(scores, inside, strict=True):
        part = is_in * np.eye(size) - fraction
        variance += part @ score.variance @ part.T
    sigmas = _sigmas(pull, variance)
    others = everything - share
    shift = _inverse(others) @ pull
    determined = _determined(others, everything)
    shifts = np.where(determined, shift / errors, np.nan)
    return Agreement(names, what, sigmas, {path: float(s) for path, s in zip(paths, shifts, strict=True)})


def _sigmas(pull: Float[np.ndarray, " p"], variance: Float[np.ndarray, "p p"]) -> float:
    """How unlikely so large a pull is, as a normal deviate (E. B. Wilson and M. M. Hilferty, PNAS 17(12), 1931)."""
    scale = np.sqrt(np.maximum(np.diag(variance), 1e-300))
    values, vectors = np.linalg.eigh(variance / np.outer(scale, scale))
    kept = values > 1e-6 * max(values[-1], 1e-300)
    freedom = int(np.sum(kept))
    if not freedom:
        return 0.0
    statistic = float(np.sum((vectors[:, kept].T @ (pull / scale)) ** 2 / values[kept]))
    spread = 2.0 / (9.0 * freedom)
    return float(((statistic / freedom) ** (1.0 / 3.0) - (1.0 - spread)) / np.sqrt(spread))


def _inverse(information: Float[np.ndarray, "p p"]) -> Float[np.ndarray, "p p"]:
    """Of what is known; nothing where nothing is."""
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    return np.linalg.pinv(information / np.outer(scale, scale), rcond=NO_INFORMATION, hermitian=True) / np.outer(
        scale, scale
    )


def _determined(others: Float[np.ndarray, "p p"], everything: Float[np.ndarray, "p p"]) -> Bool[np.ndarray, " p"]:
    """Which parameters the records left still determine: none that takes part in a direction without information."""
    scale = np.sqrt(np.maximum(np.diag(everything), 1e-300))
    values, vectors = np.linalg.eigh(others / np.outer(scale, scale))
    open_directions = vectors[:, values <= NO_INFORMATION * max(values[-1], 1e-300)]
    return np.all(np.abs(open_directions) < 1e-3, axis=1)
