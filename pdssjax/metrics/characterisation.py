"""Step efficiency, speed and output force of an actuator from a record alone, as in chapter 3 of the thesis.

The cycles are found in the record itself (`cycle_detection`), the metrics are those of `per_cycle`.  Lengths
and forces are turned so that they are positive along the slow flank: a backward motion is reported
like a forward one, as the thesis does from its figure 3.8 on.

Each figure comes with its mean over the cycles, their standard deviation s and the standard error
of the mean.  The latter joins s / sqrt(cycles) with what the frequency's own uncertainty adds,
which shifts all cycles alike: with e the relative error of the frequency, S e in S and in dS, none
in S_0, (1 - eta_e) e in the efficiency and f S_0 e in the speed.  Give the frequency and it is gone.
Neighbouring net steps share a flank, whose noise adds to one what it takes from the other; so
their standard error is rather too large than too small.
"""

import math
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ..core import InputError, InputWarning
from .cycle_detection import CLEAR_FIT, Cycles, find_cycles
from .per_cycle import cycle_metrics, force_metrics, turning_points
from .sensor_samples import Samples

SI_UNITS = {"displacement": "m", "force": "N"}

LEAST_SHARPNESS = 0.5
"""Share of a slip within a tenth of the period below which a warning says that there is no fast flank."""

_METRICS = {
    "displacement": {"stroke": "m", "back_slip": "m", "net_step": "m", "efficiency": "", "speed": "m/s", "noise": "m"},
    "force": {"output": "N", "maximum": "N", "minimum": "N", "mean": "N"},
}


@dataclass(frozen=True)
class Summary:
    """One figure over all cycles, in `unit`."""

    mean: float
    standard_deviation: float
    """Standard deviation of the cycles; NaN for a single one."""
    standard_error: float
    """Standard error of the mean; NaN for a single cycle."""
    unit: str
    """SI unit; "" for a fraction."""


@dataclass(frozen=True, eq=False)
class Characterisation:
    """Performance of an actuator in one record; SI units, positive along the slow flank."""

    file: Path
    measures: str
    """"displacement" or "force"."""
    column: str
    """The column that was read."""
    time: Samples
    """Sample times [s]."""
    values: Samples
    """The samples as they were measured, their sign kept [m or N]."""
    given: bool
    """Whether the frequency was given, not found in the record."""
    slip_duration: float
    """Duration of a slip as given [s]."""
    cycles: Cycles
    metrics: dict[str, Float[np.ndarray, " cycles"]]
    """By name, one entry a cycle: the fields of `CycleMetrics` or of `ForceMetrics`."""
    summary: dict[str, Summary]
    """Summaries by the same names; of a displacement also "efficiency_by_extremes", from the turning points."""
    before: Float[np.ndarray, " slips"]
    """The extreme sample before each slip, from the one that starts the first cycle to the one that ends the last;
    with the sign of the metrics, and NaN where the record begins with the slip."""
    after: Float[np.ndarray, " slips"]
    """The extreme sample after each slip."""

    @property
    def name(self) -> str:
        """The file's name, without folder and ending."""
        return self.file.stem

    @property
    def sign(self) -> float:
        """-1 where the metrics have the opposite sign of `values`, else 1."""
        return -1.0 if self.cycles.falls else 1.0


