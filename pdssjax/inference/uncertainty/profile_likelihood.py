"""Profile likelihood: the range of each parameter, chi-square minimised over all others.

The 95 % interval of a parameter holds the values at which this profile stays below its minimum plus a threshold.  The
ends of all intervals are searched for side by side, without computing the curves between them.

The next point of a search is the end by a model of second order at the current point (`second_order`).  Where steps
vanish, the gradient has only the parameter's own component and chi-square is at the threshold, however rough the model.

All searches share one curvature of the residuals: at first that at the optimum, from probes; then a polynomial of third
order (`residual_polynomial`), as soon as the linearisations of all searches determine one.  A search that neither
follows learns the curvature at its own point.
"""

import enum
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Executor
from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Float

from ..draws import each_done
from ..parameter_transform import Box
from .residual_polynomial import SampledPolynomial, count_points, learned_polynomial
from .second_order import (
    Aim,
    Curvature,
    Linearisation,
    SecondOrder,
    best_of_others,
    follow,
    learned_curvature,
    parabola,
    scaled_svd,
)

Evaluate = Callable[
    [Float[Array | np.ndarray, " p"]], tuple[Float[Array | np.ndarray, " n"], Float[Array | np.ndarray, "n p"]]
]
"""Whitened residual and its Jacobian at a point; not finite where the model cannot be evaluated."""

SIDES = -1.0, 1.0
"""The lower and the upper end of an interval."""

EndKey = tuple[int, float]
"""Index of a parameter, and the side of its interval, one of `SIDES`."""

REACH = 7.0
"""How far a parameter is followed before it counts as flat, on the fit's scale: a factor of a thousand."""


def linearise(evaluate: Evaluate, at: Float[np.ndarray, " p"]) -> Linearisation:
    """`evaluate` at a point, as arrays of NumPy."""
    residual, jacobian = evaluate(at)
    return Linearisation(np.array(at, float), np.asarray(residual), np.asarray(jacobian))


def linearise_all(
    evaluate: Evaluate, places: Sequence[Float[np.ndarray, " p"]], executor: Executor | None = None
) -> list[Linearisation]:
    """`evaluate` at several points, side by side in the threads of the `executor`."""
    work = lambda number: linearise(evaluate, places[number])
    found = dict(each_done(work, range(len(places)), executor))
    return [found[number] for number in range(len(places))]


PROBE_DISTANCE = 0.05
"""Distance from a point at which its curvature is probed, in half widths of the linear intervals."""


def standard_errors(
    optimum: Linearisation, threshold: float | Float[np.ndarray, " p"], reach: float
) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, "p p"]]:
    """Half widths of the linear intervals, none longer than `reach`; and a scale: J scale is orthonormal.

    The `threshold` is that of all parameters, or one each.  A parameter that changes nothing within the reach has an
    axis of its own, as long as that: singular vectors of equal values would mix it with others and shorten theirs.
    """
    determined = reach * np.linalg.norm(optimum.jacobian, axis=0) > np.sqrt(threshold)
    scale = np.diag(np.where(determined, 0.0, reach))
    if determined.any():
        _, singular, rows, norms = scaled_svd(optimum.jacobian[:, determined])
        axes = (rows / singular[:, None]).T / norms[:, None]
        axes = axes * np.minimum(1.0, reach / np.maximum(np.max(np.abs(axes), axis=0), 1e-300))
        scale[np.ix_(determined, np.flatnonzero(determined)[: singular.size])] = axes
    return np.minimum(np.linalg.norm(scale, axis=1) * np.sqrt(threshold), reach), scale


def probe_places(
    at: Float[np.ndarray, " p"], sizes: Float[np.ndarray, " p"], scale: Float[np.ndarray, "p p"], bounds: Box
) -> list[Float[np.ndarray, " p"]]:
    """One place for each parameter, a little along the valley that chi-square has in its direction."""
    places = []
    for index in range(at.size):
        along = scale @ scale[index]
        step = PROBE_DISTANCE * along * (sizes[index] / max(abs(along[index]), 1e-300))
        ahead, behind = (np.clip(at + sign * step, *bounds) for sign in (1.0, -1.0))
        places.append(ahead if np.abs(ahead - at).max() >= np.abs(behind - at).max() else behind)
    return [place for place in places if np.any(place != at)]


