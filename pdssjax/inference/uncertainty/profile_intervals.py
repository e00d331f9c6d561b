"""Likelihood intervals of an estimate, with a curve of chi-square and a verdict for each parameter.

Between the optimum and an end the valley of chi-square is interpolated by a cubic in the profiled parameter, by values
and tangents of the others; the curvature of the residuals brings a point nearer to the valley's floor.  The point
halfway is evaluated, and the linear model there gives the minimum over the others.  Where this misses the cubic, both
halves are halved again.  So the curve has values and slopes at a few points, and cubics between them.
"""

import dataclasses
import itertools
from concurrent.futures import Executor
from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

from ...study import Estimate, FittedParameter, Profile
from ..covariance import scaled_least_squares
from ..draws import each_done
from ..evidence import Evidence
from ..least_squares import Fit, Progress
from ..notes.about_records import about_better_optimum
from ..problem import Problem
from .linear_intervals import half_width_95
from .profile_likelihood import SIDES, End, ProfileLikelihood, Verdict, linearise
from .second_order import NULL, Aim, Linearisation, SecondOrder, linearisation_at, lowest

_HALVINGS = 2
"""Halvings of each side at most: 3 points between the optimum and the end."""

_BENT = 0.02
"""Error of the cubic at its middle point from which each half is halved again, as a share of the threshold."""

_POINTS_A_SIDE = 12
"""Points shown of each side besides the optimum."""

_OFF = 0.02
"""Decrease of chi-square by the other parameters from which they are moved, as a share of the threshold."""


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


def profile_curve(likelihood: ProfileLikelihood, index: int, ends: tuple[End, End]) -> Curve:
    """Both sides of the profile of the parameter `index`, between its `ends`: lower and upper."""
    low, high = (_Valley(likelihood, index).side(end.point) for end in ends)
    return Curve(
        np.concatenate([low.value[::-1], high.value[1:]]),
        np.concatenate([low.excess[::-1], high.excess[1:]]),
        np.concatenate([low.computed[::-1], high.computed[1:]]),
        float(np.fmax(low.missed, high.missed)),
        max(low.falls, high.falls),
        low.evaluations + high.evaluations,
    )


