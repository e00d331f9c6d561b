"""The stack's gain, natural frequency and damping ratio from the peaks of step responses, with their covariance.

The thesis's first step (appendix 1; the formulas are in `step_peaks`): of each record of a step the first extremes,
six at most, as the samples show them; then the mean over the records.  A peak lies between samples, so that its time
is wrong by up to half a sample whatever the noise, and by the same in every record sampled alike: more records do
not help, and no closed form covers both this and the noise that makes a flat peak wander over many samples.  The
covariance is therefore simulated: steps of systems scattered over one sample's worth of frequency, sampled as the
records are, with their noise, are read in the same way, and it is the second moment of what comes out wrong, bias
included.
"""

import dataclasses
import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ...core import InputError
from ...piezo.second_order import SecondOrder
from ...study import MARK, Record, Study, split_path
from ..initial_values.record_features import is_step, noise_of, voltages
from ..initial_values.step_peaks import APART, Extremes, OneMode, extremes, one_mode, rest_before, step_response
from ..prior import Prior

PEAKS = 6
"""Extremes read of a record, at most: three highs and three lows."""

VISIBLE = 5.0
"""Distance of an extreme from the final value, over the noise, from which it is read."""

_SWING = 12.0
"""Distance from one extreme to the next, over the noise, from which both are read: noise alone comes to 6."""

_RESOLVED = 3
"""Samples from one extreme to the next, at least."""

DRAWS = 2000
"""Simulated readings behind the covariance: errors to 1.6 %."""

_TOGETHER = 100
"""Draws that are held in memory at once."""

PATHS = ("piezo.gain", "piezo.natural_frequency", "piezo.damping_ratio")
"""Paths of the parameters that peaks determine, in this order."""


class StepRecord(NamedTuple):
    """A record of a step as peaks are read from it."""

    name: str
    time: Float[np.ndarray, " n"]
    """Times of the samples after the step [s]."""
    height: Float[np.ndarray, " n"]
    """In the direction of the step, above the rest before it [m]."""
    voltage: float
    """Size of the step [V]."""
    noise: float
    """Standard deviation of the noise of a sample [m]."""
    zero_error: float
    """Standard error of the rest before the step [m]."""
    peaks: int
    """Extremes that stand out."""


@dataclasses.dataclass(frozen=True, eq=False)
class PickedStack:
    """Parameters of a stack by the peaks of step responses."""

    read: Float[np.ndarray, "3"]
    """The numbers by the peaks alone [SI], in the order of `PATHS`."""
    records: tuple[StepRecord, ...]
    measured_apart: Prior
    """What was measured apart of `PATHS`, on their logarithms."""

    @property
    def values(self) -> dict[str, float]:
        """Numbers [SI] by path of `PATHS`, those measured apart combined with the peaks."""
        values = np.exp(self.prior.mean) if self.measured_apart.paths else self.read
        return dict(zip(PATHS, map(float, values), strict=True))

    @functools.cached_property
    def prior(self) -> Prior:
        """The logarithms of the numbers at `PATHS` by peaks and what was measured apart; errors include the bias."""
        peaks = Prior.of_covariance(PATHS, np.log(self.read), simulated_covariance(self.read, self.records))
        return peaks.combined(self.measured_apart) if self.measured_apart.paths else peaks

    @property
    def covariance(self) -> Float[np.ndarray, "3 3"]:
        """Second moments of the errors of the logarithms, in the order of `PATHS`; they include the bias."""
        return self.prior.covariance


def pick_peaks(study: Study) -> PickedStack:
    """Gain [m/V], natural frequency [rad/s] and damping ratio from the fitted records of steps.

    **Raises:** `InputError` where the stack is not a second-order system seen directly, where no record with role
    "fit" is of the platform under an ideal step, and where one does not show two extremes or nothing before the step.
    """
    where = str(study.path or study.title)
    _check_models(study, where)
    fitted = [record for record in study.records if record.role == "fit"]
    steps = [record for record in fitted if _shows_a_step(record)]
    if not steps:
        raise InputError(
            f"{where}: found no fitted record of the platform under an ideal step of voltage, from which peaks could "
            'be picked; expected at least one, or method "sequential".'
        )
    _check_between(study, steps, where)
    read = tuple(_step_record(record, where) for record in steps)
    systems = [one_mode(extremes(step.time, step.height, step.peaks)) for step in read]
    values = np.mean([_stack_numbers(system, step.voltage) for system, step in zip(systems, read, strict=True)], axis=0)
    stack = PickedStack(values, read, Prior.measured_apart(study.parameters).on_logarithms(PATHS))
    for path, number in stack.values.items():
        declared = study.parameters.get(path)
        if declared is not None and declared.free:
            low, high = declared.bounds()
            if not low <= number <= high:
                raise InputError(
                    f'{where}: parameters: "{path}": found {number:.6g} {declared.unit} by the peaks of the step '
                    f"records, expected a number within its bounds, {low:g} to {high:g}."
                )
    return stack


def _check_models(study: Study, where: str) -> None:
    if study.piezo is not SecondOrder:
        name = study.piezo.__module__.rpartition(".")[2].replace("_", "-")
        raise InputError(f'{where}: [actuator]: found piezo = "{name}", expected "second-order" for method "peaks".')
    if study.feedback:
        raise InputError(
            f'{where}: [actuator]: found feedback = true, expected false for method "peaks": the peaks must be the '
            "stack's own."
        )
    listed = study.parameters
    local = [path for path in listed if path.startswith("piezo.") and MARK in path]
    if local:
        raise InputError(
            f'{where}: parameters: found "{local[0]}", expected one stack in all records for method "peaks".'
        )
    if not any(path in listed and listed[path].free for path in PATHS):
        raise InputError(
            f'{where}: parameters: found none of {", ".join(PATHS)} free, expected one for method "peaks".'
        )


