"""What a comparison of models found: plain values for the report, the figures and the files."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float

from ..core import Figure, equal_by_value, presenter
from ..study import Record

if TYPE_CHECKING:
    import pandas


class Difference(NamedTuple):
    """By how much one model predicts held-out samples better than another."""

    total: float
    """Difference of the log scores, summed over all parts; positive where the first model is better."""
    standard_error: float
    matters: bool
    """It is not below `scores.MIN_SCORE_DIFFERENCE`, nor below half of what the better one leaves beyond noise."""

    @property
    def sigmas(self) -> float:
        """The difference in standard errors; 0 where the models predict the same."""
        return self.total / self.standard_error if self.standard_error > 0.0 else 0.0

    @property
    def is_significant(self) -> bool:
        """Two standard errors and more, and it matters."""
        return abs(self.sigmas) >= 2.0 and self.matters


@equal_by_value
@dataclass(frozen=True)
class FittedCandidate:
    """One model, fitted to the records of a study; numbers in SI."""

    name: str
    model: Mapping[str, str | bool]
    """As [actuator] of a study's file has it."""
    free: tuple[str, ...]
    """Paths of the free parameters."""
    failure: str = ""
    """Why it has no fit that can be compared; "" where it has one.  All that follows is empty then."""
    converged: bool = False
    explained: bool = False
    """Its residuals are no more than noise (`pdssjax.Estimate.explained`)."""
    message: str = ""
    """How the fit ended."""
    values: Mapping[str, float] = field(default_factory=dict)
    """Every parameter by path."""
    units: Mapping[str, str] = field(default_factory=dict)
    """SI unit of every parameter by path."""
    errors: Mapping[str, float] = field(default_factory=dict)
    """Standard error of every free parameter by path; NaN where the records do not tell it."""
    at_bound: tuple[str, ...] = ()
    """Paths of the free parameters that ended at a bound."""
    noise: Mapping[str, float] = field(default_factory=dict)
    """Standard deviation of every fitted record's noise by the fit, by name, in the record's unit."""
    deviance: float = np.nan
    """Minus twice the logarithm of the likelihood that the fit maximised, by which two starts are compared."""
    residuals: tuple[Float[np.ndarray, " samples"], ...] = ()
    """Measured less predicted of every record of the study, in its unit, its zero included."""
    held_out: tuple[Float[np.ndarray, " samples"], ...] = ()
    """Residuals of every part that was held out, predicted by the parameters that the other samples give."""
    refitted: int = 0
    """Parts for which a linear step was not enough, and the model was fitted again."""
    start: str = ""
    """Where the best fit began: the name of the model whose optimum that was, or "study" for the study's own starts."""
    compared: bool = False
    """It was compared with fits from other starts."""
    finished: bool = False
    """Parts were held out: nothing is left to be done."""
    seconds: float = 0.0
    """Time that it took [s]."""

    @property
    def has_optimum(self) -> bool:
        """Whether a fit ended where the likelihood has a value."""
        return not self.failure and bool(np.isfinite(self.deviance))

    @property
    def optimum(self) -> dict[str, float]:
        """The free parameters [SI] by path."""
        return {path: self.values[path] for path in self.free}

    @property
    def aic(self) -> float:
        """Deviance and twice the number of free parameters; infinite where there is no fit."""
        return self.deviance + 2.0 * len(self.free) if self.has_optimum else np.inf


class RecordNoise(NamedTuple):
    """The noise of a record, the same for every model."""

    deviation: float
    """Standard deviation, in the record's unit."""
    told: bool
    """The study tells it, and residuals exceed it by no more than chance."""
    correlation_time: float
    """Time by which neighbouring samples are alike [s]; 0 of white noise."""
    independent: float
    """Samples that count as independent."""


class Misfit(NamedTuple):
    """Where a model leaves more than the model that predicts best."""

    record: str
    """Name of the record that has the most of it."""
    share: float
    """Part of what is left beyond the best model in all records that lies in this record, within the window."""
    begin: float
    end: float
    """Window that holds half of it: parts of a cycle of the drive from its beginning, or times [s] where the record
    does not repeat.  It passes the end of a cycle where `end` is the smaller one."""
    by_phase: bool
    """The window is one of phase."""
    rms: float
    """Root mean square of the residuals of the record, in its unit."""
    best_rms: float
    """Root mean square of the residuals of the model that predicts best."""


class DiscriminatingRecord(NamedTuple):
    """The record, among those that could be made, in which the predictions of two fitted models differ most."""

    models: tuple[str, str]
    template: str
    """Name of the record of the study that it is like."""
    measures: str
    voltage: float
    """Peak of the drive [V]; NaN where a motion is prescribed."""
    frequency: float
    """Cycles of the drive a second [Hz]; NaN where a motion is prescribed."""
    window: float
    """Part of each cycle after its beginning in which all samples lie; 1 for samples spread evenly."""
    speed: float
    """By how much faster than in the template a prescribed motion is; 1 for a drive."""
    samples: int
    sigmas: float
    """Root of the sum of squared differences, in standard deviations of the noise of independent samples."""
    tried: int
    """How many records were compared."""


