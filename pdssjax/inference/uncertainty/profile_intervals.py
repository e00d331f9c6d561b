"""Likelihood intervals of an estimate, with a curve and a verdict for each parameter."""

import dataclasses
from concurrent.futures import Executor

import equinox as eqx
import numpy as np
from jaxtyping import Float

from ...study import Estimate, FittedParameter, Profile
from ..covariance import least_squares_covariance
from ..draws import each_done
from ..evidence import Evidence
from ..least_squares import Fit, Progress
from ..notes.about_records import about_better_optimum
from ..problem import Problem
from .end_search import End, Verdict, standard_errors
from .linear_intervals import half_width_95
from .profile_curve import Curve, profile_curve
from .profile_likelihood import REACH, interval_ends, learn_curvature
from .second_order import Linearisation, linearisation_at

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
    # That an optimum lies at its bound is said already.
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


SIDES = -1.0, 1.0
"""The lower and the upper end of an interval."""


def with_profile_intervals(
    estimate: Estimate, problem: Problem, fit: Fit, executor: Executor | None, report: Progress
) -> Estimate:
    """`estimate` with 95 % intervals that end where chi-square, minimised over all else, exceeds its threshold.

    Where residuals exceed the noise given the threshold of each parameter grows as its variance does, and where noise
    was estimated it is that of Student's t squared.  A parameter at a bound has that for one end, and those about which
    the data say nothing keep their interval.  A note names every end that is no ordinary one.  `profiles` holds the
    curve between the ends of each.
    """
    factor = Evidence(problem, fit).variance_factor
    thresholds = _thresholds(estimate, problem, fit, factor)
    transform = problem.residual.transform
    kept = [path for path in transform.paths if estimate.parameters[path].identifiable]
    tied = [path for path in kept if transform.along(path) is not transform]
    estimate = _profiled(
        estimate, problem, fit, [p for p in kept if p not in tied], thresholds, factor, executor, report
    )
    for path in tied:  # each in numbers of the fit of which it is one
        estimate = _profiled(estimate, *_along(path, problem, fit), [path], thresholds, factor, executor, report)
    order = [profile for path in kept for profile in estimate.profiles if profile.path == path]
    return dataclasses.replace(estimate, profiles=tuple(order))


def _along(path: str, problem: Problem, fit: Fit) -> tuple[Problem, Fit]:
    """A problem and its fit in numbers of which one is the parameter `path` on its own scale."""
    before = problem.residual.transform
    after = before.along(path)
    free = np.clip(after.from_own(before.own(fit.free)), after.low, after.high)
    change = before.from_own(after.own(np.eye(free.size))) - before.from_own(after.own(np.zeros_like(free)))
    state = fit.state._replace(jacobian=np.asarray(fit.state.jacobian) @ change.T)
    residual = eqx.tree_at(lambda residual: residual.transform, problem.residual, after)
    return problem._replace(residual=residual), fit._replace(free=free, state=state)


def _profiled(
    estimate: Estimate,
    problem: Problem,
    fit: Fit,
    kept: list[str],
    thresholds: Float[np.ndarray, " p"],
    factor: float,
    executor: Executor | None,
    report: Progress,
) -> Estimate:
    """`estimate` with profiles and intervals of the parameters `kept`."""
    paths = problem.residual.transform.paths
    optimum = linearisation_at(fit)
    report("curvature at the optimum")
    shared = learn_curvature(problem.linearised, optimum, thresholds, problem.bounds, factor, executor=executor)
    both = [(paths.index(path), side) for path in kept for side in SIDES]
    which = [(index, side) for index, side in both if not _at_bound(problem, optimum, index, side)]
    tell = lambda done: report(f"intervals: {done} of {len(which)} ends")
    found = interval_ends(
        problem.linearised, optimum, which, thresholds, problem.bounds, shared, executor=executor, report=tell
    )
    ends_at = dict(zip(which, found, strict=True))
    pairs = {path: _pair(problem, optimum, estimate.parameters[path], ends_at) for path in kept}
    threshold_of = lambda path: float(thresholds[paths.index(path)])
    draw = lambda path: profile_curve(
        problem.linearised, optimum, paths.index(path), pairs[path], threshold_of(path), problem.bounds, shared
    )
    curves: dict[str, Curve] = {}
    for path, curve in each_done(draw, kept, executor):
        curves[path] = curve
        report(f"profiles: {len(curves)} of {len(kept)} parameters")
    parameters, notes, profiles = dict(estimate.parameters), list(estimate.notes), list(estimate.profiles)
    for path in kept:
        index, parameter, ends = paths.index(path), estimate.parameters[path], pairs[path]
        low, high = (_value(problem, index, end) for end in ends)
        verdicts = str(ends[0].verdict), str(ends[1].verdict)
        parameters[path] = dataclasses.replace(parameter, interval=(low, high), verdicts=verdicts)
        profiles.append(_profile(problem, optimum, index, curves[path], ends, threshold_of(path)))
        notes += notes_of(parameter, problem, ends, float(optimum.at[index]))
    return dataclasses.replace(estimate, parameters=parameters, notes=tuple(notes), profiles=tuple(profiles))


