"""What an identification found: plain values in SI units, for the report, the plots and the files."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from .metrics import error_index, r_squared, rmse
from .records import Record
from .residual import noise_floor

FORMAT = "pdssjax-estimate/1"
"""Of the file in which an estimate is kept."""


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
    informed: bool
    """False where the data say nothing about a free parameter."""
    naive_standard_error: float | None = None
    """Standard error of a sequential fit that takes the earlier step's results for exact; else None."""


@dataclass(frozen=True)
class FittedRecord:
    """One record beside its prediction, in SI."""

    name: str
    role: str
    """"fit" or "validate"."""
    measures: str
    """"platform", "effector", "friction" or "force", as in `pdssjax.records.Record`."""
    samples: int
    r2: float
    """Share of the measured variance that is explained."""
    error_index: float
    """Error index of (4.14)."""
    rmse: float
    """Root mean square of the residuals."""
    noise: float
    """Standard deviation of the measurement noise, given, or estimated from the residuals; NaN where neither is."""
    offset: float
    """The record's own zero."""
    offset_standard_error: float
    """Its standard error; NaN where given, or where the record was not fitted."""
    time: Float[np.ndarray, " n"]
    """Sample times [s]."""
    measured: Float[np.ndarray, " n"]
    predicted: Float[np.ndarray, " n"]
    """The model's values at `time`, offset included; NaN where the simulation failed."""
    simulated: bool
    """False where the simulation failed."""
    unit: str = "m"
    """SI unit of what was measured."""
    motion: Float[np.ndarray, " n"] | None = None
    """Of a friction record: the relative displacement prescribed [m]."""
    noise_estimated: bool = False
    """The study gives no noise: `noise` is that of these residuals, or NaN."""
    noise_floor: float = math.nan
    """The noise seen between neighbouring samples, whatever the fit; NaN for fewer than eight samples."""
    chi2: float = math.nan
    """Sum of squared residuals, each divided by `noise`."""
    reduced_chi2: float = math.nan
    """chi2 per degree of freedom; NaN where the noise was estimated from these residuals, which makes it 1."""


def compare(
    record: Record,
    predicted: Float[np.ndarray, " n"],
    *,
    noise: float,
    offset: float,
    offset_standard_error: float = math.nan,
    parameters: float = 0.0,
) -> FittedRecord:
    """A measured `record` beside its prediction, to which the record's `offset` is added; all in its unit.

    **Arguments:** `noise` is a standard deviation, NaN or 0 where none is known; `parameters` is
    the record's share of the parameters fitted, its own offset not counted.
    """
    predicted = np.asarray(predicted) + offset
    measured = record.measured
    squares = float(np.sum((measured - predicted) ** 2))
    chi2 = squares / noise**2 if noise > 0 else math.nan
    freedom = max(len(measured) - parameters - (record.offset is None), 1.0)
    return FittedRecord(
        name=record.name,
        role=record.role,
        measures=record.measures,
        samples=len(measured),
        r2=r_squared(measured, predicted),
        error_index=error_index(measured, predicted),
        rmse=rmse(measured, predicted),
        noise=noise,
        offset=offset,
        offset_standard_error=offset_standard_error,
        time=record.time,
        measured=measured,
        predicted=predicted,
        simulated=bool(np.isfinite(predicted).all()),
        unit=record.unit,
        motion=record.motion,
        noise_estimated=record.noise is None,
        noise_floor=noise_floor(record) if len(measured) >= 8 else math.nan,
        chi2=chi2,
        reduced_chi2=math.nan if record.noise is None else chi2 / freedom,
    )


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


@dataclass(frozen=True)
class Estimate:
    """The whole result of one identification."""

    title: str
    method: Literal["joint", "sequential"]
    converged: bool
    message: str
    """One sentence on how the fit ended."""
    parameters: dict[str, FittedParameter]
    """By path."""
    names: tuple[str, ...]
    """Paths of the free parameters, in the order of the matrices."""
    correlation: Float[np.ndarray, "p p"]
    """Correlations; NaN in the rows of uninformed parameters."""
    covariance: Float[np.ndarray, "p p"]
    """Covariances, in the product of the SI units."""
    records: tuple[FittedRecord, ...]
    """In the order of the study."""
    statistics: Statistics
    notes: tuple[str, ...]
    """Sentences the user must read, such as which parameters have no information."""
    seconds: float
    """Wall time of the fit [s]."""
