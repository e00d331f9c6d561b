"""The result of an identification: plain values in SI units, for the report, the plots and the files."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float

from ..core import Figure, decimals_for, display_unit, equal_by_value, presenter, rounded
from .comparison import FittedRecord
from .findings import Diagnosis, Draws, IntegratorCheck, Multistart, Profile

if TYPE_CHECKING:
    import pandas

NEGLIGIBLE_AMPLIFICATION = 5e-3
"""Relative change for a relative change of 1 that a table of two digits shows as none."""


class ParameterError(NamedTuple):
    """The error of one parameter by one error model."""

    standard_error: float
    """One standard deviation [unit]; NaN where the data say nothing."""
    interval: tuple[float, float]
    """Lower and upper end of the 95 % interval [unit], symmetric on the scale of the fit and cut at the bounds of the
    parameter; NaN like the error."""
    degrees_of_freedom: float = np.inf
    """Degrees of freedom of the noise estimate, for the interval by Student's t; infinite where the noise is known."""


class MeasuredApart(NamedTuple):
    """A parameter that was measured apart, beside the estimate that uses it."""

    value: float
    """Number that was measured apart [unit]."""
    standard_error: float
    """Standard error of that number [unit]."""
    pull: float
    """Estimate less value, over the standard deviation that this has by chance: standard normal where records and value
    agree.  NaN where the records tell next to nothing of the parameter, or it ended at a bound."""


class ErrorAdvice(NamedTuple):
    """Which of the errors to believe, and why."""

    model: str
    """Name of the error model, such as "white"."""
    reason: str
    """One sentence."""


@dataclass(frozen=True)
class FittedParameter:
    """One parameter of the model, free or fixed."""

    path: str
    """Family and field, such as "friction.sigma0_a"."""
    value: float
    """Estimate [unit]."""
    standard_error: float
    """One standard deviation [unit]; NaN where fixed or where the data say nothing."""
    interval: tuple[float, float]
    """Lower and upper end of the 95 % interval [unit]; NaN like the standard error."""
    unit: str
    """SI unit; "" for a pure number."""
    free: bool
    """Fitted rather than held."""
    start: float | None
    """Where the fit started [unit]; None where fixed."""
    at_bound: bool
    """The estimate lies on one of its bounds."""
    identifiable: bool
    """False where the data say nothing about a free parameter."""
    naive_standard_error: float | None = None
    """Standard error of a sequential fit that takes the earlier step's results for exact; else None."""
    verdicts: tuple[str, str] | None = None
    """How either end of an interval by profile likelihood was found (`Verdict` of
    `inference.uncertainty.profile_likelihood`); None where the interval is linear: symmetric on the scale of the
    fit."""
    errors: Mapping[str, ParameterError] = field(default_factory=dict)
    """Errors by error model, strictest assumption first: "white", "coloured", "with-misfit".  The first is
    `standard_error`.  Empty where fixed."""
    degrees_of_freedom: float = np.inf
    """Degrees of freedom of the noise, for linear intervals by Student's t; infinite where the noise
    is known."""
    bounds: tuple[float, float] = (-np.inf, np.inf)
    """Where it may lie [unit]: the bounds that the study gives, or else those of its legal range."""
    measured_apart: MeasuredApart | None = None
    """The measurement from elsewhere, of a parameter that has one; else None."""

    @property
    def interval_at_bound(self) -> tuple[str, ...]:
        """Which ends of the 95 % interval, "lower" and "upper", are bounds of the parameter."""
        open_ends = [verdict == "flat" for verdict in self.verdicts or ("", "")]
        ends = zip(("lower", "upper"), self.interval, self.bounds, open_ends, strict=True)
        is_bound = lambda end, bound: np.isfinite(bound) and np.isclose(end, bound, rtol=1e-9, atol=0.0)
        return tuple(name for name, end, bound, is_open in ends if is_bound(end, bound) and not is_open)

    @property
    def remark(self) -> str:
        """The remark on the parameter in tables."""
        if not self.free:
            return "fixed"
        marks = ["at bound"] * self.at_bound + ["no information"] * (not self.identifiable)
        if not self.at_bound:
            marks += [f"interval ends at its {name} bound" for name in self.interval_at_bound]
        if (apart := self.measured_apart) is not None:
            pull = "" if np.isnan(apart.pull) else f", pull {apart.pull:+.1f}"
            marks.append(f"measured apart: {self.with_error(apart.value, apart.standard_error)}{pull}")
        return ", ".join(marks)

    def with_error(self, number: float, error: float) -> str:
        """A `number` of it and its standard error [unit], in the unit that tables show, with the digits it deserves."""
        _, factor = display_unit(self.unit)
        places = decimals_for(error * factor)
        return f"{rounded(number * factor, places)} +/- {rounded(error * factor, places)}"