@equal_by_value
@dataclass(frozen=True)
class Result:
    """A candidate beside the one that predicts held-out samples best."""

    fitted: FittedCandidate
    time: Difference | None = None
    """By how much the best one scores higher on blocks of time and validation records; None where it has no fit."""
    records: Difference | None = None
    """By how much the best one scores higher on whole records that no fit has seen; None where there are none."""
    criterion: float = np.nan
    """Schwarz's criterion with the number of independent samples, above the lowest one."""
    group: int = -1
    """Number of the group of models that it cannot be told from, 0 for that of the best; -1 where it has no fit."""
    misfit: Misfit | None = None
    """Where it leaves more than the best one; None for the best one and where it leaves no more."""

    @property
    def name(self) -> str:
        """The members in which the candidates differ."""
        return self.fitted.name

    @property
    def is_worse(self) -> bool:
        """It predicts held-out samples worse than the best one, significantly and by an amount that matters."""
        return any(
            found is not None and found.total > 0 and found.is_significant for found in (self.time, self.records)
        )


@equal_by_value
@dataclass(frozen=True)
class Comparison:
    """Models fitted to the same records, and which of them the records support.

    comparison = pdssjax.compare(study, friction=["coulomb", "dahl", "lugre"])
    comparison.chosen            # "dahl"
    comparison.to_dataframe()    # held-out scores, errors, criteria
    comparison.plot("residuals")
    """

    title: str
    results: tuple[Result, ...]
    """Every candidate, the fewest free parameters first."""
    chosen: str
    """The simplest model that predicts held-out samples no worse than any; "" where no model has a fit."""
    best: str
    """The model that predicts held-out samples best; "" where no model has a fit."""
    groups: tuple[tuple[str, ...], ...]
    """Models that the held-out samples do not tell apart, the best group first."""
    noise: Mapping[str, RecordNoise]
    """By name of the record."""
    blocks: int
    """Blocks of time that were held out in turn."""
    whole_records: int
    """Whole records that were held out in turn, or that no fit saw."""
    records: tuple[Record, ...]
    """The records of the study."""
    telling: DiscriminatingRecord | None = None
    """The record that would tell the chosen model from another of its group; None where none is needed, or no record
    can be made up."""
    seconds: float = 0.0
    """Time that it took [s]."""

    @property
    def ambiguous(self) -> tuple[str, ...]:
        """The models that the records cannot tell from the chosen one."""
        group = next((group for group in self.groups if self.chosen in group), ())
        return tuple(name for name in group if name != self.chosen)

    def __getitem__(self, name: str) -> Result:
        """The result of the candidate `name`; **raises** `KeyError` where there is none."""
        for result in self.results:
            if result.name == name:
                return result
        raise KeyError(name)

    def __repr__(self) -> str:
        chosen = f"{self.chosen!r} of {len(self.results)} models" if self.chosen else "no model has a fit"
        return f"Comparison({self.title!r}, {chosen})"

    def _repr_html_(self) -> str:
        return presenter().as_html(self)

    def plot(self, what: str | None = None) -> Figure:
        """A figure of matplotlib: the held-out scores of all models with their errors.

        **Arguments:** `what` else to draw: "residuals", those of every model beside the best one's, record by record.

        **Raises:** `InputError` for anything else.
        """
        return presenter().as_figure(self, what)

    def report(self, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
        """Write one HTML file for a colleague, which opens in any browser without network.

        **Raises:** `InputError` where `path` exists and `overwrite` is false, or is a folder; `OSError` where nothing
        can be written there.
        """
        presenter().write_report(self, path, overwrite)

    def to_dataframe(self) -> "pandas.DataFrame":
        """One row a model, indexed by name.

        **Returns:** the columns `free` (number of free parameters), `worse_by` and `standard_error` (log score on
        held-out blocks below the best model's), `records_worse_by` and `records_standard_error` (the same on whole
        records), `criterion` (above the lowest), `group`, `worse`, `converged`, `explained` and `failure`; NaN where
        there is no number.
        """
        import pandas

        none = Difference(np.nan, np.nan, False)
        rows = {
            result.name: {
                "free": len(result.fitted.free),
                "worse_by": (result.time or none).total,
                "standard_error": (result.time or none).standard_error,
                "records_worse_by": (result.records or none).total,
                "records_standard_error": (result.records or none).standard_error,
                "criterion": result.criterion,
                "group": result.group,
                "worse": result.is_worse,
                "converged": result.fitted.converged,
                "explained": result.fitted.explained,
                "failure": result.fitted.failure,
            }
            for result in self.results
        }
        return pandas.DataFrame.from_dict(rows, orient="index").rename_axis("model")
