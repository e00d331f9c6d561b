"""Repeat a fit with another integrator, from where the first one ended."""

import dataclasses

import numpy as np
from jaxtyping import Float

from ..core import Given, InputError
from ..integration import SOLVERS, Accuracy, accuracy_with, solver_name
from ..study import VISIBLE, Estimate, IntegratorCheck
from .least_squares import Fit, Method, Progress, fit_all
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
    """`estimate` with the differences of a second fit from the first one's end; a note tells of large differences.

    **Arguments:** the `second` problem is the first one by another integrator, with the noise found by the first `fit`.
    """
    name = solver_name(second.residual.accuracy.method)
    if not fit.success:
        note = f"No check by {name}: the fit did not converge."
        return dataclasses.replace(estimate, notes=(*estimate.notes, note))
    report(f"fitting again by {name}")
    tell: Progress = lambda line: report(f"check: {line}")
    if method == "sequential":
        again = sequential(second, second.decode(fit.free), tell)
    else:  # without the first phase of a joint fit, which would lead away from the first fit's end
        again = fit_all(second, fit.free, tell)
    transform = second.residual.transform
    first_end, second_end = (transform.in_si(transform.own(_end(run))) for run in (fit, again))
    errors = np.array([estimate.parameters[path].standard_error for path in transform.paths])
    shifts = np.where(errors > 0.0, second_end - first_end, np.nan) / np.where(errors > 0.0, errors, 1.0)
    shifts = shifts if np.isfinite(again.chi2) else np.full_like(shifts, np.nan)
    values = {path: float(value) for path, value in second.decode(again.free).items()}
    by_path = dict(zip(transform.paths, map(float, shifts), strict=True))
    check = IntegratorCheck(name, by_path, again.success, how_it_ended(second, again, values))
    notes = list(estimate.notes)
    if check.largest is None or not check.converged:
        notes.append(f"The check says little, {check.sentence}.")
    elif abs(check.largest[1]) > VISIBLE:
        cause = "One of the two is too coarse for these records."
        notes.append(f"Another integrator finds other numbers, {check.sentence}. {cause}")
    return dataclasses.replace(estimate, check=check, notes=tuple(notes))


def _end(fit: Fit) -> Float[np.ndarray, " p"]:
    """The end of a fit plus its last proposed step, which was too small to be taken.

    A fit ends where that step is below a hundredth of a standard error; integrators agree to better than that.
    """
    if fit.ending != Ending.CONVERGED:
        return fit.free
    return fit.free + np.asarray(fit.state.proposed_step)