@dataclass(frozen=True)
class Statistics:
    """Goodness of the fit as a whole, in the words of least squares."""

    chi2: float
    """Sum of squared residuals, each divided by its noise."""
    reduced_chi2: float
    """chi2 per degree of freedom; says nothing where `noise_estimated`."""
    aic: float
    """Akaike's information criterion."""
    bic: float
    """Bayesian information criterion."""
    evaluations: int
    """Model evaluations spent."""
    iterations: int
    """Steps of the optimiser."""
    samples: int
    """Samples fitted."""
    free: int
    """Free numbers: parameters and offsets."""
    noise_estimated: bool = False
    """The noise of every record fitted is that of its own residuals, so that reduced_chi2 is 1 by construction."""
    measured_apart: int = 0
    """Parameters that were measured apart: so many more measurements than samples."""


@equal_by_value
@dataclass(frozen=True)
class Amplification:
    """How errors of the parameters fitted first move those fitted after them, to first order."""

    later: tuple[str, ...]
    """Paths of those fitted after the others, as rows."""
    earlier: tuple[str, ...]
    """Paths of those fitted first and then held, as columns: the stack's."""
    matrix: Float[np.ndarray, "later earlier"]
    """Relative change of the row's parameter per relative change of the column's [1]."""

    def visible(self) -> "Amplification":
        """Without the parameters that move nothing, and those that nothing moves; all of them where none does."""
        seen = np.abs(self.matrix) >= NEGLIGIBLE_AMPLIFICATION
        rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
        if not rows.size:
            return self
        kept = lambda paths, places: tuple(paths[place] for place in places)
        return Amplification(kept(self.later, rows), kept(self.earlier, columns), self.matrix[np.ix_(rows, columns)])

    def strongest(self) -> tuple[str, str, float]:
        """The largest entry: which parameter is moved, by which, and by how much."""
        i, j = np.unravel_index(np.argmax(np.abs(self.matrix)), self.matrix.shape)
        return self.later[i], self.earlier[j], float(self.matrix[i, j])


@dataclass(frozen=True)
class Provenance:
    """The origin of an estimate, so that it can be made again."""

    command: str = ""
    """Command line of the fit; "" where a program called `pdssjax.identify`."""
    study: str = ""
    """Path of the study's file, as it was given; "" where there is none."""
    versions: Mapping[str, str] = field(default_factory=dict)
    """Versions of Python and of the packages that compute, by name; empty where none is known."""


OWN_MINIMISER = "BoundedLevenbergMarquardt"
"""The package's own, which minimises where nothing else is asked for."""

Unexplained: TypeAlias = Literal["noise", "contradiction", "validation"]
"""A reason why an estimate does not explain its records."""

_UNEXPLAINED: dict[Unexplained, str] = {
    "noise": "fitted records leave more than noise",
    "contradiction": "records ask for different parameters",
    "validation": "a record that was not fitted is not predicted to within its noise",
}


