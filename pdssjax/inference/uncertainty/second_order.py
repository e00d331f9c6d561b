"""A model of second order of a vector of residuals, its second derivatives learned from Jacobians that are there.

    r(x + d) = r + J d + T[d, d] / 2,        (J1 - J2) = T[x1 - x2] for any two points

One residual's T is a symmetric matrix; all of them are learned at once, from differences of Jacobians (J. E. Dennis,
D. M. Gay and R. E. Welsch, ACM Transactions on Mathematical Software 7(3), 1981, for the sum of residuals times
T).  Where a valley of chi-square is narrow and bent, though not its floor, this follows it many times as far as J.
Sums of squares of the model need no samples: one triangular factor of all its columns says the same.
"""

import copy
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..least_squares import Fit

_UNDETERMINED = 1e-3
"""Share of the largest weight below which a direction has been seen by no difference: no curvature there."""


_SHORT = 0.05
"""Length of a step, in the scale's units, below which a kink would pass for a large curvature."""


class Linearisation(NamedTuple):
    """Residuals and their Jacobian at a point."""

    at: Float[np.ndarray, " p"]
    residual: Float[np.ndarray, " n"]
    """Whitened."""
    jacobian: Float[np.ndarray, "n p"]

    @property
    def chi2(self) -> float:
        """The sum of squares; infinite where the model could not be evaluated."""
        value = float(self.residual @ self.residual)
        return value if np.isfinite(value) and np.isfinite(self.jacobian).all() else np.inf


def linearisation_at(fit: Fit) -> Linearisation:
    """The linearisation where a `fit` ended."""
    return Linearisation(np.asarray(fit.free, float), np.asarray(fit.state.residual), np.asarray(fit.state.jacobian))


class Curvature(NamedTuple):
    """Second derivatives of residuals in coordinates w, x = scale w."""

    second: Float[np.ndarray, "n p p"]
    scale: Float[np.ndarray, "p p"]

    def with_step(self, begin: Linearisation, end: Linearisation) -> "Curvature":
        """The nearest curvature that explains the change of the Jacobian from `begin` to `end`.

        M. J. D. Powell's symmetric form of Broyden's update, for each residual.
        """
        step, length = _step_in(self.scale, begin, end)
        if length < _SHORT:
            return self
        left = (end.jacobian - begin.jacobian) @ self.scale / length - self.second @ step
        change = left[:, :, None] * step + left[:, None, :] * step[:, None]
        change -= (left @ step)[:, None, None] * np.outer(step, step)
        return self._replace(second=self.second + change)


def learned_curvature(
    optimum: Linearisation, probes: Sequence[Linearisation], scale: Float[np.ndarray, "p p"]
) -> Curvature:
    """The curvature that explains best, by least squares, how the Jacobian changes from `optimum` to each probe."""
    size = scale.shape[1]
    steps, changes = np.zeros((size, size)), np.zeros((optimum.residual.size, size, size))
    for probe in probes:
        if np.isfinite(probe.chi2):
            step, length = _step_in(scale, optimum, probe)
            steps += np.outer(step, step)
            changes += ((probe.jacobian - optimum.jacobian) @ scale / length)[:, :, None] * step
    # The symmetric T with T A + A T = B + B', least where that leaves it open.
    weights, axes = np.linalg.eigh(steps)
    both = weights[:, None] + weights[None, :]
    known = both > _UNDETERMINED * max(float(np.max(both)), 1e-300)
    rotated = axes.T @ (changes + changes.transpose(0, 2, 1)) @ axes
    return Curvature(axes @ np.where(known, rotated / np.where(known, both, 1.0), 0.0) @ axes.T, scale)


def _step_in(
    scale: Float[np.ndarray, "p p"], begin: Linearisation, end: Linearisation
) -> tuple[Float[np.ndarray, " p"], float]:
    """The direction from `begin` to `end` in the coordinates of `scale`, and how far it is."""
    step = np.linalg.solve(scale, end.at - begin.at)
    length = max(float(np.linalg.norm(step)), 1e-300)
    return step / length, length


class SecondOrder:
    """The model at a point, as functions of the step d from it."""

    def __init__(self, point: Linearisation, curvature: Curvature):
        self.scale, size = curvature.scale, point.at.size
        self.first, self.second = np.triu_indices(size)
        share = np.where(self.first == self.second, 0.5, 1.0)  # of w_i w_j in T[w, w] / 2
        pairs = curvature.second[:, self.first, self.second] * share
        columns = np.concatenate([point.residual[:, None], point.jacobian @ self.scale, pairs], axis=1)
        self.factor: Float[np.ndarray, "m k"] = np.asarray(np.linalg.qr(columns, mode="r"))
        whole = np.zeros((self.factor.shape[0], size, size))
        whole[:, self.first, self.second] = self.factor[:, 1 + size :]
        self.tensor = whole + whole.transpose(0, 2, 1)
        self.inverse = np.linalg.inv(self.scale)

    def __call__(self, step: Float[np.ndarray, " p"]) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m p"]]:
        """Residuals and Jacobian, as m numbers with the same inner products."""
        w = self.inverse @ step
        bend = self.tensor @ w
        size = w.size
        linear = self.factor[:, 1 : 1 + size]
        residual = self.factor[:, 0] + linear @ w + 0.5 * bend @ w
        return residual, (linear + bend) @ self.inverse

    def straight(self) -> "SecondOrder":
        """The linear model at the same point."""
        found = copy.copy(self)
        found.tensor = np.zeros_like(self.tensor)
        return found

    def hessian(self, step: Float[np.ndarray, " p"]) -> Float[np.ndarray, "p p"]:
        """Half the Hessian of chi-square."""
        residual, jacobian = self(step)
        bent = np.tensordot(residual, self.tensor, 1)
        return jacobian.T @ jacobian + self.inverse.T @ bent @ self.inverse