class SharedCurvature:
    """The curvature that all searches around an `optimum` share, from `probes` near it on.

    **Arguments:** the `scale` in which the Jacobian's columns are orthonormal; the `factor` by which variances exceed
    those of the noise given.
    """

    def __init__(
        self,
        optimum: Linearisation,
        probes: Sequence[Linearisation],
        scale: Float[np.ndarray, "p p"],
        factor: float = 1.0,
    ):
        self.optimum, self.scale, self.factor = optimum, scale, factor
        self.at_optimum = learned_curvature(optimum, probes, scale)
        self.points: list[Linearisation] = list(probes)
        # Without probes the points may leave directions undetermined: then only each search's own curvature counts.
        self.learns = bool(probes)
        self.polynomial: SampledPolynomial | None = None
        self.due = count_points(optimum.at.size)
        """Number of linearisations, the optimum's among them, from which the polynomial is learned next."""

    def learn(self, points: Sequence[Linearisation]) -> None:
        """Refit the residual polynomial to further linearisations."""
        self.points += points
        if self.learns and len(self.points) + 1 >= self.due:
            self.polynomial = learned_polynomial(self.optimum, self.points, self.scale, self.factor)
            # Not for every point: learning may take longer than they do.
            self.due = int(1.1 * len(self.points)) + 1

    def at(self, place: Float[np.ndarray, " p"]) -> Curvature | None:
        """The curvature at a place by the polynomial, if there is one."""
        return None if self.polynomial is None else self.polynomial.curvature(place, self.scale)


PointRequests = Generator[Float[np.ndarray, " p"], Linearisation, "End"]
"""A generator that yields the next point to linearise at, is sent the linearisation, and returns the end."""

MOST_EVALUATIONS = 60
"""Evaluations for one end at most."""

_GAINED = 2e-3
"""Share of the threshold that the others may still gain at an end: so little is predicted to a tenth of it."""

_MISSED = 5e-3
"""Share of the threshold by which the profile may miss it at the last point: its slope then tells the end."""

_KINKED = 2e-2
"""Share of the threshold that may be missed and gained where chi-square has kinks: one per cent of the half width."""

_TRUSTED = 0.1, 1.0
"""Least and largest first radius of trust, in half widths of the linear interval."""

_OFF = 5.0
"""Thresholds above the target that a point may lie where the shared polynomial tells the way from it."""

_SMALLEST = 1e-3
"""Radius below which chi-square does not follow its model: it has a discontinuity there."""

_PATIENCE = 15
"""Evaluations after which curvature is learned anew where the search is."""


class Verdict(enum.StrEnum):
    """How a search for an end ended."""

    BOUNDED = "bounded"
    """Chi-square reaches the threshold at the end given."""
    AT_BOUND = "held by a bound"
    """Chi-square stays below the threshold up to the parameter's bound, which is the end given."""
    FLAT = "flat"
    """Chi-square stays below the threshold farther than can be followed."""
    LOWER = "several minima"
    """A point with a smaller chi-square than the optimum's was found on the way."""
    LOST = "not followed"
    """Chi-square is discontinuous on the way, cannot be evaluated, or takes too many evaluations."""


class End(NamedTuple):
    """One end of the interval of a parameter."""

    value: float
    """The end on the fit's scale; infinite where flat, NaN where not followed."""
    verdict: Verdict
    point: Linearisation
    """All parameters there, with residual and Jacobian."""
    evaluations: int