class _Valley:
    """The valley between the optimum and one end."""

    def __init__(self, likelihood: ProfileLikelihood, index: int):
        self.likelihood, self.optimum, self.index = likelihood, likelihood.optimum, index
        self.low, self.high, self.threshold = likelihood.low, likelihood.high, float(likelihood.thresholds[index])
        self.aim = Aim(index, 1.0, self.optimum.chi2, self.low, self.high, likelihood.sizes)
        self.evaluations, self.missed = 0, float("nan")

    def side(self, end: Linearisation) -> Curve:
        """Follow the valley from the optimum to the `end`."""
        first, last = self._node(self.optimum), self._node(end)
        if not (np.isfinite(last.excess) and end.at[self.index] != self.optimum.at[self.index]):
            nothing = np.zeros(1)
            return Curve(self.optimum.at[[self.index]], nothing, nothing == 0.0, float("nan"), 0.0, 0)
        nodes = [first, *self._between(first, last, _HALVINGS), last]
        heights = np.array([node.excess for node in nodes])
        shown = _POINTS_A_SIDE // (len(nodes) - 1)
        values, excess = [first.point.at[self.index]], [0.0]
        for begin, stop in itertools.pairwise(nodes):
            on_way = np.linspace(begin.point.at[self.index], stop.point.at[self.index], shown + 1)[1:]
            values += list(on_way)
            excess += [self._cubic(begin, stop, value) for value in on_way]
        falls = float(np.max(np.maximum.accumulate(heights) - heights)) / self.threshold
        computed = np.arange(len(values)) % shown == 0
        return Curve(np.array(values), np.array(excess), computed, self.missed, falls, self.evaluations)

    def _between(self, one_end: _Node, other_end: _Node, halvings: int) -> list[_Node]:
        """Nodes between two others, in their order."""
        if not halvings:
            return []
        at = 0.5 * (one_end.point.at[self.index] + other_end.point.at[self.index])
        node = self._corrected(self._linearised(self._interpolated(one_end, other_end, at)))
        if not np.isfinite(node.excess):
            return []
        missed = abs(node.excess - self._cubic(one_end, other_end, at)) / self.threshold
        if halvings < _HALVINGS or missed < _BENT:
            # Of a cubic between points half as far apart: a sixteenth of what was missed before it was halved.
            self.missed = float(np.fmax(self.missed, missed if halvings < _HALVINGS else missed / 16.0))
        if missed < _BENT:
            return [node]
        return [*self._between(one_end, node, halvings - 1), node, *self._between(node, other_end, halvings - 1)]

    def _corrected(self, point: Linearisation) -> _Node:
        """The node at a `point`, after steps of the others that bring it into the valley where it is off."""
        node, share = self._node(point), 1.0
        for _ in range(8):
            if not point.chi2 - self.optimum.chi2 - node.excess > _OFF * self.threshold:
                break
            nearer = self._linearised(point.at + share * self._best(point))
            share = 1.0 if nearer.chi2 < point.chi2 else 0.25 * share
            if nearer.chi2 < point.chi2:
                point, node = nearer, self._node(nearer)
        return node

    def _interpolated(self, one_end: _Node, other_end: _Node, at: float) -> Float[np.ndarray, " p"]:
        """All parameters where the profiled one is `at`."""
        near, far = one_end.point.at, other_end.point.at
        guess = _hermite(near[self.index], far[self.index], near, far, one_end.tangent, other_end.tangent, at)
        guess[self.index] = at
        guess = np.clip(guess, self.low, self.high)
        nearer = min((one_end.point, other_end.point), key=lambda point: abs(point.at[self.index] - at))
        curvature = self.likelihood.shared.at(0.5 * (guess + nearer.at))
        if curvature is None:
            return guess
        return nearer.at + lowest(SecondOrder(nearer, curvature), nearer.at, guess - nearer.at, self.aim)

    def _cubic(self, one_end: _Node, other_end: _Node, at: float) -> float:
        low, high = one_end.point.at[self.index], other_end.point.at[self.index]
        first, last = np.array(one_end.excess), np.array(other_end.excess)
        return float(_hermite(low, high, first, last, np.array(one_end.slope), np.array(other_end.slope), at))

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
        return (point.at > self.low) & (point.at < self.high) & (np.arange(point.at.size) != self.index)

    def _linearised(self, at: Float[np.ndarray, " p"]) -> Linearisation:
        self.evaluations += 1
        return linearise(self.likelihood.evaluate, at)


def _hermite(
    low: float,
    high: float,
    first: Float[np.ndarray, "*shape"],
    last: Float[np.ndarray, "*shape"],
    slope_first: Float[np.ndarray, "*shape"],
    slope_last: Float[np.ndarray, "*shape"],
    at: float,
) -> Float[np.ndarray, "*shape"]:
    """Values at `at` of the monotone cubic with given values and slopes at `low` and `high`.

    Slopes are limited so that it stays between the values (F. N. Fritsch and R. E. Carlson, SIAM J. Num. Anal. 17(2),
    1980).
    """
    width, rise = high - low, last - first
    t, steepest = (at - low) / width, 3.0 * np.abs(rise)
    start, end = (
        np.where(gain * rise > 0.0, np.clip(gain, -steepest, steepest), 0.0)
        for gain in (width * slope_first, width * slope_last)
    )
    return first + t * (start + t * (3.0 * rise - 2.0 * start - end + t * (start + end - 2.0 * rise)))


FALLS = 0.05
"""Share of the threshold by which chi-square may fall on the way outwards before that counts as another minimum."""


def verdict_of(ends: tuple[End, ...], curve: Curve) -> str:
    """The verdict on a parameter, from both ends and the curve between them."""
    found = [end.verdict for end in ends]
    names = ("lower", "upper")
    if Verdict.LOWER in found:
        return "several minima: a lower one was found"
    if curve.falls > FALLS:
        return "several minima: chi-square falls on the way to an end"
    for verdict in (Verdict.LOST, Verdict.AT_BOUND, Verdict.FLAT):
        where = [name for name, other in zip(names, found, strict=True) if other == verdict]
        if where and verdict == Verdict.FLAT:
            return "flat" if len(where) == 2 else f"one-sided: only {'an upper' if 'lower' in where else 'a lower'} end"
        if where:
            return f"{verdict}: {' and '.join(where)} end"
    return str(Verdict.BOUNDED)


