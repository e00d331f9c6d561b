"""How chi-square rises around an estimate as one parameter leaves its value and the others make the best of it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from ..core import equal_by_value


@equal_by_value
@dataclass(frozen=True)
class Profile:
    """The likelihood profile of one parameter, from the lower end of its interval to the upper."""

    path: str
    value: Float[np.ndarray, " points"]
    """Of the parameter [its SI unit], ascending."""
    excess: Float[np.ndarray, " points"]
    """Chi-square above its minimum [1], minimised over all other parameters."""
    linear: Float[np.ndarray, " points"]
    """The same [1] by the linear model at the optimum: a parabola on the scale of the fit."""
    computed: Bool[np.ndarray, " points"]
    """Where the model was evaluated; the points between follow from values and slopes there."""
    threshold: float
    """The excess at which the 95 % interval ends."""
    verdict: str
    """In words: bounded, one-sided, flat, several minima, held by a bound, or not followed."""
    quality: float
    """How well the points foretell each other: 1 where values and slopes fit together, 0 where one misses by the
    threshold; NaN where there is nothing to compare."""
    evaluations: int
    """Of model and derivatives, for both ends and the curve."""
