"""Further results of an identification: diagnosis, profiles, draws, and where other fits ended."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int, Num

from ..core import equal_by_value

VISIBLE = 0.1
"""Standard errors by which a parameter has to differ to be worth a note."""


@dataclass(frozen=True)
class Combination:
    """A product of powers of parameters that the data determine independently of every other combination."""

    exponents: dict[str, float]
    """By path, the largest 1; those too small to matter are left out."""
    relative_error: float
    """Standard error of the logarithm of the product."""


@dataclass(frozen=True)
class Remedy:
    """The parameter whose separate measurement would lower the other errors most."""

    path: str
    """The parameter that would have to be known."""
    errors: dict[str, tuple[float, float]]
    """Relative standard errors of those parameters that gain from it, as they are and as they would be."""


@dataclass(frozen=True)
class Agreement:
    """Influence of a group of records on the estimate, to first order."""

    records: tuple[str, ...]
    """Their names."""
    what: str
    """Attribute that the records have in common: "record", "direction", "kind"."""
    sigmas: float
    """How far they disagree with the other records, as a normal deviate; above 4 it is no chance."""
    shifts: dict[str, float]
    """By path, what leaving them out would change in a parameter of a joint fit, in the standard errors of this one;
    NaN where only these records determine it."""

    def largest(self) -> tuple[str, float]:
        """The parameter that leaving these records out would move most, and its shift; ("", 0.0) where none is."""
        known = {path: shift for path, shift in self.shifts.items() if shift == shift}
        path = max(known, key=lambda name: abs(known[name]), default="")
        return path, known.get(path, 0.0)


@dataclass(frozen=True)
class Diagnosis:
    """Combinations that the data determine, and agreement of the records."""

    combinations: tuple[Combination, ...]
    """Combinations of the free parameters, the worst determined first."""
    remedy: Remedy | None
    """None where no single parameter would help much."""
    agreement: tuple[Agreement, ...]
    """Agreement of every record fitted, and of records of a common direction or kind; empty for a single record."""


@equal_by_value
@dataclass(frozen=True)
class Profile:
    """The likelihood profile of one parameter, from the lower end of its interval to the upper."""

    path: str
    value: Float[np.ndarray, " points"]
    """Values of the parameter [its SI unit], ascending."""
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
    """Evaluations of model and derivatives, for both ends and the curve."""


@dataclass(frozen=True)
class ParameterDraws:
    """Summary of the draws of one parameter."""

    path: str
    mean: float
    """[unit of the parameter]"""
    deviation: float
    """Standard deviation of the draws [unit]."""
    percentile: tuple[float, float]
    """Holds the middle 95 % of the draws [unit]."""
    basic: tuple[float, float] | None = None
    """Basic interval of a bootstrap: the percentiles mirrored at the estimate on the scale of the fit [unit]."""
    rhat: float | None = None
    """R-hat of a posterior: disagreement of the chains, 1 for none; trust at most 1.01."""
    effective: float | None = None
    """Effective sample size of the middle of a posterior."""
    effective_tails: float | None = None
    """Effective sample size of the tails of a posterior."""


@equal_by_value
@dataclass(frozen=True)
class Draws:
    """Draws of all free parameters."""

    kind: Literal["bootstrap", "posterior"]
    description: str
    """A sentence on what was drawn, and how."""
    names: tuple[str, ...]
    """Paths of the free parameters."""
    values: Float[np.ndarray, "chains draws p"]
    """The draws [SI]; a bootstrap is one chain."""
    failed: int
    """Number of the draws that `failure` describes."""
    failure: str
    """In words: replicates that did not converge, which a bootstrap leaves out; proposals of a posterior that the model
    refused, where the draw before counts once more; or trajectories that ended at an edge, which are draws all the
    same."""
    seed: int
    parameters: tuple[ParameterDraws, ...]
    statistics: dict[str, Num[np.ndarray, "chains draws"]] = field(default_factory=dict)
    """Statistics of each draw of a posterior, by ArviZ's names: "lp", its log density up to a constant, and
    "accepted" [1], or of the No-U-Turn sampler "acceptance_rate" [1], "n_steps" and "diverging" [1]."""


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
    """Ranges over which the starts were spread [SI]; other free parameters all began at one number."""

    @property
    def distinct(self) -> int:
        """How many optima were found."""
        return int(np.max(self.optimum, initial=-1)) + 1


@dataclass(frozen=True)
class IntegratorCheck:
    """A second fit, by another integrator, from where the first one ended."""

    solver: str
    """Name of that integrator, such as "kvaerno5"."""
    differences: Mapping[str, float]
    """By path of a free parameter, what the second fit found less what the first one did, in standard errors; NaN where
    the parameter has no standard error, or where the second fit could not start."""
    converged: bool
    """Whether the second fit did."""
    message: str
    """One sentence on how the second fit ended."""

    @property
    def largest(self) -> tuple[str, float] | None:
        """Path and difference of the parameter that differs most; None where no difference is known."""
        known = {path: number for path, number in self.differences.items() if number == number}
        return max(known.items(), key=lambda entry: abs(entry[1])) if known else None

    @property
    def sentence(self) -> str:
        """The result in one line."""
        if self.largest is None:
            return f"by {self.solver}: no difference is known: {self.message}"
        path, number = self.largest
        ended = "" if self.converged else f"; that fit did not converge: {self.message}"
        return f"by {self.solver}: no parameter differs by more than {abs(number):.2g} standard errors ({path}){ended}"