@equal_by_value
@dataclass(frozen=True)
class Estimate:
    """The whole result of one identification."""

    title: str
    method: Literal["joint", "sequential", "peaks"]
    converged: bool
    message: str
    """One sentence on how the fit ended."""
    parameters: dict[str, FittedParameter]
    """By path."""
    names: tuple[str, ...]
    """Paths of the free parameters, in the order of the matrices."""
    correlation: Float[np.ndarray, "p p"]
    """Correlations [1]; NaN in the rows of uninformed parameters."""
    covariance: Float[np.ndarray, "p p"]
    """Covariances, in the product of the SI units."""
    records: tuple[FittedRecord, ...]
    """In the order of the study."""
    statistics: Statistics
    notes: tuple[str, ...]
    """Sentences the user must read, such as which parameters have no information."""
    seconds: float
    """Wall time of the fit [s]."""
    profiles: tuple[Profile, ...] = ()
    """Profiles of the parameters whose intervals are by profile likelihood."""
    multistart: Multistart | None = None
    """Where fits from the starts asked for ended; None where none were."""
    draws: Draws | None = None
    """Draws of a bootstrap or a posterior, which the intervals then come from."""
    amplification: Amplification | None = None
    """Effect of an error of the stack on all other parameters; None where nothing is fitted after it."""
    loss: str = "squares"
    """What was minimised, a member of `pdssjax.inference.losses`; of a robust one the standard errors are those of a
    sandwich covariance."""
    effort: str = "usual"
    """How much work the fit was allowed: "quick", "usual" or "thorough"."""
    diagnosis: Diagnosis | None = None
    """Which combinations the data determine, and whether the records agree; None where nothing could be simulated."""
    explained: bool = True
    """The residuals of all records fitted are no more than noise, in size, from cycle to cycle and from sample to
    sample, but for samples that stand out, no records contradict each other, and those that were not fitted are
    predicted, too; False where the law lacks something, or the optimum is a wrong one."""
    unexplained_by: tuple[Unexplained, ...] = ()
    """Why not: "noise", fitted records leave more than noise; "contradiction", records ask for different parameters;
    "validation", records that were not fitted are not predicted.  Empty also where the fit could not start."""
    error_advice: ErrorAdvice | None = None
    """Which of the `errors` of the parameters to believe; None where there are none."""
    covariances: Mapping[str, Float[np.ndarray, "p p"]] = field(default_factory=dict)
    """Covariances by error model as in `errors`, in the product of the SI units, in the order of `names`."""
    actuator: Mapping[str, str | bool] = field(default_factory=dict)
    """The models that were fitted, as [actuator] of the study's file has them; empty where unknown."""
    solver: str = "taylor"
    """Name of the integrator, of `pdssjax.integration.SOLVERS` where it is one of those."""
    minimiser: str = OWN_MINIMISER
    """Name of the class of the solver that looked for the minimum."""
    check: IntegratorCheck | None = None
    """How far a fit by another integrator ends from here; None where none was asked for."""
    provenance: Provenance = Provenance()
    """Command, study and versions that it was made with."""

    @property
    def success(self) -> bool:
        """Whether the fit converged and explains its records (`explained`)."""
        return self.converged and self.explained

    @property
    def verdict(self) -> str:
        """How it ended, in the words that follow "the fit"."""
        if not self.converged:
            return "did not converge"
        return "converged" if self.explained else "converged, but does not explain its records"

    @property
    def why_unexplained(self) -> str:
        """Why the estimate does not explain its records: a clause, to be followed by a full stop or a comma."""
        return ", and ".join(_UNEXPLAINED[why] for why in self.unexplained_by) or "the records are not explained"

    def __repr__(self) -> str:
        free = f"{len(self.names)} free of {len(self.parameters)} parameters"
        return f"Estimate({self.title!r}, {self.method} fit {self.verdict}, {free}, {len(self.records)} records)"

    def _repr_html_(self) -> str:
        return presenter().as_html(self)

    def plot(self, what: str | None = None) -> Figure:
        """A figure of matplotlib: every record against its prediction.

        **Arguments:** `what` else to draw: the name of one record, "errors", "correlations", and where the estimate
        has them "profiles", "draws" (of a bootstrap or a posterior), "starts" (`identify(starts=...)`),
        "amplification".

        **Raises:** `InputError` for anything else.
        """
        return presenter().as_figure(self, what)

    def report(self, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
        """Write one HTML file for a colleague, which opens in any browser without network.

        It has what was measured and fitted, all parameters with errors and intervals, findings, figures that can be
        zoomed, versions, and how to repeat it.

        **Raises:** `InputError` where `path` exists and `overwrite` is false, or is a folder; `OSError` where nothing
        can be written there.
        """
        presenter().write_report(self, path, overwrite)

    def to_dataframe(self) -> "pandas.DataFrame":
        """The parameters as a table of pandas, one a row, indexed by path, in SI.

        **Returns:** the columns `value`, `standard_error`, `low` and `high` (95 %), `unit`, `free`, `start`,
        `at_bound`, `identifiable`, and one `standard_error (model)` for each of the error models after the first;
        NaN where there is no number.
        """
        import pandas

        rows = {}
        for path, parameter in self.parameters.items():
            later = list(parameter.errors.items())[1:]
            rows[path] = {
                "value": parameter.value,
                "standard_error": parameter.standard_error,
                "low": parameter.interval[0],
                "high": parameter.interval[1],
                "unit": parameter.unit,
                "free": parameter.free,
                "start": np.nan if parameter.start is None else parameter.start,
                "at_bound": parameter.at_bound,
                "identifiable": parameter.identifiable,
                **{f"standard_error ({model})": error.standard_error for model, error in later},
            }
        return pandas.DataFrame.from_dict(rows, orient="index").rename_axis("parameter")
