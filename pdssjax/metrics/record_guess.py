"""A guess of a record's description in a study from its samples: drive, clock, measurement, noise."""

import dataclasses
import itertools
import math

import numpy as np

from ..core import LENGTH, VELOCITY, Display, InputError
from .cycle_detection import find_cycles
from .sample_filters import integrated, velocity_zero
from .sensor_samples import Samples, resolution_of, rounding_of_counts, scatter_floor
from .voltage_flanks import frequency_of
from .waveform_detection import detect_waveform, with_drive_start
from .waveform_fits import Waveform

_LEAST_EXPLAINED_WITH_HYSTERESIS = 0.8
"""Least share for a platform with hysteresis, under a voltage without fast flanks, where nothing can slip."""

_ROUNDING = 5e-4
"""Largest relative change by rounding of a frequency found in a motion."""

RUNNING = 2
"""Number of cycles assumed before a record whose drive was running already."""


@dataclasses.dataclass(frozen=True, eq=False)
class RecordGuess:
    """A record as its samples suggest it; SI, on the clock of its file."""

    time: Samples
    """[s]"""
    motion: Samples
    """[m], turned where the sensor counts the other way."""
    volts: Samples | None
    """[V]; None where no voltage was recorded."""
    waveform: Waveform
    start: float
    """When the drive starts [s]: the waveform's start, or some cycles before where it ran before the record."""
    measures: str
    """"platform" or "effector"."""
    noise: float
    """Standard deviation of what was measured [m], of a velocity [m/s]."""
    resolution: float | None
    """Step in which the sensor counts, in the same unit; None where none is seen."""
    turned: bool
    """The motion was turned: it goes against the voltage."""
    hysteresis: float
    """Rms residual of a platform's motion from a straight line of the voltage, in parts of the motion; else NaN."""
    velocity: Samples | None = None
    """Where that was measured [m/s], turned like the motion, to which it adds up; else None."""

    @property
    def display(self) -> Display:
        """Units in which the measured quantity is shown."""
        return LENGTH if self.velocity is None else VELOCITY

    @property
    def motion_noise(self) -> float:
        """Noise that would hide as much of the motion [m] as that of what was measured does."""
        if self.velocity is None:
            return self.noise
        return self.noise * float(np.std(self.motion) / (np.std(self.velocity) or 1.0))


def guess_record(
    time: Samples,
    motion: Samples,
    volts: Samples | None,
    *,
    measures: str = "",
    peak: float | None = None,
    frequency: float | None = None,
    velocity: bool = False,
    where: str = "",
) -> RecordGuess:
    """Guess the record from `motion` [m] (a `velocity` [m/s]) and `volts` [V] at increasing `time` [s].

    **Arguments:** `measures` is "platform" or "effector" where that is known.  Without `volts` a sawtooth of the
    `peak` voltage [V] is looked for in the motion, of the `frequency` [Hz] or the one found.  `where` begins
    messages.

    **Raises:** `InputError` where no cycles are found in a motion without a voltage, where a velocity has none, or
    where what was measured is not clear; `ValueError` where the voltage never changes.
    """
    measured, hysteresis, against = motion, math.nan, False
    if volts is None and velocity:
        raise InputError(f"{where}: found a velocity without a voltage, expected --voltage with the channel of it.")
    if volts is None:
        waveform = _sawtooth_of_motion(time, motion, peak or math.nan, frequency, where)
        part = measures or "effector"
    else:
        waveform = detect_waveform(time, volts)
        if velocity:
            # The zero of the sensor is taken from the record itself.
            early = time - waveform.start if waveform.begins == "seen" else time - time[0]
            held = np.where(early > 0.0, waveform.numbers["voltage"], 0.0) if waveform.name == "step" else volts
            zero = velocity_zero(early, motion, held, returns=True)
            assert zero is not None
            motion = integrated(time, motion - zero)
        straight = np.stack([np.ones(volts.size), volts], axis=1)
        residual = motion - straight @ np.linalg.lstsq(straight, motion, rcond=None)[0]
        explained = 1.0 - float(np.var(residual) / (np.var(motion) or 1.0))
        part = measures or _measured_part(waveform, explained, _has_net_step(time, motion, volts, waveform), where)
        if part == "platform":
            hysteresis = float(np.std(residual) / (np.ptp(motion) or 1.0))
            if waveform.name == "sine" and waveform.begins == "running":
                waveform = _start_with_record(time, motion, waveform)
        if part == "effector" and waveform.has_fast_flanks:
            against = rides_against(time, motion, volts, 1.0 / waveform.numbers["frequency"], waveform.start)
        else:
            against = goes_against(time, motion, volts)
    start = waveform.start
    if waveform.begins == "running" and waveform.name != "sampled":
        start -= RUNNING / waveform.numbers["frequency"]
    return RecordGuess(
        time=time,
        motion=-motion if against else motion,
        volts=volts,
        waveform=waveform,
        start=float(start),
        measures=part,
        noise=max(scatter_floor(measured), rounding_of_counts(measured)),
        resolution=resolution_of(measured),
        turned=against,
        hysteresis=hysteresis,
        velocity=(-measured if against else measured) if velocity else None,
    )


