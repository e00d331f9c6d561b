"""Repeat a fit with another integrator, from where the first one ended."""

import dataclasses

import numpy as np
from jaxtyping import Float

from ..core import Given, InputError
from ..integration import SOLVERS, Accuracy, accuracy_with, solver_name
from ..study import VISIBLE, Estimate, IntegratorCheck
from .least_squares import Fit, Method, Progress, fit_phase
from .problem import Problem
from .solver.lm_state import Ending
from .stack_first.held_stack import sequential
from .summary import how_it_ended


def check_accuracy(check_with: Given, accuracy: Accuracy) -> Accuracy | None:
    """The integrator of the second fit; None where `check_with` is None.

    **Raises:** `InputError` for what is no solver, and for the one by which the fit itself integrates.
    """
    if check_with is None:
        return None
    try:
        other = accuracy_with(check_with)
    except InputError as error:
        raise InputError(f"check_with: {error}") from None
    used = solver_name(accuracy.method)
    if solver_name(other.method) == used:
        rest = ", ".join(name for name in SOLVERS if name != used)
        raise InputError(f'check_with: found "{used}", by which the fit itself integrates; expected one of {rest}.')
    return other


def with_check(estimate: Estimate, fit: Fit, second: Problem, method: Method, report: Progress) -> Estimate:
    """`estimate` with what a second fit, from where the first `fit` ended, differs by; large differences get a note.

    **Arguments:** the `second` problem is the first one by another integrator, with the noise found by the first fit.
    """
    name = solver_name(second.residual.accuracy.method)
    if not fit.success:
        note = f"No check by {name}: the fit did not converge."
        return dataclasses.replace(estimate, notes=(*estimate.notes, note))
    report(f"fitting again by {name}")
    tell: Progress = lambda line: report(f"check: {line}")
    if method == "sequential":
        again = sequential(second, second.decode(fit.free), tell)
    else:  # without the first phase of a joint fit, which would lead away from there
        everything = np.ones(len(second.records), bool), np.ones(fit.free.size, bool)
        again = fit_phase(second, fit.free, *everything, "all", tell)
    names = second.residual.transform
    ends = [names.in_si(names.own(_end(run))) for run in (fit, again)]
    errors = np.array([estimate.parameters[path].standard_error for path in names.paths])
    away = np.where(errors > 0.0, ends[1] - ends[0], np.nan) / np.where(errors > 0.0, errors, 1.0)
    away = away if np.isfinite(again.chi2) else np.full_like(away, np.nan)
    values = {path: float(value) for path, value in second.decode(again.free).items()}
    check = IntegratorCheck(
        name,
        {path: float(number) for path, number in zip(names.paths, away, strict=True)},
        again.success,
        how_it_ended(second, again, values),
    )
    notes = []
    if check.largest is None or not check.converged:
        notes = [f"The check says little, {check.sentence}."]
    elif abs(check.largest[1]) > VISIBLE:
        notes = [
            f"Another integrator finds other numbers, {check.sentence}. One of the two is too coarse for these records."
        ]
    return dataclasses.replace(estimate, check=check, notes=(*estimate.notes, *notes))


def _end(fit: Fit) -> Float[np.ndarray, " p"]:
    """The end of a fit, with the step that was too small to be taken.

    A fit ends where that step is below a hundredth of a standard error; integrators agree to better than that.
    """
    if fit.ending != Ending.CONVERGED:
        return fit.free
    return fit.free + np.asarray(fit.state.proposed_step)
