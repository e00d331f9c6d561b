"""A model of second order of a vector of residuals, learned from Jacobians, and the ends of intervals by it.

    r(x + d) = r + J d + T[d, d] / 2,        (J1 - J2) = T[x1 - x2] for any two points

One residual's T is a symmetric matrix; all of them are learned at once, from differences of Jacobians (J. E. Dennis,
D. M. Gay and R. E. Welsch, ACM Transactions on Mathematical Software 7(3), 1981, for the sum of residuals times
T).  This follows a narrow and bent valley of chi-square many times as far as J does.
Sums of squares of the model need no samples: one triangular factor of all its columns gives the same.

An end of a likelihood interval is found step by step, along parabolas that touch chi-square.  With residual r, Jacobian
J, half the Hessian H of chi-square, C = H^-1 and the target that chi-square has at an end, a parabola's own end of
parameter i is delta0 + side sqrt((target - m) / C_ii) C e_i, where delta0 minimises it and m is its least (D. J. Venzon
and S. H. Moolgavkar, Applied Statistics 37(1), 1988).
"""

import copy
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ..least_squares import Fit

_SHORT = 0.05
"""Length of a step, in the scale's units, below which a kink would look like a large curvature."""


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
    # The symmetric T of least norm with T A + A T = B + B'.
    weights, axes = np.linalg.eigh(steps)
    sums = weights[:, None] + weights[None, :]
    # A direction in which no probe lies has no curvature.
    known = sums > 1e-3 * max(float(np.max(sums)), 1e-300)
    rotated = axes.T @ (changes + changes.transpose(0, 2, 1)) @ axes
    return Curvature(axes @ np.where(known, rotated / np.where(known, sums, 1.0), 0.0) @ axes.T, scale)


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


Solve = Callable[[Bool[np.ndarray, " p"], Float[np.ndarray, " p"]], Float[np.ndarray, " p"]]
"""A function from what is held, and the step that it keeps, to the step of all."""

NULL = 1e-7
"""Relative singular value of a direction in which the residual does not change."""

_STEPS = 50
"""Largest number of steps along a model of second order."""

_ROOM = 2.0
"""Room for the parameters that are not profiled, in half widths of their linear intervals."""

_SMALLEST = 1e-6
"""Length of a step, in `Aim.sizes`, from which there is no further one."""


class Aim(NamedTuple):
    """The end that is searched for, and the box to search in."""

    index: int  # pyright: ignore[reportIncompatibleMethodOverride]
    """The profiled parameter."""
    side: float
    """-1.0 for the lower end, 1.0 for the upper one."""
    target: float
    """Chi-square at the end."""
    low: Float[np.ndarray, " p"]
    high: Float[np.ndarray, " p"]
    """The box in which to stay."""
    sizes: Float[np.ndarray, " p"]
    """Half widths of the linear intervals, in which steps are measured."""

    def shifted(self, at: Float[np.ndarray, " p"], radius: float) -> "Aim":
        """The aim relative to the point `at`, with the profiled parameter no farther than `radius`.

        The others have more room, to come back into a narrow valley, unless the radius is very small.
        """
        room = min(_ROOM, 20.0 * radius) + 3.0 * radius
        room = np.where(np.arange(at.size) == self.index, radius, room) * self.sizes
        return self._replace(low=np.maximum(self.low - at, -room), high=np.minimum(self.high - at, room))


class Parabola(NamedTuple):
    """Chi-square as the squares of p residuals that are linear, and a rest."""

    residual: Float[np.ndarray, " p"]
    jacobian: Float[np.ndarray, "p p"]
    rest: float

    def __call__(self, step: Float[np.ndarray, " p"]) -> float:
        return float(np.sum((self.residual + self.jacobian @ step) ** 2)) + self.rest


def parabola(model: SecondOrder, step: Float[np.ndarray, " p"]) -> Parabola:
    """The parabola that touches a model of second order at `step`; negative curvature counts as positive."""
    residual, jacobian = model(step)
    squares, axes = np.linalg.eigh(model.scale.T @ model.hessian(step) @ model.scale)
    lengths = np.sqrt(np.abs(squares))
    lengths = np.maximum(lengths, NULL * np.max(lengths, initial=1e-300))
    reduced = axes.T @ (model.scale.T @ (jacobian.T @ residual)) / lengths
    return Parabola(
        reduced, lengths[:, None] * (axes.T @ model.inverse), float(residual @ residual) - float(reduced @ reduced)
    )