def notes_of(parameter: FittedParameter, problem: Problem, ends: tuple[End, ...], at: float) -> list[str]:
    """Notes on ends that are no ordinary ones; the estimate lies `at` that number on the scale of the fit."""
    # Another note tells of an optimum at its bound.
    notes = []
    for name, end in zip(("lower", "upper"), ends, strict=True):
        what = f"The {name} end of the interval of {parameter.path}"
        if end.verdict == Verdict.FLAT:
            notes.append(
                f"{what} is open: the records do not tell how {'small' if name == 'lower' else 'large'} it is."
            )
        elif end.verdict == Verdict.AT_BOUND and end.value != at:
            notes.append(f"{what} is its bound: the records allow values beyond it.")
        elif end.verdict == Verdict.LOWER:
            when = f"On the way to the {name} end of {parameter.path}"
            number = float(problem.decode(end.point.at)[parameter.path])
            notes.append(about_better_optimum(when, end.point.chi2, parameter.path, number))
        elif end.verdict == Verdict.LOST:
            notes.append(
                f"{what} was not found: chi-square has a discontinuity on the way, bends too much, or cannot be "
                "simulated there."
            )
    return notes


def with_profile_intervals(
    estimate: Estimate, evidence: Evidence, executor: Executor | None, report: Progress
) -> Estimate:
    """`estimate` with 95 % intervals that end where chi-square, minimised over all else, exceeds its threshold.

    Where residuals exceed the noise given, the threshold of each parameter grows as its variance does; where noise was
    estimated, it is the 95 % quantile of t^2.  A bound that a parameter lies at is one end of its interval.  Parameters
    about which the data say nothing keep their interval.  A note names every end that is no ordinary one.  `profiles`
    holds the curve between the ends of each.
    """
    thresholds, transform = _thresholds(estimate, evidence), evidence.problem.residual.transform
    kept = [path for path in transform.paths if estimate.parameters[path].identifiable]
    tied = [path for path in kept if transform.along(path) is not transform]
    rest = thresholds, evidence.variance_factor, executor, report
    estimate = _with_profiles(estimate, evidence.problem, evidence.fit, [p for p in kept if p not in tied], *rest)
    for path in tied:  # each in coordinates of the fit that contain the parameter itself
        estimate = _with_profiles(estimate, *_in_coordinates_of(path, evidence.problem, evidence.fit), [path], *rest)
    order = [profile for path in kept for profile in estimate.profiles if profile.path == path]
    return dataclasses.replace(estimate, profiles=tuple(order))


def _in_coordinates_of(path: str, problem: Problem, fit: Fit) -> tuple[Problem, Fit]:
    """A problem and its fit in numbers of which one is the parameter `path` on its own scale."""
    before = problem.residual.transform
    after = before.along(path)
    free = np.clip(after.from_own(before.own(fit.free)), after.low, after.high)
    change = before.from_own(after.own(np.eye(free.size))) - before.from_own(after.own(np.zeros_like(free)))
    state = fit.state._replace(jacobian=np.asarray(fit.state.jacobian) @ change.T)
    residual = eqx.tree_at(lambda residual: residual.transform, problem.residual, after)
    return problem._replace(residual=residual), fit._replace(free=free, state=state)