def characterisation_of(
    times: Samples,
    values: Samples,
    measures: str,
    *,
    file: Path,
    column: str,
    frequency: float | None,
    slip_duration: float,
) -> Characterisation:
    """Characterise the samples `values` [m or N] at `times` [s] without a model.

    **Arguments:** `measures` is "displacement" or "force"; `file` and `column` name where the samples come
    from, for messages and for the result.  `frequency` [Hz] and `slip_duration` [s] as for `characterise`.

    **Raises:** `InputError` if no cycle is found or the slip takes half a period or more.  Warns with
    `InputWarning` where the cycles are doubtful.
    """
    where = f'{file}: column "{column}"'
    cycles = find_cycles(times, values, frequency, where)
    if not 0 <= slip_duration < 0.5 / cycles.frequency:
        raise InputError(
            f"{where}: found a slip of {slip_duration:g} s, expected at least 0 and less than half the period, "
            f"{0.5 / cycles.frequency:.4g} s."
        )
    sign = -1.0 if cycles.falls else 1.0
    # `start` lies in the middle of a slip.
    arguments = (times, sign * values, cycles.frequency, cycles.start - 0.5 * slip_duration)
    compute = cycle_metrics if measures == "displacement" else force_metrics
    found = compute(*arguments, cycles.count, slip_duration)
    metrics = {name: np.asarray(getattr(found, name)) for name in _METRICS[measures]}
    before, after = _turning_points(times, sign * values, cycles, slip_duration)
    shared, summarised = {}, metrics
    if measures == "displacement":
        e = 0.0 if frequency is not None else cycles.slip_frequency_error / cycles.slip_frequency
        stroke, back, efficiency = (
            abs(float(np.mean(metrics[name]))) for name in ("stroke", "back_slip", "efficiency")
        )
        shared = {"stroke": stroke * e, "net_step": stroke * e, "efficiency": abs(1 - efficiency) * e}
        shared["speed"] = back * cycles.frequency * e
        summarised = metrics | {"efficiency_by_extremes": 1 - (before[1:] - after[1:]) / (before[1:] - after[:-1])}
    result = Characterisation(
        file=file,
        measures=measures,
        column=column,
        time=times,
        values=values,
        given=frequency is not None,
        slip_duration=slip_duration,
        cycles=cycles,
        metrics=metrics,
        summary=_summaries(summarised, _METRICS[measures], shared),
        before=before,
        after=after,
    )
    _warn(result, where)
    return result


def _summaries(
    metrics: dict[str, Float[np.ndarray, " cycles"]], units: dict[str, str], shared: dict[str, float]
) -> dict[str, Summary]:
    """Summaries of metrics, with the errors `shared` by all cycles added."""
    out = {}
    for name, values in metrics.items():
        deviation = float(np.std(values, ddof=1)) if len(values) > 1 else math.nan
        error = math.hypot(deviation / math.sqrt(len(values)), shared.get(name, 0.0))
        out[name] = Summary(float(np.mean(values)), deviation, error, units.get(name, ""))
    return out


def _turning_points(
    time: Samples, values: Samples, cycles: Cycles, slip_duration: float
) -> tuple[Float[np.ndarray, " slips"], Float[np.ndarray, " slips"]]:
    """Extremes on both sides of the slips, whose time is not known to a sample, nor how long they take."""
    slack = slip_duration + 2 * max(float(np.median(np.diff(time))), 0.005 / cycles.frequency)
    found = turning_points(time, values, cycles.frequency, cycles.start - 0.5 * slack, cycles.count + 1, slack)
    before, after = (np.where(np.isfinite(extreme), extreme, np.nan) for extreme in found)
    # Where the record begins in the middle of a slip, its first sample is no turning point.
    if before[0] - after[0] < 0.5 * np.median(before[1:] - after[1:]):
        before[0] = np.nan
    return before, after


def _warn(found: Characterisation, where: str) -> None:
    cycles = found.cycles
    say = lambda text: warnings.warn(f"{where}: {text}", InputWarning, stacklevel=5)
    if cycles.fit < CLEAR_FIT:
        say(
            f"the cycles can hardly be told: a sawtooth of {cycles.frequency:.4g} Hz explains {100 * cycles.fit:.0f} % "
            "of the motion about its trend. See its figure (--out), and give the frequency and a window."
        )
    elif _sharpness(found) < LEAST_SHARPNESS:
        say("found no fast flank: the motion looks more like a sine than like stick and slip.")
    if cycles.count == 1:
        say("found one complete cycle only, so that nothing is known of its scatter.")
    off = abs(cycles.slip_frequency - cycles.frequency)
    if found.given and off > 3 * cycles.slip_frequency_error and off > 1e-3 * cycles.frequency:
        say(f"the slips come at {cycles.slip_frequency:.5g} Hz, while {cycles.frequency:.5g} Hz was given.")


def _sharpness(found: Characterisation) -> float:
    """Share of the slip, as given by the lines through the slow flanks, that happens within a tenth of a period."""
    if found.measures == "force" or found.cycles.count < 2:
        return 1.0
    cycles, stroke, back = found.cycles, found.metrics["stroke"][:-1], found.metrics["back_slip"][:-1]
    if np.mean(back) < 0.1 * np.mean(stroke):
        return 1.0
    slips = cycles.start + np.arange(1, cycles.count) / cycles.frequency
    signed = found.sign * found.values
    early, late = (np.interp(slips + s * 0.05 / cycles.frequency, found.time, signed) for s in (-1, 1))
    return float(np.mean(early - late + 0.1 * stroke) / np.mean(back))
