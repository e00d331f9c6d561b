"""Identifies the parameters of a study: jointly, or the piezo first as the thesis did."""

import dataclasses
import time
from typing import Literal, TypeAlias

import numpy as np

from ..core import InputError, member, members, nearest, need_double_precision
from ..integration import Accuracy
from ..study import Estimate, Study
from .best_point import BestPoint, Point, completed
from .held_stack import rejoined, with_stack_held
from .least_squares import Method, Progress, joint, sequential
from .losses.base import AbstractLoss
from .multistart import best_fit
from .parameter_errors import with_error_models
from .peak_picking import PickedStack, pick_peaks
from .profile_intervals import with_profile_intervals
from .sensor_signs import question_signs
from .summary import summarise

Intervals: TypeAlias = Literal["linear", "profile"]
"""By the covariance, or by profile likelihood."""


class FitInterrupted(KeyboardInterrupt):
    """A fit was broken off: by Ctrl-C, or by whatever else raises `KeyboardInterrupt` in the main thread."""

    estimate: Estimate | None
    """At the best point so far, not converged unless the fit was done; None where there is none yet."""

    def __init__(self, estimate: Estimate | None):
        super().__init__("the fit was interrupted")
        self.estimate = estimate


def identify(
    study: Study,
    method: Method = "joint",
    *,
    intervals: Intervals = "linear",
    loss: str = "squares",
    progress: Progress | None = None,
    accuracy: Accuracy | None = None,
) -> Estimate:
    """The free parameters of a study from its records with role "fit", with uncertainties.

    **Arguments:** `method` is "joint", all parameters from all records at once, or
    "sequential": the piezo from the platform records, then the others with the piezo held,
    the first step's errors carried on into the second; or "peaks", the thesis's way: the same with the
    piezo from the peaks of step responses (`peak_picking`).  `intervals` are
    "linear", symmetric on the scale of the fit, or of a joint fit those by "profile" likelihood, which hold where
    chi-square is no parabola and take some ten evaluations with derivatives an end.  `loss` is "squares",
    or of a joint fit "huber" or "cauchy", under which glitches pull little; its errors are those of a
    sandwich covariance.  `progress` is called with a
    line of text now and then.

    **Raises:** `InputError` if there is nothing to fit, or for "peaks" no record to pick them
    from.  A fit that does not converge is returned all the same, with `converged` False and the
    reason in `message`.  `FitInterrupted`,
    a `KeyboardInterrupt` whose `estimate` is that at the best point so far, if it is broken off.
    Warns with `InputWarning` where a record moves against its drive.
    """
    need_double_precision()
    begun = time.perf_counter()
    report = progress or (lambda message: None)
    _check(study, method)
    if intervals not in ("linear", "profile") or (intervals == "profile" and method != "joint"):
        raise InputError(
            f'intervals: found "{intervals}" with method "{method}", expected "linear", or "profile" with "joint".'
        )
    cost = _loss(loss, method, intervals)
    question_signs([record for record in study.records if record.role == "fit"])
    stack = pick_peaks(study) if method == "peaks" else None
    asked = with_stack_held(study, stack.values) if stack else study
    run = sequential if method == "sequential" else joint
    best, done = BestPoint(), None
    try:
        report("finding starts")
        fit, problem, starts = best_fit(asked, accuracy or Accuracy(), best.watched(run), report, cost)
        done = Point(fit, problem, starts, 2)
        estimate = _summarised(study, method, done, begun, report, stack)
        if intervals == "profile" and np.isfinite(fit.chi2):
            estimate = with_profile_intervals(estimate, problem, fit, report)
            estimate = dataclasses.replace(estimate, seconds=time.perf_counter() - begun)
    except KeyboardInterrupt as interrupt:
        point = done or best.point
        kept = _summarised(study, method, point, begun, report, stack) if point else None
        raise FitInterrupted(kept) from interrupt
    return estimate


def _loss(name: str, method: str, intervals: str) -> AbstractLoss:
    known = members("inference.losses")
    if name not in known:
        raise InputError(f'loss: found "{name}"; {nearest(name, known)}')
    loss = member("inference.losses", name)()
    if loss.is_robust and (method != "joint" or intervals != "linear"):
        raise InputError(
            f'loss: found "{name}" with method "{method}" and intervals "{intervals}", expected "joint" and "linear".'
        )
    return loss


def _summarised(
    study: Study, method: Method, point: Point, begun: float, report: Progress, stack: PickedStack | None
) -> Estimate:
    report("predicting every record")
    point = point._replace(fit=completed(point, report), covers=2)
    if stack is not None:
        point = rejoined(study, point, point.problem.residual.accuracy, report)
    estimate = summarise(study, method, point.problem, point.fit, point.starts, stack)
    if stack is None and not point.problem.residual.loss.is_robust:
        estimate = with_error_models(estimate, point.problem, point.fit, report)
    return dataclasses.replace(estimate, seconds=time.perf_counter() - begun)


def _check(study: Study, method: str) -> None:
    where = study.path or study.title
    if method not in ("joint", "sequential", "peaks"):
        raise InputError(f'method: found "{method}", expected "joint", "sequential" or "peaks".')
    fitted = [record for record in study.records if record.role == "fit"]
    if not fitted:
        raise InputError(f'{where}: found no record with role "fit", expected at least one.')
    free = [path for path, parameter in study.parameters.items() if parameter.free]
    if not free:
        raise InputError(f"{where}: parameters: found none that is free, expected at least one to fit.")
    steps = {(record.measurement.platform_alone, record.measurement.effector_free) for record in fitted}
    if method != "joint" and steps != {(True, False), (False, True)}:
        raise InputError(
            f"{where}: found fitted records of the {' and the '.join(sorted({r.measures for r in fitted}))} only; "
            f"the {method} method expects some of the platform, for the piezo, and some of the end-effector."
        )