class EndSearch:
    """The search for the end that `aim` says, from the `optimum`."""

    def __init__(
        self, optimum: Linearisation, aim: Aim, bound: float, reach: float, threshold: float, shared: SharedCurvature
    ):
        self.optimum, self.aim, self.bound, self.reach, self.threshold = optimum, aim, bound, reach, threshold
        self.shared, self.local = shared, shared.at_optimum
        self.alone = False
        self.evaluations, self.learned_at = 0, 0
        self.learned_for: Linearisation | None = None
        self.nearest = np.inf, optimum

    def run(self) -> PointRequests:
        """Follow the models' ends until they stay where they are."""
        index, point, model = self.aim.index, self.optimum, self._model(self.optimum)
        radius = self._first_radius(model)
        while self.evaluations < MOST_EVALUATIONS:
            step = follow(model, self.aim.shifted(point.at, radius))
            found = yield from self._linearised(point.at + step)
            predicted = float(np.sum(model(step)[0] ** 2))
            missed = abs(found.chi2 - predicted) / (abs(predicted - point.chi2) + self.threshold)
            # Off the valley by little: the next step comes back to it.
            off = (found.chi2 - max(point.chi2, self.aim.target)) / self.threshold
            is_shared = self.shared.polynomial is not None and not self.alone
            if (missed < 0.5 and off < 1.0) or (off < _OFF and is_shared):
                radius *= 3.0 if missed < 0.1 else 1.0
                if not is_shared:
                    self.local = self.local.with_step(point, found)
                point, model = found, self._model(found)
                end = self._end_at(point, model)
                if end is not None:
                    return end
                impatient = self.evaluations - self.learned_at >= _PATIENCE
                if impatient and self.nearest[0] < _KINKED and self.learned_for is not None:
                    break
            else:
                radius = 0.25 * min(radius, max(abs(step[index]) / self.aim.sizes[index], _SMALLEST))
                impatient = radius < _SMALLEST
                if impatient and self.learned_for is point:
                    break
                linear = float(np.sum((point.residual + point.jacobian @ step) ** 2))
                straighter = np.isfinite(found.chi2) and abs(found.chi2 - linear) < abs(found.chi2 - predicted)
                if self.shared.polynomial is None and straighter:
                    # The curvature is that of a kink near the optimum, and does not hold here.
                    self.local = learned_curvature(point, [], self.local.scale)
                model = self._model(point)
            if impatient:
                yield from self._probe_curvature(point)
                radius, model = max(radius, 0.3), self._model(point)
        error, point = self.nearest  # chi-square may have kinks there that no model knows
        return self._end(point, Verdict.BOUNDED if error < _KINKED else Verdict.LOST)

    def _first_radius(self, model: SecondOrder) -> float:
        """Radius within which the error of the model may be expected to stay below the threshold.

        At a radius h residuals change by h linearly, by q h^2 as they bend and, if that goes on, by q^2 h^3 beyond.
        """
        along = self.shared.scale @ self.shared.scale[self.aim.index]
        step = along * (self.aim.sizes[self.aim.index] / max(abs(along[self.aim.index]), 1e-300))
        bend = model(step)[0] - model.straight()(step)[0]
        q = float(np.linalg.norm(bend)) / np.sqrt(self.threshold)
        return float(np.clip(max(q, 1e-300) ** (-2.0 / 3.0), *_TRUSTED))

    def _model(self, point: Linearisation) -> SecondOrder:
        shared = None if self.alone else self.shared.at(point.at)
        return SecondOrder(point, self.local if shared is None else shared)

    def _probe_curvature(self, point: Linearisation) -> Generator[Float[np.ndarray, " p"], Linearisation, None]:
        """Learn the curvature at a point far from the optimum."""
        places = probe_places(point.at, self.aim.sizes, self.local.scale, (self.aim.low, self.aim.high))
        probes: list[Linearisation] = []
        for place in places:
            probe = yield from self._linearised(place)
            probes.append(probe)
        self.alone, self.local = True, learned_curvature(point, probes, self.local.scale)
        self.learned_at, self.learned_for = self.evaluations, point

    def _end_at(self, point: Linearisation, model: SecondOrder) -> End | None:
        if point.chi2 < self.optimum.chi2 - 0.01 * self.threshold:
            return self._end(point, Verdict.LOWER)
        gain, slope = self._gain_of_others(point, model)
        missed = (point.chi2 - gain - self.aim.target) / self.threshold
        error = abs(missed) + gain / self.threshold
        if error < self.nearest[0]:
            self.nearest = error, point
        if gain > _GAINED * self.threshold:
            return None
        if abs(missed) < _MISSED and slope * self.aim.side > 0.0:
            return self._end(point, Verdict.BOUNDED, -missed * self.threshold / slope)
        at = point.at[self.aim.index]
        if missed < 0.0 and at == self.bound:
            return self._end(point, Verdict.AT_BOUND)
        if missed < 0.0 and abs(at - self.optimum.at[self.aim.index]) >= self.reach:
            return self._end(point, Verdict.FLAT)
        return None

    def _gain_of_others(self, point: Linearisation, model: SecondOrder) -> tuple[float, float]:
        """Decrease of chi-square that the other parameters allow within the bounds, and its slope there.

        This is the larger decrease of two, by the model and by a linear one: a wrong curvature would hide it.
        """
        gains = []
        for each in (model, model.straight()):
            tangent = parabola(each, np.zeros(point.at.size))
            step = best_of_others(tangent, point.at, self.aim)
            rest = tangent.residual + tangent.jacobian @ step
            gains.append((point.chi2 - tangent(step), 2.0 * float(tangent.jacobian[:, self.aim.index] @ rest)))
        return max(gains)

    def _linearised(
        self, at: Float[np.ndarray, " p"]
    ) -> Generator[Float[np.ndarray, " p"], Linearisation, Linearisation]:
        self.evaluations += 1
        return (yield np.clip(at, self.aim.low, self.aim.high))

    def _end(self, point: Linearisation, verdict: Verdict, beyond: float = 0.0) -> End:
        index = self.aim.index
        value = float(np.clip(point.at[index] + beyond, self.aim.low[index], self.aim.high[index]))
        value = {Verdict.FLAT: self.aim.side * np.inf, Verdict.LOST: float("nan")}.get(verdict, value)
        return End(value, verdict, point, self.evaluations)


