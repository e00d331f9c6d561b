"""Draws of parameters from the covariance of an estimate: what is known of them.

Positive parameters are normal in their logarithm, with the relative standard errors of the estimate; the others
are normal.  To first order both have the covariance given.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from ...core import InputError
from .base import AbstractPoints, Scatter


class CovarianceDraws(AbstractPoints):
    """`count` draws of some parameters about their estimates."""

    def __init__(
        self,
        paths: Sequence[str],
        means: Float[np.ndarray, " paths"],
        covariance: Float[np.ndarray, "paths paths"],
        positive: Bool[np.ndarray, " paths"],
        count: int,
        seed: int = 0,
    ):
        if count < 1:
            raise InputError(f"sweep: found {count} draws, expected at least 1.")
        if not (np.isfinite(covariance).all() and len(paths)):
            raise InputError(
                "sweep: found no finite covariance to draw from, expected an estimate with standard errors."
            )
        self._paths, self.means, self.positive = tuple(paths), np.asarray(means, float), np.asarray(positive, bool)
        self.covariance, self.count, self.seed = np.asarray(covariance, float), count, seed

    @property
    def paths(self) -> tuple[str, ...]:
        return self._paths

    def dimensions(self) -> dict[str, int]:
        return {"draw": self.count}

    def values(self) -> Float[np.ndarray, "points paths"]:
        normal = np.random.default_rng(self.seed).standard_normal((self.count, len(self.means)))
        return self.moved(normal @ self.root().T)

    def scattered(self) -> dict[str, Scatter]:
        errors = np.sqrt(np.diag(self.covariance))
        return {p: Scatter(float(m), float(e)) for p, m, e in zip(self.paths, self.means, errors, strict=True)}

    def root(self) -> Float[np.ndarray, "paths axes"]:
        """A square root of the covariance [1, or SI where not positive], on the scale of `moved`.

        Its columns are the principal axes.
        """
        unit = np.where(self.positive, self.means, 1.0)
        # By eigenvalues: a covariance with a parameter that another determines has no Cholesky factor.
        spread = np.sqrt(np.diag(self.covariance)) / np.abs(unit)
        safe = np.where(spread > 0, spread, 1.0)
        scaled = self.covariance / np.outer(unit * safe, unit * safe)
        variances, directions = np.linalg.eigh(scaled)
        return spread[:, None] * directions * np.sqrt(np.clip(variances, 0.0, None))

    def moved(self, away: Float[np.ndarray, "points paths"]) -> Float[np.ndarray, "points paths"]:
        """The means [SI] moved by `away`: a change of the logarithm where a parameter is positive."""
        return np.where(self.positive, self.means * np.exp(np.where(self.positive, away, 0.0)), self.means + away)