def _thresholds(estimate: Estimate, problem: Problem, fit: Fit, factor: float) -> Float[np.ndarray, " p"]:
    """Excess of chi-square over its minimum at the ends of the interval of each parameter.

    A profile of chi-square is the ratio of the parameter's variance to that by the noise given, times chi-square's
    distribution of one degree of freedom (J. T. Kent, Biometrika 69(1), 1982), or that of t^2 where the noise was
    estimated.  At a bound, where there is no variance, it is the `factor` of the noise given, and the fewest degrees of
    freedom of the others.
    """
    free = problem.residual.transform
    held = free.at_bound(fit.free)
    given = free.own_covariance(least_squares_covariance(np.asarray(fit.state.jacobian), held).matrix)
    freedom = np.array([estimate.parameters[path].degrees_of_freedom for path in free.paths])
    freedom = np.where(held, np.min(freedom), freedom)
    ratio = np.diag(estimate.covariance) / (np.diag(given) * free.slope(fit.free) ** 2)
    return half_width_95(freedom) ** 2 * np.nan_to_num(ratio, nan=factor)


def _at_bound(problem: Problem, optimum: Linearisation, index: int, side: float) -> bool:
    """The parameter lies at the end of its range on that `side`."""
    low, high = problem.bounds
    return bool(optimum.at[index] >= high[index] if side > 0 else optimum.at[index] <= low[index])


def _pair(
    problem: Problem, optimum: Linearisation, parameter: FittedParameter, found: dict[tuple[int, float], End]
) -> tuple[End, End]:
    """Both ends of a `parameter`: those `found`, or the bound that it lies at."""
    index = problem.residual.transform.paths.index(parameter.path)
    bound = End(float(optimum.at[index]), Verdict.AT_BOUND, optimum, 0)
    low, high = (_opened(found.get((index, side), bound), side, parameter, problem) for side in SIDES)
    return low, high


def _opened(end: End, side: float, parameter: FittedParameter, problem: Problem) -> End:
    """An `end` that is where the fit could reach, and no bound of the `parameter`, as what it is: open."""
    if end.verdict != Verdict.AT_BOUND:
        return end
    index = problem.residual.transform.paths.index(parameter.path)
    bound = parameter.bounds[1 if side > 0 else 0]
    # Of a legal range the fit leaves out a millionth at its upper end.
    if np.isclose(_in_si(problem, end.point.at, index, end.value), bound, rtol=1e-5, atol=0.0):
        return end
    return end._replace(value=side * np.inf, verdict=Verdict.FLAT)


def _profile(
    problem: Problem, optimum: Linearisation, index: int, curve: Curve, ends: tuple[End, ...], threshold: float
) -> Profile:
    path = problem.residual.transform.paths[index]
    half_width = standard_errors(optimum, threshold, REACH)[0][index]
    return Profile(
        path=path,
        value=np.array([_in_si(problem, optimum.at, index, value) for value in curve.value]),
        excess=curve.excess,
        linear=threshold * ((curve.value - optimum.at[index]) / half_width) ** 2,
        computed=curve.computed,
        threshold=threshold,
        verdict=verdict_of(ends, curve),
        quality=curve.quality,
        evaluations=curve.evaluations + sum(end.evaluations for end in ends),
    )


def _in_si(problem: Problem, at: Float[np.ndarray, " p"], index: int, value: float) -> float:
    """One number of the fit's scale in its own unit."""
    moved = np.where(np.arange(at.size) == index, value, at)
    return float(problem.decode(moved)[problem.residual.transform.paths[index]])


def _value(problem: Problem, index: int, end: End) -> float:
    """The end in the parameter's own unit: infinite or zero where a logarithm is flat, NaN where not followed."""
    if np.isnan(end.value):
        return float("nan")
    if not np.isfinite(end.value):
        positive = bool(problem.residual.transform.logarithmic[index])
        return 0.0 if positive and end.value < 0 else float(end.value)
    return _in_si(problem, end.point.at, index, end.value)
