"""A fit in two steps: how its estimate follows the samples, and how errors of the first step move the second.

Parameters a are fitted to the first step's samples, and held while b are fitted to the second's.  An error of a moves
b by -H_b^-1 J_b' J_a da to first order (K. M. Murphy and R. H. Topel, Journal of Business and Economic Statistics
3(4), 1985).  `TwoSteps` has that as the influence of the first step's samples on b, so that any error model may follow;
the curvature of residuals that do not average out enters as in `influence`.

The thesis identifies the stack first and takes it for exact; its section 6.2 asks what its errors do to the friction.
`amplification_of` answers it: the relative change of each b by a relative change of each a.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ...study import Amplification
from ..covariance import estimate_sensitivity
from ..least_squares import Fit
from ..problem import Problem
from ..stack_parameters import stack_parameters, stack_residuals
from .influence import principal_directions, pseudo_inverse, relative_curvature


class TwoSteps(NamedTuple):
    """The Jacobians of the steps of a fit, each zero in the rows that it does not use, and what is fitted in each."""

    first: Float[np.ndarray, "n p"]
    second: Float[np.ndarray, "n p"]
    earlier: Int[np.ndarray, " q"]
    """Places of the parameters fitted in the first step."""
    later: Int[np.ndarray, " r"]

    def with_first_exact(self) -> "TwoSteps":
        """The steps where the second takes the result of the first for exact."""
        second = self.second.copy()
        second[:, self.earlier] = 0.0
        return self._replace(second=second)

    def influence(
        self, curvatures: tuple[Float[np.ndarray, "p k"], Float[np.ndarray, "p k"]] | None = None
    ) -> Float[np.ndarray, "n p"]:
        """The effect of each sample on each parameter.

        **Arguments:** `curvatures` S of the first and of the second step's residuals, along the `directions`; None:
        none.
        """
        found = np.zeros(self.first.shape)
        base, along = pseudo_inverse(self.first[:, self.earlier])
        left, spread = pseudo_inverse(self.second[:, self.later])
        count, inverse = along.shape[1], spread.T
        late = None
        if curvatures is not None:
            early, late = curvatures
            # Of the first step's samples on its principal directions.
            base = base @ np.linalg.inv(relative_curvature(along, early[self.earlier, :count]))
            inverse = np.linalg.solve(relative_curvature(spread, late[self.later, count:]), spread.T)
        found[:, self.earlier] = base @ along.T
        shift = (self.second[:, self.earlier] @ along).T @ left
        if late is not None:
            shift = shift + late[self.later, :count].T @ spread
        found[:, self.later] = (left - base @ shift) @ inverse
        return found

    def directions(self) -> Float[np.ndarray, "p k"]:
        """The principal directions of the first step, then those of the second, each in what it fits."""
        parts = []
        for jacobian, places in ((self.first, self.earlier), (self.second, self.later)):
            spread = principal_directions(jacobian[:, places])
            whole = np.zeros((self.first.shape[1], spread.shape[1]))
            whole[places] = spread
            parts.append(whole)
        return np.hstack(parts)


def amplification_of(problem: Problem, fit: Fit, identifiable: Bool[np.ndarray, " p"]) -> Amplification | None:
    """Amplification of errors of the stack into all other parameters, in records not of the platform alone.

    **Arguments:** which of the free parameters are `identifiable`, shape (parameters,); the others are left out.

    **Returns:** relative changes; None where there is no stack to fit, nothing else, or no such record.
    """
    transform = problem.residual.transform
    found = problem.decode(fit.free)
    values = np.array([float(found[path]) for path in transform.paths])
    known = identifiable & (values != 0.0)
    stack, used = stack_parameters(problem), ~stack_residuals(problem)
    earlier, later = np.flatnonzero(stack & known), np.flatnonzero(~stack & known)
    if not (earlier.size and later.size and used.any()):
        return None
    jacobian = np.asarray(fit.state.jacobian)[used]
    relative = transform.slope(fit.free) / np.where(values == 0.0, np.inf, values)
    mixing = transform.own_effect(np.eye(values.size)).T
    sensitivity = estimate_sensitivity(jacobian[:, later], jacobian[:, earlier])
    matrix = mixing[np.ix_(later, later)] @ sensitivity @ np.linalg.inv(mixing[np.ix_(earlier, earlier)])
    paths = np.array(transform.paths)
    return Amplification(
        tuple(map(str, paths[later])),
        tuple(map(str, paths[earlier])),
        relative[later, None] * matrix / relative[earlier],
    )
