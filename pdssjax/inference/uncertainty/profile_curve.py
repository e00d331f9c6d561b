"""The curve of chi-square between an optimum and an end of a likelihood interval.

The valley between two points at which all is known is a cubic in the profiled parameter, by values and tangents
of the others; what is known of how residuals bend brings a point nearer to its floor.  The point halfway is evaluated,
the linear model there tells what the others still gain, and where it misses the cubic each half is treated alike.  So
the curve has values and slopes at a few points, and cubics between them.
"""

import itertools
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ..covariance import scaled_least_squares
from ..parameter_transform import Box
from .end_search import End, SharedCurvature, standard_errors
from .profile_likelihood import REACH, Evaluate, linearise
from .quadratic_end import NULL, Aim, lowest
from .second_order import Linearisation, SecondOrder

_HALVINGS = 2
"""Halvings of each side at most: 3 points between the optimum and the end."""

_BENT = 0.02
"""Share of the threshold by which a point misses the cubic, from which each half has a point of its own."""

_SHOWN = 12
"""Points shown of each side besides the optimum."""

_OFF = 0.02
"""Share of the threshold that the others may still gain at a point by the linear model; beyond it they move."""

_CORRECTIONS = 8
"""Evaluations at most to bring a point into the valley."""


class Curve(NamedTuple):
    """One side or both, the profiled parameter on the scale of the fit and ascending."""

    value: Float[np.ndarray, " points"]
    excess: Float[np.ndarray, " points"]
    """Chi-square above its minimum, minimised over all else."""
    computed: Bool[np.ndarray, " points"]
    missed: float
    """The most by which a point misses the cubic of its neighbours, in units of the threshold; NaN without points."""
    falls: float
    """The most by which the excess falls on the way outwards, in units of the threshold."""
    evaluations: int

    @property
    def quality(self) -> float:
        """1 where interpolation predicts each point, 0 where one misses by the threshold; NaN without points."""
        return float(np.maximum(0.0, 1.0 - self.missed))


class _Node(NamedTuple):
    """A point of the valley."""

    point: Linearisation
    excess: float
    slope: float
    """Derivative of the excess by the profiled parameter."""
    tangent: Float[np.ndarray, " p"]
    """Derivative of the valley by the profiled parameter; 1 for itself."""


def profile_curve(
    evaluate: Evaluate,
    optimum: Linearisation,
    index: int,
    ends: tuple[End, End],
    threshold: float,
    bounds: Box,
    shared: SharedCurvature,
    reach: float = REACH,
) -> Curve:
    """Both sides of the profile of the parameter `index`, between its `ends`: lower and upper.

    `shared` is what the searches for the ends have learned.
    """
    sides = [_Side(evaluate, optimum, index, threshold, bounds, shared, reach).run(end.point) for end in ends]
    low, high = sides
    return Curve(
        np.concatenate([low.value[::-1], high.value[1:]]),
        np.concatenate([low.excess[::-1], high.excess[1:]]),
        np.concatenate([low.computed[::-1], high.computed[1:]]),
        float(np.fmax(low.missed, high.missed)),
        max(low.falls, high.falls),
        low.evaluations + high.evaluations,
    )


