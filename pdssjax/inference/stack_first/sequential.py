"""The fit in two steps, stack first: the piezo from the records of the platform alone, then the rest with it held."""

import numpy as np
from jaxtyping import Float

from ...study import Values
from ..least_squares import MAX_ITERATIONS, Fit, Progress, evaluated, fit_phase, summed
from ..problem import Problem
from ..stack_parameters import of_platform_alone, of_stack


def sequential(problem: Problem, starts: Values, report: Progress, limit: int = MAX_ITERATIONS) -> Fit:
    """The piezo from the platform records; then, with the piezo held, the others from the rest."""
    platform = of_platform_alone(problem.records)
    free = problem.residual.transform.encode(starts)
    piezo = of_stack(problem)
    first = fit_phase(problem, free, platform, piezo, "piezo", report, limit)
    last = with_piezo_held(problem, first.free, report, limit)
    if not first.success:
        last = last._replace(success=False, message=f"piezo: {first.message}", ending=first.ending)
    return summed(last, [first])


def with_piezo_held(
    problem: Problem, free: Float[np.ndarray, " p"], report: Progress, limit: int = MAX_ITERATIONS
) -> Fit:
    """The other parameters from the records that do not show the platform alone, from the point `free`."""
    platform = of_platform_alone(problem.records)
    piezo = of_stack(problem)
    second = fit_phase(problem, free, ~platform, ~piezo, "friction", report, limit)
    # Both steps' residuals, for the statistics and the errors.
    whole = evaluated(problem, second.free, report)
    state = whole.state._replace(iterations=second.state.iterations, evaluations=second.state.evaluations)
    ended = {"success": second.success, "message": second.message, "ending": second.ending}
    return summed(whole._replace(state=state, **ended), [second])
