"""Ends of likelihood intervals: how far one parameter can go while the others make the best of it.

The 95 % interval of a parameter holds the values at which chi-square, minimised over all other parameters, stays
below its minimum plus a threshold.  Each end is found without a curve: at the current point the end of a model of
second order, whose residuals may bend (`second_order`), is the next point.  Where steps vanish the gradient has no
component but the parameter's own, and chi-square is the threshold's, whatever the model left out.  Curvature is
learned from Jacobians near the optimum, which all ends share, and along the way.
"""

import enum
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Float

from .quadratic_end import Aim, best_of_others, factors, follow, parabola
from .second_order import Curvature, Point, SecondOrder, learned

Evaluate = Callable[[Float[np.ndarray, " p"]], tuple[Float[Array | np.ndarray, " n"], Float[Array | np.ndarray, "n p"]]]
"""Whitened residual and its Jacobian at a point; not finite where the model cannot be evaluated."""

Box = tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]]
"""Lower and upper bounds."""

MOST_EVALUATIONS = 60
"""For one end."""

REACH = 7.0
"""How far a parameter is followed before it counts as flat, on the fit's scale: a factor of a thousand."""

_LEVEL = 1e-4
"""Share of the threshold by which chi-square may miss it at an end, and by which the others may still lower it."""

_KINKED = 2e-2
"""The same where chi-square has kinks and the search comes no nearer: one per cent of the half width."""

_STALLED = 5e-4
"""The same where evaluations come hardly nearer: a four-thousandth of the half width."""

_TRUSTED = 1.0
"""First radius of trust, in half widths of the linear interval."""

_SMALLEST = 1e-3
"""Radius below which chi-square does not follow its model: it has a discontinuity there."""

_PATIENCE = 10
"""Evaluations after which curvature is learned anew where the search is."""

PROBED = 0.05
"""How far from the optimum its curvature is probed, in half widths of the linear intervals."""


class Verdict(enum.StrEnum):
    """How a search for an end ended."""

    BOUNDED = "bounded"
    """Chi-square reaches the threshold at the end given."""
    AT_BOUND = "held by a bound"
    """It stays below the threshold up to the parameter's bound, which is the end given."""
    FLAT = "flat"
    """It stays below the threshold farther than can be followed."""
    LOWER = "several minima"
    """A point with a smaller chi-square than the optimum's was found on the way."""
    LOST = "not followed"
    """It has a discontinuity on the way, cannot be evaluated, or takes too many evaluations."""


class End(NamedTuple):
    """One end of the interval of a parameter."""

    value: float
    """On the fit's scale; infinite where flat, NaN where not followed."""
    verdict: Verdict
    point: Point
    """All parameters there, with residual and Jacobian."""
    evaluations: int


def linearise(evaluate: Evaluate, at: Float[np.ndarray, " p"]) -> Point:
    """`evaluate` at a point, as arrays of NumPy."""
    residual, jacobian = evaluate(at)
    return Point(np.array(at, float), np.asarray(residual), np.asarray(jacobian))


def learn_curvature(
    evaluate: Evaluate, optimum: Point, threshold: float, bounds: Box, reach: float = REACH
) -> Curvature:
    """What all ends of an `optimum` share: as many evaluations as there are parameters.

    Each goes a little along the valley in which one parameter would leave the optimum.
    """
    sizes, scale = _standard_errors(optimum, threshold, reach)
    return _probed(evaluate, optimum, sizes, scale, bounds)


def _probed(
    evaluate: Evaluate, point: Point, sizes: Float[np.ndarray, " p"], scale: Float[np.ndarray, "p p"], bounds: Box
) -> Curvature:
    """The curvature around a point, from one evaluation a parameter."""
    probes = []
    for index in range(point.at.size):
        along = scale @ scale[index]
        step = PROBED * along * (sizes[index] / max(abs(along[index]), 1e-300))
        ahead, behind = (np.clip(point.at + sign * step, *bounds) for sign in (1.0, -1.0))
        farther = np.abs(ahead - point.at).max() >= np.abs(behind - point.at).max()
        probes.append(linearise(evaluate, ahead if farther else behind))
    return learned(point, [probe for probe in probes if np.any(probe.at != point.at)], scale)


def linear_half_widths(optimum: Point, threshold: float, reach: float = REACH) -> Float[np.ndarray, " p"]:
    """How far from the `optimum` the ends are by the linear model, none farther than `reach`."""
    return _standard_errors(optimum, threshold, reach)[0]


def interval_end(
    evaluate: Evaluate,
    optimum: Point,
    index: int,
    side: float,
    threshold: float,
    bounds: Box,
    reach: float = REACH,
    curvature: Curvature | None = None,
) -> End:
    """The end of one parameter's interval on one `side` (-1.0 or 1.0).

    **Arguments:** the `optimum` of the sum of squares between `bounds`; the `threshold` by which chi-square may
    exceed its minimum; how far the parameter is followed before it counts as flat, `reach` on the fit's scale;
    the `curvature` at the optimum where it is known (`learn_curvature`).
    """
    return _Search(evaluate, optimum, index, side, threshold, bounds, reach, curvature).run()


