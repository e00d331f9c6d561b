"""Where fits from many starts ended: the optima that a study has, as far as they were found."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from ..core import equal_by_value


@equal_by_value
@dataclass(frozen=True)
class Multistart:
    """Fits from many starts, the lowest chi-square first."""

    names: tuple[str, ...]
    """Paths of the free parameters."""
    chi2: Float[np.ndarray, " starts"]
    """Chi-square where each ended [1]; infinite where its start could not be simulated."""
    converged: Bool[np.ndarray, " starts"]
    starts: Float[np.ndarray, "starts p"]
    """Where each began [SI]."""
    ends: Float[np.ndarray, "starts p"]
    """Where it ended [SI]."""
    optimum: Int[np.ndarray, " starts"]
    """Number of the optimum, from 0, to which the start led; -1 where the fit did not converge."""
    iterations: Int[np.ndarray, " starts"]
    ranges: dict[str, tuple[float, float]]
    """Between which the starts were spread [SI]; other free parameters all began at one number."""

    @property
    def distinct(self) -> int:
        """How many optima were found."""
        return int(np.max(self.optimum, initial=-1)) + 1