def _check_between(study: Study, steps: Sequence[Record], where: str) -> None:
    """Refuse what lies between the step that is commanded and its measurement, unless it is 0."""
    conditions = {"", *(condition for record in steps for condition in record.conditions)}
    between = [
        path
        for path, parameter in study.parameters.items()
        if path.startswith(("amplifier.", "sensor.", "drive.rise_time"))
        and split_path(path)[1] in conditions
        and parameter.value != 0.0
    ]
    if between:
        raise InputError(
            f'{where}: parameters: found "{between[0]}", expected no amplifier, sensor or rise time in records of '
            'steps for method "peaks", which takes a step for ideal, and when it begins for exact; expected method '
            '"sequential", which fits them.'
        )


def _shows_a_step(record: Record) -> bool:
    """The platform's displacement under a voltage that jumps at t = 0 and then stays."""
    if not (record.measurement.platform_alone and record.measurement.unit == "m"):
        return False
    if not (record.drive is not None and record.drive.has_jumps() and is_step(record)):
        return False
    after = voltages(record)[record.time > 0.0]
    return bool(np.ptp(after) <= 1e-9 * np.max(np.abs(after)))


def _step_record(record: Record, where: str) -> StepRecord:
    """The part of a record with its peaks, as many as stand out, and without what comes after them.

    **Raises:** `InputError` where fewer than two do, or nothing is before the step.
    """
    where = f'{where}: record "{record.name}"'
    voltage = float(voltages(record)[-1])
    after = record.time > 0.0
    if record.offset is None and after.all():
        raise InputError(
            f"{where}: found its first sample {1e3 * record.time[0]:.4g} ms after the step, expected some before it, "
            'or an offset, to count heights from for method "peaks".'
        )
    zero, count = rest_before(record.time, record.measured) if record.offset is None else (record.offset, 0)
    noise, time = noise_of(record), record.time[after]
    height = np.sign(voltage) * (record.measured[after] - zero)
    zero_error = float(noise / np.sqrt(count)) if count else 0.0
    found = extremes(time, height, PEAKS)
    half, last = float(found.times[0]), float(time[-1])
    swings = np.abs(np.diff(found.heights))
    complete = found.times[:-1] + APART * half <= last
    if not float(found.heights[0]) > VISIBLE * noise:
        raise InputError(f'{where}: found no motion above its noise, expected a step response for method "peaks".')
    rings = bool(swings[0] > _SWING * noise)
    if not (rings and complete[0]):
        first = float(time[int(np.argmax(height))])
        if first > 0.9 * last or rings:
            raise InputError(
                f"{where}: found {1e3 * last:.4g} ms after the step with the highest sample at {1e3 * first:.4g} ms, "
                'expected a record of two extremes at least for method "peaks": a longer one, or a platform that rings.'
            )
        raise InputError(
            f"{where}: found no ringing above its noise of {1e6 * noise:.3g} um after the step, expected two "
            'extremes that stand out for method "peaks": the platform is too damped, or the record too noisy.'
        )
    interval = float(np.median(np.diff(time)))
    if half < _RESOLVED * interval:
        raise InputError(
            f"{where}: found its first peak {half / interval:.2g} samples after the step, expected at least "
            f'{_RESOLVED} for method "peaks": the samples do not show the ringing.'
        )
    peaks = 1 + int(np.sum(np.cumprod(complete & (swings > _SWING * noise))))
    # Late extremes fade into the noise: those are left out in whose place the system has none to see.
    system = one_mode(Extremes(found.times[:peaks], found.heights[:peaks]))
    away = np.abs(found.heights[:peaks] / system.final - 1.0)
    visible = (away > VISIBLE * noise / float(system.final)) & (away > 2e-3)
    peaks = max(int(np.sum(np.cumprod(visible))), 2)
    used = time <= found.times[peaks - 1] + APART * half
    return StepRecord(record.name, time[used], height[used], abs(voltage), noise, zero_error, peaks)


def _stack_numbers(system: OneMode, voltage: float) -> Float[np.ndarray, "... 3"]:
    """The numbers of a system under a step of a `voltage`, in the order of `PATHS` along the last axis."""
    return np.stack([system.final / voltage, system.natural_frequency, system.damping_ratio], axis=-1)


def simulated_covariance(values: Float[np.ndarray, "3"], steps: Sequence[StepRecord]) -> Float[np.ndarray, "3 3"]:
    """Second moment of the errors of the logarithms, `DRAWS` readings of systems near the one found."""
    random = np.random.default_rng(0)
    interval = max(float(np.median(np.diff(step.time))) for step in steps)
    half = np.pi / (values[1] * np.sqrt(1.0 - values[2] ** 2))
    moment = np.zeros((3, 3))
    for _ in range(DRAWS // _TOGETHER):
        truth = np.tile(values, (_TOGETHER, 1))
        # Over one sample the first peak takes every place between two samples, and the later ones too.
        truth[:, 1] *= half / (half + interval * random.uniform(-0.5, 0.5, _TOGETHER))
        readings = []
        for step in steps:
            height = step_response(OneMode(truth[:, 0] * step.voltage, *truth[:, 1:].T), step.time)
            height += step.noise * random.standard_normal(height.shape)
            height += step.zero_error * random.standard_normal((_TOGETHER, 1))
            readings.append(_stack_numbers(one_mode(extremes(step.time, height, step.peaks)), step.voltage))
        found = np.mean(readings, axis=0)
        with np.errstate(invalid="ignore"):
            errors = np.log(found / truth)
        moment += errors.T @ errors
    return moment / (_TOGETHER * (DRAWS // _TOGETHER))