def gain_of(guess: RecordGuess) -> float:
    """Rough gain of the platform [m/V], from its own motion or from that of an end-effector while it sticks.

    NaN without a recorded voltage, and for an end-effector under a voltage that does not repeat.
    """
    if guess.volts is None:
        return math.nan
    if guess.measures == "platform":
        return float(np.ptp(guess.motion) / np.ptp(guess.volts))
    frequency = guess.waveform.numbers.get("frequency") or frequency_of(guess.time, guess.volts)
    if frequency is None:
        return math.nan
    # A quarter of a period later is on the same slow flank, for most samples; plateaus tell nothing.
    quarter = max(1, round(0.25 / frequency / float(np.median(np.diff(guess.time)))))
    motion, volts = (np.abs(c[quarter:] - c[:-quarter]) for c in (guess.motion, guess.volts))
    moves = volts > 0.1 * np.ptp(guess.volts)
    return float(np.median(motion[moves]) / np.median(volts[moves])) if moves.any() else math.nan


def _measured_part(waveform: Waveform, explained: float, walks: bool, where: str) -> str:
    """Tell whether a motion is that of the platform or of the end-effector.

    **Arguments:** `explained` is the share of its variance that the voltage explains, `walks` whether it goes on from
    cycle to cycle.
    """
    # A straight line of the voltage explains nearly all of a platform's motion.
    if waveform.name == "step" or explained > 0.97:
        return "platform"
    if walks and (waveform.has_fast_flanks or explained < _LEAST_EXPLAINED_WITH_HYSTERESIS):
        return "effector"
    if not waveform.has_fast_flanks and explained > _LEAST_EXPLAINED_WITH_HYSTERESIS:
        return "platform"
    raise InputError(
        f"{where}: found a motion of which the voltage ({waveform.name}) explains {100 * max(explained, 0.0):.0f} %, "
        "expected --measures with platform or effector (of this file alone FILE=platform)."
    )


def _has_net_step(time: Samples, motion: Samples, volts: Samples, waveform: Waveform) -> bool:
    """Whether a motion has a net step per cycle besides the part that follows the voltage."""
    frequency = waveform.numbers.get("frequency") or frequency_of(time, volts)
    if frequency is None:
        return False
    design = np.stack([np.ones(time.size), time - time.mean(), volts], axis=1)
    _, speed, follows = np.linalg.lstsq(design, motion, rcond=None)[0]
    net, stroke = abs(speed) / frequency, abs(follows) * np.ptp(volts)
    if waveform.has_fast_flanks:
        return bool(net > 0.02 * stroke)
    # Other voltages are those of platforms more often, whose sensor may drift: not by the same step at every phase.
    later = time + 1.0 / frequency
    within = later <= time[-1]
    if not (within.any() and net > 0.1 * stroke):
        return False
    steps = np.interp(later[within], time, motion) - motion[within]
    return bool(np.median(np.abs(steps - np.median(steps))) < 0.3 * abs(np.median(steps)))


