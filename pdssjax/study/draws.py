"""Parameters drawn many times, by a bootstrap or from a posterior, and what the draws say of each."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Float, Num

from ..core import equal_by_value


@dataclass(frozen=True)
class ParameterDraws:
    """What the draws say of one parameter."""

    path: str
    mean: float
    """[unit of the parameter]"""
    deviation: float
    """Standard deviation of the draws [unit]."""
    percentile: tuple[float, float]
    """Holds the middle 95 % of the draws [unit]."""
    basic: tuple[float, float] | None = None
    """Of a bootstrap: the same mirrored at the estimate on the scale of the fit [unit]."""
    rhat: float | None = None
    """Of a posterior: how far the chains disagree; 1 where they do not, at most 1.01 where they can be trusted."""
    effective: float | None = None
    """Of a posterior: as many independent draws say as much of the middle."""
    effective_tails: float | None = None
    """Of a posterior: the same for the ends of the interval."""


@equal_by_value
@dataclass(frozen=True)
class Draws:
    """Draws of all free parameters."""

    kind: Literal["bootstrap", "posterior"]
    description: str
    """In words: what was drawn, and how."""
    names: tuple[str, ...]
    """Paths of the free parameters."""
    values: Float[np.ndarray, "chains draws p"]
    """In SI; a bootstrap is one chain."""
    failed: int
    """Of what `failure` says."""
    failure: str
    """In words: replicates that did not converge, which a bootstrap leaves out; proposals of a posterior that the model
    refused, where the draw before counts once more; or trajectories that ended at an edge, which are draws all the
    same."""
    seed: int
    parameters: tuple[ParameterDraws, ...]
    statistics: dict[str, Num[np.ndarray, "chains draws"]] = field(default_factory=dict)
    """Of a posterior, for each draw, by ArviZ's names: "lp", the logarithm of its density but for a constant, and
    "accepted" [1], or of the No-U-Turn sampler "acceptance_rate" [1], "n_steps" and "diverging" [1]."""
