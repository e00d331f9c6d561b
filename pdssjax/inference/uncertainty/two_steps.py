"""A fit in two steps: how its estimate follows the samples, the errors of the first step carried on to the second.

Parameters a are fitted to the first step's samples, and held while b are fitted to the second's.  An error of a moves
b by -H_b^-1 J_b' J_a da to first order (K. M. Murphy and R. H. Topel, Journal of Business and Economic Statistics
3(4), 1985).  Here that is the influence of the first step's samples on b, so that any error model may follow; the
curvature of residuals that do not average out enters as in `influence`.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from .influence import principal_directions, pseudo_inverse, relative_curvature


class TwoSteps(NamedTuple):
    """The Jacobians of the steps of a fit, each zero in the rows that it does not use, and what is fitted in each."""

    first: Float[np.ndarray, "n p"]
    second: Float[np.ndarray, "n p"]
    earlier: Int[np.ndarray, " q"]
    """Places of the parameters fitted in the first step."""
    later: Int[np.ndarray, " r"]

    def apart(self) -> "TwoSteps":
        """The same where the second step takes what the first has found for exact."""
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
        pulled = (self.second[:, self.earlier] @ along).T @ left
        if late is not None:
            pulled = pulled + late[self.later, :count].T @ spread
        found[:, self.later] = (left - base @ pulled) @ inverse
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