class _Side:
    """The valley between the optimum and one end."""

    def __init__(
        self,
        evaluate: Evaluate,
        optimum: Linearisation,
        index: int,
        threshold: float,
        bounds: Box,
        shared: SharedCurvature,
        reach: float,
    ):
        self.evaluate, self.optimum, self.index, self.threshold = evaluate, optimum, index, threshold
        self.low, self.high = np.maximum(bounds[0], optimum.at - reach), np.minimum(bounds[1], optimum.at + reach)
        sizes = standard_errors(optimum, threshold, reach)[0]
        self.aim, self.shared = Aim(index, 1.0, optimum.chi2, self.low, self.high, sizes), shared
        self.evaluations, self.missed = 0, float("nan")

    def run(self, end: Linearisation) -> Curve:
        """Follow the valley from the optimum to the `end`."""
        first, last = self._node(self.optimum), self._node(end)
        if not (np.isfinite(last.excess) and end.at[self.index] != self.optimum.at[self.index]):
            nothing = np.zeros(1)
            return Curve(self.optimum.at[[self.index]], nothing, nothing == 0.0, float("nan"), 0.0, 0)
        nodes = [first, *self._between(first, last, _HALVINGS), last]
        at = np.array([node.point.at[self.index] for node in nodes])
        heights = np.array([node.excess for node in nodes])
        segments = list(itertools.pairwise(nodes))
        shown = _SHOWN // len(segments)
        value = np.concatenate([[at[0]], *(np.linspace(*pair, shown + 1)[1:] for pair in itertools.pairwise(at))])
        excess = [
            _cubic(*segment, self.index, v)
            for k, segment in enumerate(segments)
            for v in value[1:].reshape(-1, shown)[k]
        ]
        falls = float(np.max(np.maximum.accumulate(heights) - heights)) / self.threshold
        computed = np.arange(value.size) % shown == 0
        return Curve(value, np.array([0.0, *excess]), computed, self.missed, falls, self.evaluations)

    def _between(self, one_end: _Node, other_end: _Node, halvings: int) -> list[_Node]:
        """Nodes between two others, in their order."""
        if not halvings:
            return []
        at = 0.5 * (one_end.point.at[self.index] + other_end.point.at[self.index])
        node = self._corrected(self._linearised(self._valley(one_end, other_end, at)))
        if not np.isfinite(node.excess):
            return []
        foretold = _cubic(one_end, other_end, self.index, at)
        missed = abs(node.excess - foretold) / self.threshold
        if halvings < _HALVINGS or missed < _BENT:
            # Of a cubic between points half as far apart: a sixteenth of what was missed before it was halved.
            self.missed = float(np.fmax(self.missed, missed if halvings < _HALVINGS else missed / 16.0))
        if missed < _BENT:
            return [node]
        return [
            *self._between(one_end, node, halvings - 1),
            node,
            *self._between(node, other_end, halvings - 1),
        ]

    def _corrected(self, point: Linearisation) -> _Node:
        """The node at a `point`, after steps of the others that bring it into the valley where it is off."""
        node, share = self._node(point), 1.0
        for _ in range(_CORRECTIONS):
            if not point.chi2 - self.optimum.chi2 - node.excess > _OFF * self.threshold:
                break
            nearer = self._linearised(point.at + share * self._best(point))
            share = 1.0 if nearer.chi2 < point.chi2 else 0.25 * share
            if nearer.chi2 < point.chi2:
                point, node = nearer, self._node(nearer)
        return node

    def _valley(self, one_end: _Node, other_end: _Node, at: float) -> Float[np.ndarray, " p"]:
        """All parameters where the profiled one is `at`."""
        near, far = one_end.point.at, other_end.point.at
        guess = _hermite(near[self.index], far[self.index], near, far, one_end.tangent, other_end.tangent, at)
        guess[self.index] = at
        guess = np.clip(guess, self.low, self.high)
        nearer = min((one_end.point, other_end.point), key=lambda point: abs(point.at[self.index] - at))
        curvature = self.shared.at(0.5 * (guess + nearer.at))
        if curvature is None:
            return guess
        return nearer.at + lowest(SecondOrder(nearer, curvature), nearer.at, guess - nearer.at, self.aim)

    def _node(self, point: Linearisation) -> _Node:
        """The node of the valley near a point, by the linear model."""
        if not np.isfinite(point.chi2):
            return _Node(point, np.inf, np.nan, np.zeros(point.at.size))
        residual = point.residual + point.jacobian @ self._best(point)
        slope = 2.0 * float(point.jacobian[:, self.index] @ residual)
        others = self._others(point)
        tangent = np.zeros(point.at.size)
        tangent[others] = -scaled_least_squares(point.jacobian[:, others], point.jacobian[:, self.index], NULL)
        tangent[self.index] = 1.0
        return _Node(point, float(residual @ residual) - self.optimum.chi2, slope, tangent)

    def _best(self, point: Linearisation) -> Float[np.ndarray, " p"]:
        """The step of the others that lowers chi-square most, by the linear model and within the bounds."""
        others, step = self._others(point), np.zeros(point.at.size)
        step[others] = -scaled_least_squares(point.jacobian[:, others], point.residual, NULL)
        return np.clip(point.at + step, self.low, self.high) - point.at

    def _others(self, point: Linearisation) -> Bool[np.ndarray, " p"]:
        """The parameters besides the profiled one that are not at a bound."""
        return (point.at > self.low) & (point.at < self.high) & (np.arange(point.at.size) != self.index)

    def _linearised(self, at: Float[np.ndarray, " p"]) -> Linearisation:
        self.evaluations += 1
        return linearise(self.evaluate, at)


def _cubic(one_end: _Node, other_end: _Node, index: int, at: float) -> float:
    """The excess between two nodes."""
    low, high = one_end.point.at[index], other_end.point.at[index]
    first, last, slope_first, slope_last = (
        np.array(value) for value in (one_end.excess, other_end.excess, one_end.slope, other_end.slope)
    )
    return float(_hermite(low, high, first, last, slope_first, slope_last, at))


def _hermite(
    low: float,
    high: float,
    first: Float[np.ndarray, "*shape"],
    last: Float[np.ndarray, "*shape"],
    slope_first: Float[np.ndarray, "*shape"],
    slope_last: Float[np.ndarray, "*shape"],
    at: float,
) -> Float[np.ndarray, "*shape"]:
    """The cubic with values and slopes given at `low` and `high`, limited so that it stays between the values."""
    width, rise = high - low, last - first
    t = (at - low) / width
    start, end = (_limited(width * slope, rise) for slope in (slope_first, slope_last))
    return first + t * (start + t * (3.0 * rise - 2.0 * start - end + t * (start + end - 2.0 * rise)))


def _limited(slope: Float[np.ndarray, "*shape"], rise: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """A slope that keeps a cubic between its ends (F. N. Fritsch and R. E. Carlson, SIAM J. Num. Anal. 17(2), 1980)."""
    return np.where(slope * rise > 0.0, np.clip(slope, -3.0 * np.abs(rise), 3.0 * np.abs(rise)), 0.0)
