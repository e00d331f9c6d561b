"""Replaces an estimate's linear intervals by those of the likelihood, with a verdict for each end."""

import dataclasses

import numpy as np

from ..study import Estimate, FittedParameter
from .least_squares import Fit, Progress
from .problem import Problem
from .profile_likelihood import End, Verdict, interval_end
from .summary import NORMAL_95, variance_factor


def with_profile_intervals(estimate: Estimate, problem: Problem, fit: Fit, report: Progress) -> Estimate:
    """`estimate` with 95 % intervals that end where chi-square, minimised over all else, exceeds its threshold.

    The threshold grows with a reduced chi-square above one, as the standard errors do.  Parameters at a bound and
    those about which the data say nothing keep what they have.  A note names every end that is no ordinary one.
    """
    threshold = NORMAL_95**2 * variance_factor(estimate.statistics)
    paths = problem.residual.transform.paths
    parameters, notes = dict(estimate.parameters), list(estimate.notes)
    for index, path in enumerate(paths):
        parameter = estimate.parameters[path]
        if parameter.at_bound or not parameter.identifiable:
            continue
        ends = []
        for side in (-1.0, 1.0):
            report(f"interval of {path} ({index + 1} of {len(paths)}), {'lower' if side < 0 else 'upper'} end")
            ends.append(interval_end(problem.linearised, fit.free, index, side, threshold, problem.bounds))
        parameters[path] = _with_ends(parameter, problem, index, ends)
        notes += _notes(parameter, problem, ends)
    return dataclasses.replace(estimate, parameters=parameters, notes=tuple(notes))


def _with_ends(parameter: FittedParameter, problem: Problem, index: int, ends: list[End]) -> FittedParameter:
    low, high = (_value(problem, index, end) for end in ends)
    return dataclasses.replace(parameter, interval=(low, high), verdicts=(str(ends[0].verdict), str(ends[1].verdict)))


def _value(problem: Problem, index: int, end: End) -> float:
    """The end in the parameter's own unit: infinite or zero where a logarithm is flat, NaN where not followed."""
    if np.isnan(end.value):
        return float("nan")
    path = problem.residual.transform.paths[index]
    if not np.isfinite(end.value):
        positive = bool(problem.residual.transform.logarithmic[index])
        return 0.0 if positive and end.value < 0 else float(end.value)
    return float(problem.decode(end.point)[path])


def _notes(parameter: FittedParameter, problem: Problem, ends: list[End]) -> list[str]:
    notes = []
    for name, end in zip(("lower", "upper"), ends, strict=True):
        what = f"The {name} end of the interval of {parameter.path}"
        if end.verdict == Verdict.FLAT:
            notes.append(
                f"{what} is open: the records do not tell how {'small' if name == 'lower' else 'large'} it is."
            )
        elif end.verdict == Verdict.AT_BOUND:
            notes.append(f"{what} is its bound: the records allow values beyond it.")
        elif end.verdict == Verdict.LOWER:
            values = problem.decode(end.point)
            notes.append(
                f"On the way to the {name} end of {parameter.path} a better optimum was found (chi-square "
                f"{end.chi2:.6g}): start the fit from {parameter.path} = {float(values[parameter.path]):.6g} in SI."
            )
        elif end.verdict == Verdict.LOST:
            notes.append(f"{what} was not found: chi-square has a discontinuity on the way, or bends too much.")
    return notes
