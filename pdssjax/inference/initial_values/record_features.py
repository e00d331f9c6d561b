"""Features of a rig read from records before any fit: gain, ringing and contact.

Gain, natural frequency and damping ratio of a platform that rings under any voltage, by responses of one mode.

For frequencies all over what the samples can show, and a few damping ratios, the response of

    y'' + 2 xi w y' + w^2 y = K w^2 u

to the voltage, a straight line from sample to sample, is laid over the motion by least squares, with a constant, a
drift and what rings on from before the record.  From the best the two numbers are refined.  It rings if that leaves
less than a lag does, w^2 -> infinity with 2 xi / w = tau, of any tau.
"""

import cmath
import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from jaxtyping import Complex, Float

from ...metrics import scatter_floor
from ...study import Record, Samples, drive_with
from ..covariance import scaled_least_squares
from .step_peaks import half_period_to_frequency, overshoot_to_damping, rest_before

_JUMP = 0.1
"""Change from one sample to the next that counts as a jump, as a fraction of the voltage's swing."""

_MOST_TIMES = 200_000
"""Largest number of times at which a voltage is evaluated."""

_PER_RESPONSE = 4
"""Times per response time 1/rate of a platform at which a voltage is evaluated, so that corners are hardly missed."""

_LEAST_OF_FLANK, _MOST_FLANKS = 4, 12
"""How many samples the later half of a slow flank has at least, and how many such halves of a record are used."""


def as_quantity(records: Sequence[Record], quantity: Literal["displacement", "force"]) -> list[Record]:
    """The records from which the quantity follows, with that [m or N], up to a constant, in place of the samples."""
    samples = [Samples(r.time, r.measured, voltages(r), r.offset) for r in records]
    values = [getattr(r.measurement, quantity)(s) for r, s in zip(records, samples, strict=True)]
    return [dataclasses.replace(r, measured=v) for r, v in zip(records, values, strict=True) if v is not None]


def oscillator(driven: Sequence[Record], rings: bool) -> dict[str, float]:
    """Gain, natural frequency and damping ratio, as far as records with a drive show them.

    **Arguments:** whether the stack `rings`: only then are records without a step searched for a resonance.
    """
    moving = as_quantity(driven, "displacement")
    platforms = [record for record in moving if record.measurement.platform_alone]
    steps = [record for record in platforms if is_step(record)]
    if steps:
        return _medians([_from_step(record) for record in _most_finely_sampled(steps)])
    if rings and (modes := [found for record in _most_finely_sampled(platforms) if (found := _ringing(record))]):
        return _medians(modes)
    flanks = [_flank_gain(r) for r in moving if r.drive is not None and r.drive.flanks() is not None]
    gains = flanks or [_range_gain(record) for record in platforms]
    gains = gains or [gain for record in moving for gain in _sticking_gains(record)]
    gains = gains or [gain for gain in map(_following_gain, moving) if gain > 0.0]
    return {"gain": float(np.median(gains))} if gains else {}


def _most_finely_sampled(records: Sequence[Record]) -> list[Record]:
    """The records sampled most finely: a slow record of creep does not show how the platform rings."""
    finest = min(map(interval_of, records), default=0.0)
    return [record for record in records if interval_of(record) < 2.0 * finest]


def _medians(found: Sequence[Mapping[str, float]]) -> dict[str, float]:
    names = sorted({name for features in found for name in features})
    return {name: float(np.median([features[name] for features in found if name in features])) for name in names}


def _ringing(record: Record) -> dict[str, float]:
    """Ringing of the platform in the whole record; where loops hide it, in the part after the largest voltage jump."""
    volts = voltages(record)
    found, steps = ringing(record.time, record.measured, volts), np.abs(np.diff(volts))
    if found or not steps.size or not np.max(steps) > _JUMP * np.ptp(volts):
        return found
    begin = int(np.argmax(steps))
    for samples in (200, 50):
        after = slice(max(begin - 20, 0), begin + samples)
        if found := ringing(record.time[after], record.measured[after], volts[after]):
            # The gain is that of whole loops, not of one jump.
            return found | {"gain": _range_gain(record)}
    return {}


def is_step(record: Record) -> bool:
    """The voltage goes to one level within the first tenth of the record, and stays there."""
    volts, last = voltages(record), record.time[-1]
    late = volts[record.time > 0.1 * last]
    return bool(late.size and abs(volts[-1]) > 0 and np.all(np.abs(late - volts[-1]) < 0.01 * abs(volts[-1])))


