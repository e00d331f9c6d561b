"""How much an error of parameters that were fitted first moves those fitted after them.

The thesis identifies the stack first and then takes it for exact (6.2 asks what its errors do to the friction).
"""

import numpy as np
from jaxtyping import Bool

from ...study import Amplification
from ..covariance import moved_by
from ..least_squares import Fit
from ..problem import Problem
from ..stack_parameters import of_stack, stack_rows


def amplification_of(problem: Problem, fit: Fit, identifiable: Bool[np.ndarray, " p"]) -> Amplification | None:
    """What an error of the stack does to everything else in the records that do not show the platform alone.

    **Arguments:** which of the free parameters are `identifiable`, shape (parameters,); the others are left out.

    **Returns:** relative changes; None where there is no stack to fit, nothing else, or no such record.
    """
    transform = problem.residual.transform
    found = problem.decode(fit.free)
    values = np.array([float(found[path]) for path in transform.paths])
    known = identifiable & (values != 0.0)
    stack, used = of_stack(problem), ~stack_rows(problem)
    earlier, later = np.flatnonzero(stack & known), np.flatnonzero(~stack & known)
    if not (earlier.size and later.size and used.any()):
        return None
    jacobian = np.asarray(fit.state.jacobian)[used]
    relative = transform.slope(fit.free) / np.where(values == 0.0, np.inf, values)
    matrix = moved_by(jacobian[:, later], jacobian[:, earlier])
    paths = np.array(transform.paths)
    return Amplification(
        tuple(map(str, paths[later])),
        tuple(map(str, paths[earlier])),
        relative[later, None] * matrix / relative[earlier],
    )
