"""A record beside its prediction."""

import math
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from ..core import LENGTH, Display, equal_by_value
from ..metrics import LackOfFit, error_index, lack_of_fit, outliers, r_squared, rmse, rounding_of_counts, scatter_floor
from .record import Record


@equal_by_value
@dataclass(frozen=True)
class FittedRecord:
    """One record beside its prediction, in SI."""

    name: str
    role: str
    """"fit" or "validate"."""
    measures: str
    """"platform", "effector", ...: a member of `pdssjax.study.measurement`, as a study writes it."""
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
    """Standard error of the offset; NaN where given, or where the record was not fitted."""
    time: Float[np.ndarray, " n"]
    """Sample times [s]."""
    measured: Float[np.ndarray, " n"]
    predicted: Float[np.ndarray, " n"]
    """The model's values at `time`, offset included; NaN where the simulation failed."""
    simulated: bool
    """False where the simulation failed."""
    unit: str = "m"
    """SI unit of what was measured."""
    display: Display = LENGTH
    """How it is shown."""
    motion: Float[np.ndarray, " n"] | None = None
    """The relative displacement [m], or velocity [m/s], where that is prescribed."""
    prescribed: Display = LENGTH
    """How that is shown."""
    noise_estimated: bool = False
    """The study gives no noise: `noise` is that of these residuals, or NaN."""
    noise_floor: float = math.nan
    """The noise seen between neighbouring samples, whatever the fit; NaN for fewer than eight samples."""
    chi2: float = math.nan
    """Sum of squared residuals, each divided by `noise`."""
    words: dict[str, str] = field(default_factory=dict)
    """Which of its kind was measured, by key of the study: {"of": "platform"} of a velocity."""
    reduced_chi2: float = math.nan
    """chi2 per degree of freedom; NaN where the noise was estimated from these residuals, which makes it 1."""
    lack_of_fit: LackOfFit | None = None
    """What repeats every cycle of the `residual`, the `outliers` left out; None where the drive does not repeat within
    the record."""
    frequency: float | None = None
    """Cycles of its drive a second [Hz]; None where the drive does not repeat."""
    outliers: Int[np.ndarray, " k"] = field(default_factory=lambda: np.zeros(0, int))
    """Indices of samples that stand out of the residuals in runs of five at most: glitches."""
    undisturbed: Float[np.ndarray, " n"] | None = None
    """`predicted` by a fit without the `outliers` of its records, which pull it; None: as `predicted`."""
    voltage: Float[np.ndarray, " n"] | None = None
    """The command at `time` [V], where the platform alone is measured; else None."""
    excitation: str = ""
    """The excitation in words: waveform, peak voltage and frequency of the drive."""
    file: str = ""
    """Name of the file of data, without its folder."""

    @property
    def residual(self) -> Float[np.ndarray, " n"]:
        """Measured less predicted, of every sample: what reports, plots, predictions and errors rest on."""
        return self.measured - self.predicted

    @property
    def residual_without_outliers(self) -> Float[np.ndarray, " n"]:
        """The `residual`, NaN in the places of the `outliers`."""
        return _rest(self.measured, self.predicted, self.outliers)

    @property
    def rest(self) -> Float[np.ndarray, " n"]:
        """The residuals that a fit without the `outliers` would leave of all other samples; NaN in their places.

        They tell whether the model explains what was measured, and are no residuals of this fit.
        """
        return _rest(self.measured, self.predicted if self.undisturbed is None else self.undisturbed, self.outliers)

    @property
    def rest_rmse(self) -> float:
        """Root mean square of the `rest`."""
        return float(np.sqrt(np.mean(np.delete(self.rest, self.outliers) ** 2)))

    @property
    def rest_chi2(self) -> float:
        """`reduced_chi2` of these; NaN like that."""
        return self.reduced_chi2 * (self.rest_rmse / self.rmse) ** 2 if self.rmse > 0.0 else self.reduced_chi2

    @property
    def largest_error(self) -> float:
        """Largest residual by size; NaN where the simulation failed, or there are no samples."""
        return float(np.max(np.abs(self.residual))) if self.time.size else math.nan


def compare(
    record: Record,
    predicted: Float[np.ndarray, " n"],
    *,
    noise: float,
    offset: float,
    offset_standard_error: float = math.nan,
    parameters: float = 0.0,
    undisturbed: Float[np.ndarray, " n"] | None = None,
) -> FittedRecord:
    """A measured `record` beside its prediction, to which the record's `offset` is added; all in its unit.

    **Arguments:** `noise` is a standard deviation, NaN or 0 where none is known; `parameters` is
    the record's share of the parameters fitted, its own offset not counted; `undisturbed` is what a fit
    predicts that did not see samples that stand out, without an offset.
    """
    predicted = np.asarray(predicted) + offset
    measured = record.measured
    squares = float(np.sum((measured - predicted) ** 2))
    chi2 = squares / noise**2 if noise > 0 else math.nan
    freedom = max(len(measured) - parameters - (record.offset is None), 1.0)
    frequency = cycles_a_second(record)
    found = outliers(measured, predicted if undisturbed is None else undisturbed, record.time, frequency)
    if undisturbed is not None:
        zero = np.mean(np.delete(measured - undisturbed, found)) if record.offset is None else record.offset
        undisturbed = np.asarray(undisturbed) + zero
    voltage = None
    if record.drive is not None and record.measurement.platform_alone:
        voltage = record.drive.sampled_at(record.time)
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
        unit=record.measurement.unit,
        display=record.measurement.display,
        motion=record.motion,
        prescribed=record.measurement.prescribed_display,
        words=record.measurement.words,
        noise_estimated=record.noise is None,
        noise_floor=max(scatter_floor(measured), rounding_of_counts(measured)) if len(measured) >= 8 else math.nan,
        chi2=chi2,
        reduced_chi2=math.nan if record.noise is None else chi2 / freedom,
        lack_of_fit=repeated_residuals(record, _rest(measured, predicted, found)),
        frequency=frequency,
        outliers=found,
        undisturbed=undisturbed,
        voltage=voltage,
        excitation=record.excitation,
        file=record.file.name,
    )


def _rest(
    measured: Float[np.ndarray, " n"], predicted: Float[np.ndarray, " n"], outlying: Int[np.ndarray, " k"]
) -> Float[np.ndarray, " n"]:
    rest = measured - predicted
    rest[outlying] = np.nan
    return rest


def repeated_residuals(record: Record, residual: Float[np.ndarray, " n"]) -> LackOfFit | None:
    """The part of a record's `residual` that repeats every cycle; None where the drive does not repeat."""
    frequency = cycles_a_second(record)
    return None if frequency is None else lack_of_fit(residual, record.time, frequency)


def cycles_a_second(record: Record) -> float | None:
    """Frequency of a record's drive [Hz]; None where it does not repeat."""
    frequency = None if record.drive is None else record.drive.cycle_frequency()
    return None if frequency is None else float(frequency)