def _start_with_record(time: Samples, motion: Samples, waveform: Waveform) -> Waveform:
    """Let a sine start with the record, at its phase there, if the motion shows that it did not run before.

    Then the first samples differ from those a cycle later, which agree with those of the next cycle.
    """
    frequency = waveform.numbers["frequency"]
    if time[-1] - time[0] < 2.2 / frequency:
        return waveform
    early = time[time < time[0] + 0.05 / frequency]
    cycles = [np.interp(early + cycle / frequency, time, motion) for cycle in range(3)]
    first, later = (float(np.max(np.abs(a - b))) for a, b in itertools.pairwise(cycles))
    if first < max(0.04 * np.ptp(motion), 4.0 * later):
        return waveform
    phase = 2.0 * math.pi * math.remainder((float(time[0]) - waveform.start) * frequency, 1.0)
    return dataclasses.replace(
        waveform, numbers=waveform.numbers | {"phase": phase}, start=float(time[0]), begins="motion"
    )


def _sawtooth_of_motion(time: Samples, motion: Samples, peak: float, frequency: float | None, where: str) -> Waveform:
    """The sawtooth that a walking end-effector shows: it starts a cycle where the end-effector slips."""
    interval = float(np.median(np.diff(time)))
    if frequency is not None and time[-1] - time[0] < 1.5 / frequency:
        # One slip is enough where the frequency is known.
        steepest = int(np.argmax(np.abs(np.diff(motion))))
        falls, slip, left = motion[steepest + 1] > motion[steepest], float(time[steepest]), 1.0
    else:
        cycles = find_cycles(time, motion, frequency, where)
        falls, left = cycles.falls, 1.0 - cycles.fit
        middle = cycles.count // 2
        slip = cycles.start + middle / cycles.slip_frequency
        # The number with the fewest digits within the error.
        tolerance = min(2.0 * cycles.slip_frequency_error, _ROUNDING * cycles.slip_frequency)
        shorter = (float(f"{cycles.slip_frequency:.{digits}g}") for digits in range(1, 12))
        simplest = (number for number in shorter if abs(number - cycles.slip_frequency) <= tolerance)
        frequency = frequency or next(simplest, cycles.slip_frequency)
    numbers = {"voltage": peak, "frequency": frequency}
    direction = "backward" if falls else "forward"
    found = Waveform("sawtooth", numbers, direction, slip, "running", math.sqrt(max(left, 0.0)))
    # The middle of a slip comes some milliseconds after the voltage has fallen.
    return with_drive_start(found, time, None, max(2.0 * interval, 0.02 / frequency))


_SLOW_FLANK = 0.5, 0.95
"""Part of a cycle, from one fast flank to the next, in which the slow flank is evaluated."""


def goes_against(time: Samples, motion: Samples, volts: Samples) -> bool:
    """Whether the `motion` [m] of a platform, or of what follows it, goes against `volts` [V] at `time` [s].

    By their correlation, after a linear detrend in time.
    """
    line = np.stack([np.ones(time.size), time - time.mean()], axis=1)
    x, u = (column - line @ np.linalg.lstsq(line, column, rcond=None)[0] for column in (motion, volts))
    size_x, size_u = float(np.linalg.norm(x)), float(np.linalg.norm(u))
    if size_u <= 1e-6 * np.linalg.norm(volts) or size_x == 0:
        return False
    return float(x @ u) < -0.7 * size_x * size_u


def rides_against(time: Samples, motion: Samples, volts: Samples, period: float, start: float = 0.0) -> bool:
    """Whether an end-effector goes against the voltage late on slow flanks, where it rides on the platform.

    What it does on the fast ones tells nothing: a platform that rings may throw it on as well as back.

    **Arguments:** a fast flank begins every `period` [s] from the `start` [s] on.
    """
    first = math.ceil((time[0] - start) / period - _SLOW_FLANK[0])
    cycles = np.arange(max(first, 0), math.floor((time[-1] - start) / period - _SLOW_FLANK[1]) + 1)
    if not cycles.size:
        return goes_against(time, motion, volts)
    # Samples within: between two of them may lie the fast flank.
    early, late = (start + (cycles + part) * period for part in _SLOW_FLANK)
    firsts, lasts = np.searchsorted(time, early), np.searchsorted(time, late, side="right") - 1
    within = lasts > firsts
    if not within.any():
        return goes_against(time, motion, volts)
    moved, raised = (column[lasts[within]] - column[firsts[within]] for column in (motion, volts))
    return bool(np.mean(moved * raised < 0) > 0.75)