class ProfileLikelihood:
    """Chi-square around an `optimum` between `bounds`, minimised over all parameters but one.

    **Arguments:** `evaluate` gives residuals and their Jacobian; the `threshold` is the excess of chi-square at an end,
    one for all parameters or one each; variances exceed those of the noise given by the `factor`; points are evaluated
    side by side in the threads of the `executor`; a parameter is followed as far as `reach` on the fit's scale before
    it counts as flat.
    """

    def __init__(
        self,
        evaluate: Evaluate,
        optimum: Linearisation,
        threshold: float | Float[np.ndarray, " p"],
        bounds: Box,
        factor: float = 1.0,
        executor: Executor | None = None,
        reach: float = REACH,
    ):
        self.evaluate, self.optimum, self.bounds, self.executor, self.reach = evaluate, optimum, bounds, executor, reach
        self.thresholds = np.broadcast_to(threshold, optimum.at.shape)
        # A parameter that runs away is held at the reach, where it has long lost its effect.
        self.low, self.high = np.maximum(bounds[0], optimum.at - reach), np.minimum(bounds[1], optimum.at + reach)
        self.sizes, scale = standard_errors(optimum, threshold, reach)
        probes = linearise_all(evaluate, probe_places(optimum.at, self.sizes, scale, bounds), executor)
        self.shared = SharedCurvature(optimum, probes, scale, factor)
        """What is known of the curvature."""

    def ends(self, which: Sequence[EndKey], report: Callable[[int], None] = lambda done: None) -> dict[EndKey, End]:
        """The ends that `which` names; `report` is called with the number of ends found so far."""
        searches: dict[EndKey, PointRequests] = {}
        for index, side in which:
            threshold = float(self.thresholds[index])
            aim = Aim(index, side, self.optimum.chi2 + threshold, self.low, self.high, self.sizes)
            bound = float(np.asarray(self.bounds[side > 0])[index])
            search = EndSearch(self.optimum, aim, bound, self.reach, threshold, self.shared)
            searches[index, side] = search.run()
        found: dict[EndKey, End] = {}
        requested = {name: next(search) for name, search in searches.items()}
        while requested:
            points = linearise_all(self.evaluate, list(requested.values()), self.executor)
            self.shared.learn(points)
            due, requested = list(requested), {}
            for name, point in zip(due, points, strict=True):
                try:
                    requested[name] = searches[name].send(point)
                except StopIteration as stop:
                    found[name] = stop.value
            report(len(found))
        return {name: found[name] for name in which}