def _with_profiles(
    estimate: Estimate,
    problem: Problem,
    fit: Fit,
    kept: list[str],
    thresholds: Float[np.ndarray, " p"],
    factor: float,
    executor: Executor | None,
    report: Progress,
) -> Estimate:
    transform, optimum, (low, high) = problem.residual.transform, linearisation_at(fit), problem.bounds
    places = {path: transform.paths.index(path) for path in kept}
    report("curvature at the optimum")
    likelihood = ProfileLikelihood(problem.linearised, optimum, thresholds, problem.bounds, factor, executor)
    at_bound = {-1.0: optimum.at <= low, 1.0: optimum.at >= high}
    which = [(index, side) for index in places.values() for side in SIDES if not at_bound[side][index]]
    found = likelihood.ends(which, lambda done: report(f"intervals: {done} of {len(which)} ends"))

    def end_of(path: str, side: float) -> End:
        """The end found, or the bound that the parameter lies at."""
        index, bound = places[path], estimate.parameters[path].bounds[side > 0]
        end = found.get((index, side), End(float(optimum.at[index]), Verdict.AT_BOUND, optimum, 0))
        # An end at the limit of a fit's reach, which is no bound of the parameter, is open.  A fit leaves out a
        # millionth of a legal range at its upper end.
        if end.verdict == Verdict.AT_BOUND and not np.isclose(
            _in_si(problem, end.point.at, index, end.value), bound, rtol=1e-5, atol=0.0
        ):
            return end._replace(value=side * np.inf, verdict=Verdict.FLAT)
        return end

    pairs = {path: (end_of(path, SIDES[0]), end_of(path, SIDES[1])) for path in kept}
    curves: dict[str, Curve] = {}
    for path, curve in each_done(lambda path: profile_curve(likelihood, places[path], pairs[path]), kept, executor):
        curves[path] = curve
        report(f"profiles: {len(curves)} of {len(kept)} parameters")
    parameters, notes, profiles = dict(estimate.parameters), list(estimate.notes), list(estimate.profiles)
    for path, index in places.items():
        parameter, ends, curve = estimate.parameters[path], pairs[path], curves[path]
        threshold = float(likelihood.thresholds[index])
        # Open ends are infinite, but that of a logarithm is 0 below; NaN stays NaN.
        unbounded = {-np.inf: 0.0 if transform.logarithmic[index] else -np.inf, np.inf: np.inf}
        low_end, high_end = (
            _in_si(problem, end.point.at, index, end.value)
            if np.isfinite(end.value)
            else unbounded.get(end.value, float("nan"))
            for end in ends
        )
        verdicts = str(ends[0].verdict), str(ends[1].verdict)
        parameters[path] = dataclasses.replace(parameter, interval=(low_end, high_end), verdicts=verdicts)
        profiles.append(
            Profile(
                path=path,
                value=np.array([_in_si(problem, optimum.at, index, value) for value in curve.value]),
                excess=curve.excess,
                linear=threshold * ((curve.value - optimum.at[index]) / likelihood.sizes[index]) ** 2,
                computed=curve.computed,
                threshold=threshold,
                verdict=verdict_of(ends, curve),
                quality=curve.quality,
                evaluations=curve.evaluations + sum(end.evaluations for end in ends),
            )
        )
        notes += notes_of(parameter, problem, ends, float(optimum.at[index]))
    return dataclasses.replace(estimate, parameters=parameters, notes=tuple(notes), profiles=tuple(profiles))


def _thresholds(estimate: Estimate, evidence: Evidence) -> Float[np.ndarray, " p"]:
    """Excess of chi-square over its minimum at the ends of the interval of each parameter.

    The excess is distributed as r times chi-square of one degree of freedom, r the ratio of the parameter's variance to
    that by the noise given (J. T. Kent, Biometrika 69(1), 1982); where the noise was estimated, as r t^2.  At a
    bound, where there is no variance, it is the factor of the noise given, and the fewest degrees of freedom of the
    others.
    """
    free, at = evidence.problem.residual.transform, evidence.fit.free
    given = free.own_covariance(evidence.given_covariance.matrix)
    freedom = np.array([estimate.parameters[path].degrees_of_freedom for path in free.paths])
    freedom = np.where(free.at_bound(at), np.min(freedom), freedom)
    ratio = np.diag(estimate.covariance) / (np.diag(given) * free.slope(at) ** 2)
    return half_width_95(freedom) ** 2 * np.nan_to_num(ratio, nan=evidence.variance_factor)


def _in_si(problem: Problem, at: Float[np.ndarray, " p"], index: int, value: float) -> float:
    moved = np.where(np.arange(at.size) == index, value, at)
    return float(problem.decode(moved)[problem.residual.transform.paths[index]])