def follow(model: SecondOrder, aim: Aim) -> Float[np.ndarray, " p"]:
    """The step from the point of a model of second order to the end that `aim` says, or as far as the box goes."""
    at, radius = np.zeros(aim.low.size), 1.0
    tangent, chi2 = parabola(model, at), float(np.sum(model(at)[0] ** 2))
    threshold = max(abs(aim.target - chi2), 1e-3 * aim.target / model.factor.shape[0], 1e-12)
    highest = max(aim.target, chi2) + threshold
    for _ in range(_STEPS):
        to_end = lambda held, step, tangent=tangent: _outwards(tangent, aim, held, step)
        step = _within(at, aim, to_end)
        step = step * min(1.0, radius / max(float(np.max(np.abs(step / aim.sizes))), 1e-300))
        length = float(np.max(np.abs(step / aim.sizes)))
        if length < _SMALLEST:
            break
        found = float(np.sum(model(at + step)[0] ** 2))
        missed = abs(found - tangent(step)) / (abs(tangent(step) - chi2) + threshold)
        if missed < 0.5 and found < highest:
            at = np.clip(at + step, aim.low, aim.high)
            tangent, chi2 = parabola(model, at), found
            radius *= 3.0 if missed < 0.1 else 1.0
        else:
            radius = 0.25 * min(radius, length)
    return at


def best_of_others(model: Parabola, at: Float[np.ndarray, " p"], aim: Aim) -> Float[np.ndarray, " p"]:
    """The step of all but the profiled parameter that lowers chi-square most, within the box."""
    profiled = np.arange(at.size) == aim.index
    return _within(at, aim, lambda held, step: _outwards(model, aim, held | profiled, np.where(profiled, 0.0, step)))


def lowest(
    model: SecondOrder, at: Float[np.ndarray, " p"], step: Float[np.ndarray, " p"], aim: Aim
) -> Float[np.ndarray, " p"]:
    """The step at which a model of second order is least with the profiled parameter where `step` has it.

    The `step` itself where no other is lower.
    """
    best, least = step, float(np.sum(model(step)[0] ** 2))
    for _ in range(_STEPS):
        more = best_of_others(parabola(model, step), at + step, aim)
        step = step + more
        found = float(np.sum(model(step)[0] ** 2))
        if not found < least:
            break
        best, least = step, found
        if float(np.max(np.abs(more / aim.sizes))) < _SMALLEST:
            break
    return best


def _within(at: Float[np.ndarray, " p"], aim: Aim, solve: Solve) -> Float[np.ndarray, " p"]:
    """The step of `solve`, where a parameter that would leave the box moves to its side and no further."""
    low, high = aim.low - at, aim.high - at
    held, step = low >= high, np.zeros(at.size)
    for _ in range(at.size):
        step = solve(held, step)
        beyond = ~held & ((step < low) | (step > high))
        if not beyond.any():
            break
        # The profiled parameter stops last, after the others have adapted.
        if beyond.sum() > 1:
            beyond[aim.index] = False
        step, held = np.where(beyond, np.clip(step, low, high), step), held | beyond
    return np.clip(step, low, high)


def _outwards(
    model: Parabola, aim: Aim, held: Bool[np.ndarray, " p"], step: Float[np.ndarray, " p"]
) -> Float[np.ndarray, " p"]:
    """The step to the end while those `held` keep their `step`; to the minimum if the profiled one is held itself."""
    step = np.where(held, step, 0.0)
    free = np.flatnonzero(~held)
    left, singular, rows, norms = scaled_svd(model.jacobian[:, free])
    residual = model.residual + model.jacobian @ step
    step[free] = -rows.T @ ((left.T @ residual) / singular) / norms
    if held[aim.index]:
        return step
    profiled = int(np.flatnonzero(free == aim.index)[0])
    unit = rows[:, profiled] / singular / norms[profiled]  # e_i in the singular directions; unit' unit is C_ii
    length = np.sqrt(max(aim.target - model(step), 0.0) / max(float(unit @ unit), 1e-300))
    step[free] += aim.side * length * (rows.T @ (unit / singular)) / norms
    return step


def scaled_svd(
    jacobian: Float[np.ndarray, "n p"],
) -> tuple[Float[np.ndarray, "n p"], Float[np.ndarray, " p"], Float[np.ndarray, "p p"], Float[np.ndarray, " p"]]:
    """Singular values and vectors of columns scaled to unit norm, and the norms."""
    norms = np.linalg.norm(jacobian, axis=0)
    norms = np.where(norms > 0, norms, 1.0)
    left, singular, rows = np.linalg.svd(jacobian / norms, full_matrices=False)
    return left, np.maximum(singular, NULL * np.max(singular, initial=1e-300)), rows, norms