class _Search:
    def __init__(
        self,
        evaluate: Evaluate,
        optimum: Point,
        index: int,
        side: float,
        threshold: float,
        bounds: Box,
        reach: float,
        curvature: Curvature | None,
    ):
        self.evaluate, self.optimum, self.threshold, self.reach = evaluate, optimum, threshold, reach
        sizes, scale = _standard_errors(optimum, threshold, reach)
        low, high = (np.asarray(end, float) for end in bounds)
        self.bound = float((high if side > 0 else low)[index])
        # What runs away is held there: its effect has died out long before.
        low, high = np.maximum(low, optimum.at - reach), np.minimum(high, optimum.at + reach)
        self.aim = Aim(index, side, optimum.chi2 + threshold, low, high, sizes)
        self.curvature = learned(optimum, [], scale) if curvature is None else curvature
        self.evaluations, self.learned_at = 0, 0
        self.learned_for: Point | None = None
        self.nearest = np.inf, optimum

    def run(self) -> End:
        """Follow the models' ends until they stay where they are."""
        point, radius = self.optimum, _TRUSTED
        model = SecondOrder(point, self.curvature)
        while self.evaluations < MOST_EVALUATIONS:
            step = follow(model, self.aim.shifted(point.at, radius))
            found, length = self._linearised(point.at + step), self._length(step)
            foretold = float(np.sum(model(step)[0] ** 2))
            missed = abs(found.chi2 - foretold) / (abs(foretold - point.chi2) + self.threshold)
            # Off the valley by less than the threshold: the next step comes back to it.
            near = found.chi2 < max(point.chi2, self.aim.target) + self.threshold
            if not (missed < 0.5 and near):
                radius = 0.25 * min(radius, max(length, _SMALLEST))
                if radius < _SMALLEST:
                    if self.learned_for is point:
                        return self._given_up()
                    model, radius = self._anew(point), _TRUSTED
                elif self._misled(point, step, found.chi2, foretold):
                    model = SecondOrder(point, self.curvature)
                continue
            radius *= 3.0 if missed < 0.1 else 1.0
            self.curvature = self.curvature.with_step(point, found)
            point, model = found, SecondOrder(found, self.curvature)
            verdict = self._verdict(point, model)
            if verdict is not None:
                return self._end(self.nearest[1] if verdict == Verdict.BOUNDED else point, verdict)
            if self.evaluations - self.learned_at >= _PATIENCE:
                if self.nearest[0] < _KINKED and self.learned_for is not None:
                    break
                model = self._anew(point)
        return self._given_up()

    def _misled(self, point: Point, step: Float[np.ndarray, " p"], found: float, foretold: float) -> bool:
        """Whether what passes for curvature is none (a kink near the optimum does); it is then forgotten."""
        plain = float(np.sum((point.residual + point.jacobian @ step) ** 2))
        misled = np.isfinite(found) and abs(found - plain) < abs(found - foretold)
        if misled:
            self.curvature = learned(point, [], self.curvature.scale)
        return bool(misled)

    def _anew(self, point: Point) -> SecondOrder:
        """The model at a point far from the optimum, with the curvature there."""
        box = self.aim.low, self.aim.high
        self.curvature = _probed(self.evaluate, point, self.aim.sizes, self.curvature.scale, box)
        self.evaluations += point.at.size
        self.learned_at, self.learned_for = self.evaluations, point
        return SecondOrder(point, self.curvature)

    def _verdict(self, point: Point, model: SecondOrder) -> Verdict | None:
        """Of the interval that ends at this `point`; None where it does not."""
        at, missed, gain = point.at[self.aim.index], point.chi2 - self.aim.target, self._gain(point, model)
        if point.chi2 < self.optimum.chi2 - 0.01 * self.threshold:
            return Verdict.LOWER
        error = (abs(missed) + gain) / self.threshold
        stalled = self.nearest[0] < _STALLED and error > 0.25 * self.nearest[0]
        if error < self.nearest[0]:
            self.nearest = error, point
        if stalled:
            return Verdict.BOUNDED
        if gain > _LEVEL * self.threshold:
            return None
        if abs(missed) < _LEVEL * self.threshold:
            return Verdict.BOUNDED
        if missed < 0.0 and at == self.bound:
            return Verdict.AT_BOUND
        if missed < 0.0 and abs(at - self.optimum.at[self.aim.index]) >= self.reach:
            return Verdict.FLAT
        return None

    def _gain(self, point: Point, model: SecondOrder) -> float:
        """By how much the other parameters may still lower chi-square, by the model and within the bounds."""
        touching = parabola(model, np.zeros(point.at.size))
        return point.chi2 - touching(best_of_others(touching, point.at, self.aim))

    def _given_up(self) -> End:
        """The nearest point to an end, where chi-square has kinks that no model knows."""
        error, point = self.nearest
        return self._end(point, Verdict.BOUNDED if error < _KINKED else Verdict.LOST)

    def _length(self, step: Float[np.ndarray, " p"]) -> float:
        """Of what the radius of trust limits: the profiled parameter's part, or the others' beyond their room."""
        index = self.aim.index
        return float(abs(step[index]) / self.aim.sizes[index])

    def _linearised(self, at: Float[np.ndarray, " p"]) -> Point:
        self.evaluations += 1
        return linearise(self.evaluate, np.clip(at, self.aim.low, self.aim.high))

    def _end(self, point: Point, verdict: Verdict) -> End:
        value = float(point.at[self.aim.index])
        if verdict == Verdict.FLAT:
            value = self.aim.side * np.inf
        if verdict == Verdict.LOST:
            value = float("nan")
        return End(value, verdict, point, self.evaluations)


def _standard_errors(
    optimum: Point, threshold: float, reach: float
) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, "p p"]]:
    """Half widths of the linear intervals, none longer than can be followed; and a scale: J scale is orthonormal."""
    _, singular, rows, norms = factors(optimum.jacobian)
    scale = (rows / singular[:, None]).T / norms[:, None]
    scale = scale * np.minimum(1.0, reach / np.maximum(np.max(np.abs(scale), axis=0), 1e-300))
    return np.minimum(np.linalg.norm(scale, axis=1) * np.sqrt(threshold), reach), scale
