"""A Gaussian prior on some parameters, whose errors may be correlated.

It comes from numbers measured apart, each with its standard error, or from a stack that was read off peaks, with the
covariance of its logarithms.  With W'W the inverse of the covariance, a fit has further residuals W (values - mean),
and its Jacobian further rows W.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import jax.numpy as jnp
import numpy as np
from jax.tree_util import register_dataclass
from jaxtyping import Array, Float

from ..study import Parameter, Values
from .beyond_noise import highest_by_chance


@register_dataclass
@dataclasses.dataclass(frozen=True, eq=False)
class Prior:
    """A Gaussian on k parameters; a pytree."""

    paths: tuple[str, ...] = dataclasses.field(default=(), metadata={"static": True})
    mean: Float[np.ndarray, " k"] = dataclasses.field(default_factory=lambda: np.zeros(0))
    """In SI, or its logarithms."""
    whitening: Float[np.ndarray, "k k"] = dataclasses.field(default_factory=lambda: np.zeros((0, 0)))
    """W, which turns errors into independent ones of standard deviation 1."""

    @staticmethod
    def measured_apart(parameters: Mapping[str, Parameter]) -> "Prior":
        """The prior [SI] on those of the `parameters` that were measured apart, their paths in alphabetical order."""
        found = {path: prior for path, p in sorted(parameters.items()) if (prior := p.measured_apart) is not None}
        mean, errors = np.array([*found.values()]).reshape(-1, 2).T
        return Prior(tuple(found), mean, np.diag(1.0 / errors))

    @staticmethod
    def of_covariance(
        paths: Sequence[str], mean: Float[np.ndarray, " k"], covariance: Float[np.ndarray, "k k"]
    ) -> "Prior":
        """The prior whose errors have this covariance."""
        return Prior(tuple(paths), mean, np.linalg.inv(np.linalg.cholesky(covariance)))

    @property
    def covariance(self) -> Float[np.ndarray, "k k"]:
        """Covariance of the errors."""
        inverse = np.linalg.inv(self.whitening)
        return inverse @ inverse.T

    def deviations(self, values: Values) -> Float[Array, " k"]:
        """How far `values` [SI] are from the mean, in independent standard errors; differentiable."""
        if not self.paths:
            return jnp.zeros(0)
        given = jnp.stack([jnp.asarray(values[path], float) for path in self.paths])
        return jnp.asarray(self.whitening) @ (given - self.mean)

    def redrawn(self, deviations: Float[np.ndarray, " k"], random: np.random.Generator) -> "Prior":
        """The prior by numbers measured anew, where the truth deviates from this prior's mean by `deviations`."""
        shift = np.linalg.solve(self.whitening, deviations - random.standard_normal(len(self.paths)))
        return dataclasses.replace(self, mean=self.mean + shift)

    def on_logarithms(self, paths: Sequence[str]) -> "Prior":
        """The prior on the logarithms of those parameters that are among the `paths`, for small relative errors."""
        here = [i for i, path in enumerate(self.paths) if path in paths]
        covariance = self.covariance[np.ix_(here, here)] / np.outer(self.mean[here], self.mean[here])
        return Prior.of_covariance([self.paths[i] for i in here], np.log(self.mean[here]), covariance)

    def combined(self, other: "Prior") -> "Prior":
        """This prior and an independent `other` on some of the same numbers, by least squares."""
        rows = np.zeros((len(other.paths), len(self.paths)))
        rows[:, [self.paths.index(path) for path in other.paths]] = other.whitening
        rows = np.concatenate([self.whitening, rows])
        target = np.concatenate([self.whitening @ self.mean, other.whitening @ other.mean])
        return Prior.of_covariance(self.paths, np.linalg.lstsq(rows, target)[0], np.linalg.inv(rows.T @ rows))

    def rows(self, paths: Sequence[str]) -> Float[np.ndarray, "m p"]:
        """W as rows of a Jacobian by the numbers at `paths`, for the marginal prior on its parameters among these.

        There is a row for each of these parameters, in the order of the `paths`.
        """
        here = [place for place, path in enumerate(paths) if path in self.paths]
        which = [self.paths.index(paths[place]) for place in here]
        rows = np.zeros((len(here), len(paths)))
        rows[:, here] = np.linalg.inv(np.linalg.cholesky(self.covariance[np.ix_(which, which)]))
        return rows


def is_by_chance(deviations: Float[np.ndarray, " k"]) -> bool:
    """Whether independent errors of parameters, in standard errors, are no larger than by chance."""
    return float(np.sum(deviations**2)) < deviations.size * highest_by_chance(deviations.size)
