"""The fit that begins where the sliders stand."""

from typing import NamedTuple

from ..inference import FitInterrupted, identify
from ..study import Estimate, Study
from .background_job import Report
from .settings import Settings, to_be_fitted


class FitResult(NamedTuple):
    """How a fit ended."""

    estimate: Estimate | None
    """None where it was cancelled before it had a point."""
    words: str
    """In a line."""


def fit_from_here(study: Study, settings: Settings, report: Report) -> FitResult:
    """The joint estimate of `study` from the numbers of `settings` as starts.

    **Raises:** `InputError` where there is nothing to fit.
    """
    try:
        estimate = identify(to_be_fitted(study, settings), progress=report)
    except FitInterrupted as interrupt:
        return FitResult(interrupt.estimate, _cancelled(interrupt.estimate))
    except KeyboardInterrupt:
        return FitResult(None, _cancelled(None))
    return FitResult(estimate, f"The fit {estimate.verdict} in {estimate.seconds:.3g} s: {estimate.message}.")


def _cancelled(estimate: Estimate | None) -> str:
    if estimate is None:
        return "The fit was cancelled before it had found anything."
    return "The fit was cancelled; the sliders show the best point so far, not an optimum."