def _range_gain(record: Record) -> float:
    """Gain [m/V] of a platform that hardly rings: the range of its motion over that of the voltage."""
    return float(np.ptp(record.measured) / (np.ptp(voltages(record)) or 1.0))


def _following_gain(record: Record) -> float:
    """Gain [m/V] of an end-effector's motion by the voltage, after a steady walk is removed."""
    design = np.stack([np.ones(record.time.size), record.time - record.time[0], voltages(record)], axis=1)
    return float(scaled_least_squares(design, record.measured)[2])


def _from_step(record: Record) -> dict[str, float]:
    """Gain, natural frequency and damping ratio from the peak and the end of a step response.

    Only the gain where no peak exceeds the noise within half of the record, so that the samples show no ringing.
    """
    time, y = record.time, record.measured
    after = time >= 0
    end = float(np.mean(y[-max(y.size // 5, 1) :]))
    zero, _ = rest_before(time, y)
    found = {"gain": abs(end - zero) / (abs(float(voltages(record)[-1])) or 1.0)}
    rise = (y[after] - zero) / ((end - zero) or 1e-12)
    peak = int(np.argmax(rise))
    delay = max(float(time[after][peak]), interval_of(record))
    visible = rise[peak] - 1.0 > 6.0 * scatter_floor(record.measured) / (abs(end - zero) or 1e-12)
    if not (visible and delay < 0.5 * max(float(time[-1]), interval_of(record))):
        return found
    overshoot = float(np.clip(rise[peak] - 1.0, 1e-3, 0.98))
    damping = overshoot_to_damping(np.log(overshoot))
    return found | {
        "damping_ratio": float(damping),
        "natural_frequency": float(half_period_to_frequency(delay, damping)),
    }


def _flank_gain(record: Record) -> float:
    """Gain of an end-effector that sticks and follows the slow flank: its median slope over the voltage's.

    Slopes are over a quarter of a period, so that noise and rounding matter little and most spans hold no slip.
    """
    flanks, frequency = record.drive and record.drive.flanks(), frequency_of(record)
    assert flanks is not None and frequency is not None
    span = int(np.clip(0.25 / frequency / interval_of(record), 1, record.time.size - 1))
    rise = record.measured[span:] - record.measured[:-span]
    return abs(float(np.median(rise / (record.time[span:] - record.time[:-span])))) / abs(float(flanks.slope))


def sticking_parts(record: Record) -> list[slice]:
    """Samples during which an end-effector is likely to stick: the later halves of flanks slower than those between.

    None where the voltage rises as fast as it falls.
    """
    volts = voltages(record)[:_MOST_SAMPLES]
    turns = np.array(_turning_points(volts, 0.5 * float(np.ptp(volts))), int)
    lasts = np.diff(record.time[turns])
    slow = lasts > 0.5 * np.max(lasts, initial=0.0)
    if not lasts[slow].sum() > 0.7 * lasts.sum():
        return []
    halves = [slice((begin + end + 1) // 2, end) for begin, end in zip(turns[:-1][slow], turns[1:][slow], strict=True)]
    return [half for half in halves if half.stop - half.start >= _LEAST_OF_FLANK][:_MOST_FLANKS]


def _turning_points(volts: Float[np.ndarray, " n"], swing: float) -> list[int]:
    """Samples at which a voltage turns round, after and before changes of more than a `swing` [V]."""
    turns, extreme, rises = list[int](), 0, None
    for i, level in enumerate(volts):
        further = level - volts[extreme]
        if rises is None or (further > 0.0) == rises:
            if rises is None and abs(further) > swing:
                rises = bool(further > 0.0)
            if rises is not None:
                extreme = i
        elif abs(further) > swing:
            turns.append(extreme)
            extreme, rises = i, not rises
    return turns


def _sticking_gains(record: Record) -> list[float]:
    """Gains [m/V] of an end-effector in the parts of a record in which it is likely to stick."""
    volts = voltages(record)
    slopes = [float(np.polyfit(volts[part], record.measured[part], 1)[0]) for part in sticking_parts(record)]
    return [slope for slope in slopes if slope > 0.0]


def stop_stiffness(record: Record, gain: float) -> float:
    """Stiffness of a stop [N/m] that the platform presses while the contact sticks; 0 without a push.

    By the steepest tenth of the rises within a tenth of a period: in the others the contact slides, or the
    end-effector has not yet reached the stop.
    """
    frequency = frequency_of(record)
    if not frequency or record.time.size < 8:
        return 0.0
    span = int(np.clip(0.1 / frequency / interval_of(record), 1, record.time.size // 2))
    raised, pushed = (values[span:] - values[:-span] for values in (voltages(record), record.measured))
    usual = float(np.percentile(raised, 75.0))
    rises = raised > 0.5 * usual
    steep = float(np.percentile(pushed[rises] / raised[rises], 90.0)) if usual > 0 else 0.0
    return max(steep, 0.0) / gain


def peak_bend(record: Record, rate: float, known: Mapping[str, float]) -> float:
    """The peak of u'' [V/s2] as a platform of the frequency `rate` [rad/s] feels it; 0 without a drive.

    The second difference of the voltage over 1/rate gives rate^2 times a jump, rate times a change of
    slope, and u'' of what is smooth.
    """
    if record.drive is None:
        return 0.0
    drive = drive_with(record, known)
    frequency = frequency_of(record)
    last = 3.0 / frequency if frequency else float(record.time[-1])
    finer = rate * _PER_RESPONSE
    count = min(int(max(last, 0.0) * finer), _MOST_TIMES) + 4 * _PER_RESPONSE
    times = (np.arange(count) - _PER_RESPONSE) / finer
    level = drive.sampled_at(times)
    bend = level[2 * _PER_RESPONSE :] - 2.0 * level[_PER_RESPONSE:-_PER_RESPONSE] + level[: -2 * _PER_RESPONSE]
    return float(np.max(np.abs(bend))) * rate**2


def contact_scale(record: Record, moved: float | None) -> tuple[float, float, float]:
    """Mass [kg], acceleration [m/s2] and rate [rad/s] of an equivalent actuator, the arguments of `search_ranges`.

    A record's force F and stiffness k (the steepest tenth of the loops) determine the middle of the ranges, where an
    actuator's mass m has 0.3 m rate^2 = k and 0.035 m a = F.  The mass is that of an end-effector that is `moved` [kg],
    since its own ringing determines the contact's damping.  Without one the rate is k v/F, at which the contact follows
    the record's speed v.

    The speeds of a friction curve determine the middle instead: a Stribeck velocity amid them is 0.017 a/rate
    (`friction/_search_ranges.py`).
    """
    motion, measured = record.motion, record.measured
    assert motion is not None
    if record.measurement.prescribed == "velocity":
        mass = 1.0 if moved is None else moved
        acceleration = (float(np.median(np.abs(measured))) or 1e-3) / (0.035 * mass)
        speeds = np.abs(motion[motion != 0.0])
        amid = float(np.exp(np.mean(np.log(speeds)))) if speeds.size else 1e-3
        return mass, acceleration, 0.017 * acceleration / amid
    force = 0.5 * float(np.subtract(*np.percentile(measured, [95.0, 5.0]))) or 1e-3
    steps, changes = np.diff(motion), np.diff(measured)
    stroke = float(np.ptp(motion)) or 1e-6
    moves = np.abs(steps) > 1e-4 * stroke
    slopes = (changes[moves] / steps[moves]) if moves.any() else np.zeros(1)
    stiffness = max(float(np.percentile(slopes, 90.0)), force / stroke)
    speed = float(np.median(np.abs(steps[moves] / np.diff(record.time)[moves]))) if moves.any() else stroke
    mass = stiffness / (0.3 * (stiffness * speed / force) ** 2) if moved is None else moved
    return mass, force / (0.035 * mass), float(np.sqrt(stiffness / (0.3 * mass)))


def frequency_of(record: Record) -> float | None:
    """Frequency of a drive that repeats, held or not [Hz]."""
    frequency = None if record.drive is None else record.drive.cycle_frequency()
    return None if frequency is None else float(frequency)


def interval_of(record: Record) -> float:
    """Interval between samples [s]."""
    return float(np.median(np.diff(record.time)))


def swing_of(record: Record) -> float:
    """Difference of the highest and the lowest voltage of a record's drive [V], the 0 V before it counted."""
    return float(np.ptp(np.append(voltages(record), 0.0)))


def noise_of(record: Record) -> float:
    """The noise of a record: as given, else as neighbouring samples scatter."""
    return scatter_floor(record.measured) if record.noise is None else record.noise


def voltages(record: Record) -> Float[np.ndarray, " n"]:
    """The voltage at the samples [V]; 0 where none is applied."""
    return np.zeros(record.time.size) if record.drive is None else record.drive.sampled_at(record.time)


_DAMPING = (0.02, 0.1, 0.4)
"""Damping ratios tried."""

_MOST_SAMPLES = 20_000
"""Largest number of samples used."""


def ringing(
    time: Float[np.ndarray, " n"], motion: Float[np.ndarray, " n"], volts: Float[np.ndarray, " n"]
) -> dict[str, float]:
    """ "gain" [m/V], "natural_frequency" [rad/s] and "damping_ratio" of a platform; empty where no ringing is seen.

    **Arguments:** `motion` [m], up to a constant, and `volts` [V] at increasing `time` [s].
    """
    from scipy.optimize import minimize

    count = min(time.size, _MOST_SAMPLES)
    interval = float(time[count - 1] - time[0]) / max(count - 1, 1)
    even = time[0] + interval * np.arange(count)
    motion, volts = np.interp(even, time, motion), np.interp(even, time, volts)
    left = _MotionResidual(motion, volts, interval)
    # Three cycles in the record, and 0.8 of the Nyquist frequency.
    slowest = 2.0 * math.pi * 3.0 / (interval * count)
    fastest = 0.8 * math.pi / interval
    if count < 16 or slowest >= fastest or np.ptp(volts) == 0.0:
        return {}
    rates = np.geomspace(slowest, fastest, 2 + int(math.log(fastest / slowest) / math.log(1.03)))
    without = min(left.of(volts)[0], *(left.by_lag(rate)[0] for rate in rates))
    _, rate, damping = min((left.by_mode(rate, damping)[0], rate, damping) for rate in rates for damping in _DAMPING)
    refined = minimize(
        lambda x: left.by_mode(*np.exp(x))[0], np.log([rate, damping]), method="Nelder-Mead", options={"maxfev": 200}
    )
    rate, damping = (float(number) for number in np.exp(refined.x))
    least, gain = left.by_mode(rate, damping)
    if not (least < 0.7 * without and gain > 0.0 and slowest <= rate <= fastest):
        return {}
    return {"gain": gain, "natural_frequency": rate, "damping_ratio": damping}


class _MotionResidual:
    """Residual of a motion after a response, a constant, a drift and the decay of ringing from before the record."""

    def __init__(self, motion: Float[np.ndarray, " n"], volts: Float[np.ndarray, " n"], interval: float) -> None:
        self._motion, self._volts, self._interval = motion - motion[0], volts - volts[0], interval
        self._elapsed = interval * np.arange(motion.size)
        self._line = [np.ones(motion.size), np.linspace(-1.0, 1.0, motion.size)]

    def of(self, response: Float[np.ndarray, " n"], *dying: Float[np.ndarray, " n"]) -> tuple[float, float]:
        """The sum of squares [m2], and the gain of the response [m/V]."""
        design = np.stack([response, *self._line, *dying], axis=1)
        numbers = np.linalg.lstsq(design, self._motion, rcond=None)[0]
        return float(np.sum((self._motion - design @ numbers) ** 2)), float(numbers[0])

    def by_lag(self, rate: float) -> tuple[float, float]:
        """Sum of squares [m2] and gain [m/V] by the response of a lag of the time constant 1 / `rate` [s]."""
        return self.of(np.real(self._followed(-rate)) * rate, np.exp(-rate * self._elapsed))

    def by_mode(self, rate: float, damping: float) -> tuple[float, float]:
        """Sum of squares [m2] and gain [m/V] by the response of a mode of frequency `rate` [rad/s]."""
        if not 0.0 < damping < 1.0:
            return math.inf, 0.0
        ring = rate * math.sqrt(1.0 - damping**2)
        pole = complex(-damping * rate, ring)
        dying = np.exp(pole * self._elapsed)
        return self.of(np.imag(self._followed(pole)) * rate**2 / ring, np.real(dying), np.imag(dying))

    def _followed(self, pole: complex) -> Complex[np.ndarray, " n"]:
        """z of z' = pole z + u from rest, exact where u is a straight line between samples."""
        from scipy.signal import lfilter

        step = pole * self._interval
        decay = cmath.exp(step)
        held, ramp = (decay - 1.0) / pole, (decay - 1.0 - step) / (pole * step)
        return np.asarray(lfilter([ramp, held - ramp], [1.0, -decay], self._volts), complex)
