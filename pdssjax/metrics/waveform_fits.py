"""Fits of single waveforms to samples of a voltage, with residuals and standard errors.

A sawtooth's slow flanks are fitted by u = a + s t - c n, n the number of the cycle, which gives period c/s, voltage
and start far below a sample; triangle and trapezoid are the edges of their flanks, moved until they leave the least.
The slow flanks of a cycloidal end without slope, so that, unlike a sawtooth's, they tell its voltage whatever the fast
ones are.
"""

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np

from .sharpened_flanks import JUMP, SharpFlanks, Timing, levels_of, sharpened_sawtooth, sharpened_step, timing_of
from .voltage_flanks import Samples, VoltageFlanks, fast_flanks, period_of

AT_ZERO = 0.02
"""Largest level that counts as 0 V, as a fraction of the voltage."""


@dataclasses.dataclass(frozen=True)
class Waveform:
    """A drive as a study describes it, in SI, on the clock of the samples."""

    name: str
    """Member of the family of drives; "sampled" where no other explains the samples."""
    numbers: dict[str, float]
    """By field of the drive."""
    direction: str
    """Direction of a sawtooth or a cycloidal, "forward" or "backward"; "" for others."""
    start: float
    """When the drive starts [s]: t = 0 of the study."""
    begins: str
    """"seen": it rests in the record before, at the level it is counted from; "held": of samples, at another voltage;
    "clock": the clock's zero begins a cycle; "running": it ran before;
    "motion": the motion sets in with the record."""
    misfit: float
    """Root mean square residual of the waveform, as a fraction of the voltage."""
    uncertain: tuple[str, ...] = ()
    """Fields that the samples determine only within a bound, in words."""
    timing: Timing | None = None
    """Timing of the fast flanks of a step, a sawtooth or a cycloidal."""
    voltage_error: float = 0.0
    """Standard error of the voltage [V]; of a sawtooth, of what its slow flank would come to in a whole period."""
    frequency_error: float = 0.0
    """Relative standard error of the frequency by the noise."""
    counted_from: float = 0.0
    """Level at which it rests, or to which it returns, in place of 0 V [V]: its voltage is counted from there."""

    @property
    def has_fast_flanks(self) -> bool:
        """Whether a cycle is a slow and a fast flank, as in the drive of a walk."""
        return self.name in ("sawtooth", "cycloidal")


_LONGEST = 0.5
"""Longest fast flank, as a fraction of the period."""

_BESIDE = 1.2
"""Sampling intervals on either side of a jump within which it may lie."""


def fit_cycloidal(time: Samples, volts: Samples, flanks: VoltageFlanks, interval: float) -> Waveform | None:
    """A sawtooth whose slow flanks are cycloids, `volts` [V] at `time` [s]; None where both flanks take about as long.

    Fast flanks are straight lines, or jumps where no sample lies on them.
    """
    from scipy.optimize import least_squares  # takes a while to load

    fast = fast_flanks(flanks)
    if fast is None:
        return None
    ideal = fast.duration < JUMP * interval
    # Before its first fast flank a drive may have been at rest.
    turn = (time - fast.middles[0]) / fast.period
    kept = (turn > 0) & ~(ideal & (np.abs(turn - np.round(turn)) * fast.period < _BESIDE * interval))
    time, volts = time[kept], volts[kept]
    duration = 0.0 if ideal else fast.duration
    begin = float(fast.middles[0]) - 0.5 * duration
    first = np.array([0.0, flanks.extent, begin, fast.period, *([duration] * (not ideal))])
    if time.size < 4 * first.size or turn[-1] < 0.5:
        return None
    voltage_at = _cycloid(time, fast.fall)
    scale = np.array([first[1], first[1], interval, interval, interval])[: first.size]
    solved = least_squares(lambda numbers: voltage_at(numbers) - volts, first, x_scale=scale, method="trf", max_nfev=40)
    left = _rms(solved.fun)
    errors = left * scale * np.linalg.norm(np.linalg.pinv(np.linalg.qr(solved.jac * scale, mode="r")), axis=1)
    level, voltage, start, period = map(float, solved.x[:4])
    duration = 0.0 if ideal else float(solved.x[4])
    if not (voltage > 0 and 0.0 <= duration < _LONGEST * period and abs(level) < AT_ZERO * voltage):
        return None
    _, of_voltage, of_start, of_period = map(float, errors[:4])
    of_duration = math.inf if ideal else float(errors[4])
    sharp = SharpFlanks(voltage, period, start, duration, of_start, of_duration, of_voltage)
    return Waveform(
        "cycloidal",
        {"voltage": voltage, "frequency": 1.0 / period} | ({} if ideal else {"fall_time": duration}),
        "forward" if fast.fall else "backward",
        start,
        "running",
        left / voltage,
        (f"fall_time: below {JUMP * interval:.3g} s",) if ideal else (),
        timing_of(None if ideal else sharp, 0.0, interval),
        of_voltage,
        of_period / period,
        level,
    )


def cycloid_at(time: Samples, found: Waveform) -> Samples:
    """The voltage [V] at `time` [s] of a cycloidal that was found and runs, counted from its level."""
    numbers = [0.0, found.numbers["voltage"], found.start, 1.0 / found.numbers["frequency"]]
    return _cycloid(time, found.direction == "forward")(np.array([*numbers, found.numbers.get("fall_time", 0.0)]))


def _cycloid(time: Samples, fall: bool) -> Callable[[np.ndarray], Samples]:
    """The voltage [V] at `time` [s] as a function of lowest level, height [V], begin of a fast flank, period and,
    unless flanks are jumps, duration of a fast flank [s]."""

    def voltage_at(numbers: np.ndarray) -> Samples:
        lowest, voltage, start, period, *lasts = numbers
        duration = lasts[0] if lasts else 0.0
        phase = np.mod(time - start, period)
        part = (phase - duration) / (period - duration)
        slow = part - np.sin(2.0 * np.pi * part) / (2.0 * np.pi)
        level = np.where(phase < duration, 1.0 - phase / (duration or 1.0), slow)
        return lowest + voltage * (level if fall else 1.0 - level)

    return voltage_at


LOCATED = 0.1
"""Sampling intervals from the clock's zero up to which a start that samples on a flank locate is taken to be there."""


def fit_step(time: Samples, volts: Samples, flanks: VoltageFlanks, interval: float, zero: float) -> Waveform:
    """A step, which may start at the `zero` of its clock."""
    middle = flanks.rises[0]
    late = volts[time > middle + 0.6 * flanks.rise]
    voltage = float(np.median(late)) if late.size else float(volts[-1])
    # That of a median of normal numbers.
    error = 1.25 * float(np.std(late)) / math.sqrt(late.size) if late.size else 0.0
    rise = flanks.rise
    sharp = sharpened_step(time, volts, (voltage, middle - 0.5 * rise, rise), interval)
    ideal = sharp is None and rise < JUMP * interval
    if sharp is not None:
        voltage, start, rise, error = sharp.voltage, sharp.start, sharp.duration, sharp.voltage_error
        voltage_at = voltage * np.clip((time - start) / rise, 0.0, 1.0)
    elif ideal:
        start = float(time[np.searchsorted(time, middle)])
        before = start - interval
        start = zero if before <= zero <= start else start
        voltage_at = np.where(time >= start - 1e-9 * interval, voltage, 0.0)
    else:
        start = middle - 0.5 * rise
        start = zero if abs(start - zero) < LOCATED * interval else start
        voltage_at = voltage * np.clip((time - start) / rise, 0.0, 1.0)
    near = np.abs(time - middle) <= 1.5 * interval
    # A ramp that never comes to rest is no step.
    misfit = _rms((volts - voltage_at)[~near]) / abs(voltage) if late.size >= max(4, volts.size // 20) else math.inf
    numbers = {"voltage": voltage} | ({} if ideal else {"rise_time": rise})
    bound = (f"rise_time: below {JUMP * interval:.3g} s; start: within {interval:.3g} s",) if ideal else ()
    timing = timing_of(sharp, 0.0 if ideal else rise, interval)
    return Waveform("step", numbers, "", start, "seen", misfit, bound, timing, error)


def _spread(design: Samples, gradient: Sequence[float]) -> float:
    """Standard error of a number by its `gradient` in the coefficients of least squares, for samples with error 1."""
    sizes = np.linalg.norm(design, axis=0)
    _, triangle = np.linalg.qr(design / sizes)
    return float(np.linalg.norm(np.linalg.solve(triangle.T, np.asarray(gradient) / sizes)))


def _rms(values: Samples) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else math.inf


def fit_sawtooth(time: Samples, volts: Samples, flanks: VoltageFlanks, interval: float) -> Waveform | None:
    """A sawtooth, by a line through its slow flanks; None where both flanks take about as long."""
    sides = fast_flanks(flanks)
    if sides is None:
        return None
    forward, fast, middles, period = sides
    seen, ideal = fast, fast < JUMP * interval
    fast = 0.0 if ideal else fast
    # Samples away from the fast flanks.
    turn = (time - middles[0]) / period
    slow = np.abs(turn - np.round(turn)) > 0.5 * fast / period + 1.2 * interval / period
    at_rest = slow & (np.abs(volts) <= 1e-3 * np.max(volts)) & (time < middles[0])
    # The first slow flank of a drive that starts from rest may differ from the others.
    kept = slow & (time > middles[0]) if len(middles) >= 2 else slow & ~at_rest
    design = np.stack([np.ones(time.size), time, -np.floor(turn)], axis=1)[kept]
    if np.linalg.matrix_rank(design) < 3:
        return None
    a, slope, drop = map(float, np.linalg.lstsq(design, volts[kept], rcond=None)[0])
    if slope == 0 or drop / slope <= 0:
        return None
    period = drop / slope
    voltage = abs(slope) * (period - fast)
    # The slow flank numbered 0 begins at 0 V forward, backward at the peak, right after the fast one.
    start = -a / slope - fast if forward else (voltage - a) / slope - fast
    left = _rms(volts[kept] - design @ np.array([a, slope, drop]))
    misfit, error = left / voltage, left * _spread(design, [0.0, 0.0, 1.0])
    of_frequency = left * _spread(design, [0.0, -1.0 / slope, 1.0 / drop])
    # Where the lowest level is not 0 V, the line does not meet the fast flanks.
    late = start + 0.5 * fast - (middles - period * np.arange(len(middles)))
    if abs(late[0]) > 1.5 * interval + AT_ZERO * period:
        return None
    lowest = -slope * float(np.mean(late))
    all_cycles = kept | (~slow & (time > middles[0] + 0.5 * period))
    sharp = sharpened_sawtooth(time[all_cycles], volts[all_cycles], forward, (voltage, period, start), seen, interval)
    if sharp is not None:
        voltage, period, start, fast = sharp[:4]
        ideal, error = False, sharp.voltage_error
        shape = levels_of(time, forward, np.array([voltage / (1.0 - fast / period), period, start, fast]))[all_cycles]
        lowest = float(np.polyfit(shape, volts[all_cycles], 1)[1])
    numbers = {"voltage": voltage, "frequency": 1.0 / period} | ({} if ideal else {"fall_time": fast})
    open_part = f"which leaves {100 * JUMP * interval / period:.2g} % of the voltage open"
    bound = (f"fall_time: below {JUMP * interval:.3g} s, {open_part}",) if ideal else ()
    timing = timing_of(sharp, 0.0 if ideal else fast, interval)
    direction = "forward" if forward else "backward"
    return Waveform(
        "sawtooth", numbers, direction, start, "running", misfit, bound, timing, error, of_frequency, lowest
    )


def fit_triangle(time: Samples, volts: Samples, flanks: VoltageFlanks, interval: float) -> Waveform | None:
    """A triangle, as steep either way or not; None without a period."""
    period = period_of(flanks)
    if period is None or not 0 < flanks.rise < period:
        return None
    symmetry = flanks.rise / (flanks.rise + flanks.fall)
    shape = lambda phase: np.where(phase < symmetry, phase / symmetry, (1.0 - phase) / (1.0 - symmetry))
    start = float(flanks.rises[0]) - 0.5 * symmetry * period
    numbers = {} if abs(symmetry - 0.5) < 0.01 else {"symmetry": symmetry}
    return _place_waveform(time, volts, "triangle", numbers, period, start, shape, 0.0)


def fit_trapezoid(time: Samples, volts: Samples, flanks: VoltageFlanks, interval: float) -> Waveform | None:
    """A trapezoid, by its flanks; None without a period or a plateau."""
    if (found := _trapezoid_by(time, volts, flanks, interval)) is None:
        return None
    # On plateaus noise widens the extremes, and with them the flanks.
    share = found.numbers["voltage"] / flanks.extent
    narrower = dataclasses.replace(flanks, rise=share * flanks.rise, fall=share * flanks.fall)
    return _trapezoid_by(time, volts, narrower, interval)


def _trapezoid_by(time: Samples, volts: Samples, flanks: VoltageFlanks, interval: float) -> Waveform | None:
    period = period_of(flanks)
    if period is None:
        return None
    rise, fall = (0.0 if length < JUMP * interval else length for length in (flanks.rise, flanks.fall))
    start = float(flanks.rises[0]) - 0.5 * rise
    after = flanks.falls[flanks.falls > flanks.rises[0]]
    if not after.size:
        return None
    width = (float(after[0]) - 0.5 * fall - start) / period
    if not rise / period < width < 1.0 - fall / period:
        return None
    up, down = rise / period, fall / period

    def shape(phase: Samples) -> Samples:
        risen = np.clip(phase / up, 0.0, 1.0) if up else np.ones(phase.size)
        fallen = np.clip((phase - width) / down, 0.0, 1.0) if down else (phase >= width) * 1.0
        return risen - fallen

    numbers = {"width": width} | ({"rise_time": rise} if rise else {}) | ({"fall_time": fall} if fall else {})
    found = _place_waveform(time, volts, "trapezoid", numbers, period, start, shape, 1.2 * interval / period, width)
    if found is None or rise or fall:
        return found
    # Jumps are located to a sample, and nothing between them tells more.
    cycles = max(len(flanks.rises), len(flanks.falls)) - 1
    return dataclasses.replace(found, uncertain=(f"frequency: within {100 * interval / (cycles * period):.2g} %",))


def _place_waveform(
    time: Samples,
    volts: Samples,
    name: str,
    numbers: dict[str, float],
    period: float,
    start: float,
    shape: Callable[[Samples], Samples],
    margin: float,
    edge: float = 0.0,
) -> Waveform | None:
    """A waveform between 0 V and its voltage, of the given `shape` of the phase; samples near an edge do not count.

    Where it has no jumps (no `margin`), start and period are those of least squares.
    """
    of_frequency = 0.0
    if margin == 0.0:
        start, period, of_frequency = _refine_timing(time, volts, period, start, shape)
    phase = np.mod((time - start) / period, 1.0)
    apart = lambda place: np.abs(np.mod(phase - place + 0.5, 1.0) - 0.5)
    kept = (apart(0.0) >= margin) & (apart(edge) >= margin) & (time >= start)
    level = shape(phase)[kept]
    if level.size < 8:
        return None
    (base, voltage), *_ = np.linalg.lstsq(np.stack([np.ones(level.size), level], axis=1), volts[kept], rcond=None)
    if voltage <= 0 or abs(base) > AT_ZERO * voltage:
        return None
    left = _rms(volts[kept] - voltage * level)
    numbers = {"voltage": float(voltage), "frequency": 1.0 / period, **numbers}
    error = left / math.sqrt(level.size * float(np.var(level)))
    return Waveform(
        name, numbers, "", start, "running", left / voltage,
        voltage_error=error, frequency_error=of_frequency, counted_from=float(base),
    )  # fmt: skip


def _refine_timing(
    time: Samples, volts: Samples, period: float, start: float, shape: Callable[[Samples], Samples]
) -> tuple[float, float, float]:
    """Start and period of a waveform without jumps, by two steps of Gauss and Newton; the period's relative error."""
    from_rest = time >= start
    time, volts = time[from_rest], volts[from_rest]
    level = lambda begin, length: shape(np.mod((time - begin) / length, 1.0))
    error = math.inf
    for _ in range(2):
        here, step = level(start, period), 1e-4 * period
        by_start = (level(start + step, period) - level(start - step, period)) / (2.0 * step)
        by_period = (level(start, period + 1e-2 * step) - level(start, period - 1e-2 * step)) / (2e-2 * step)
        height = float(here @ volts / (here @ here))
        design = np.stack([here, height * by_start, height * by_period], axis=1)
        found = np.linalg.lstsq(design, volts - height * here, rcond=None)[0]
        _, later, longer = found
        if not (abs(later) < 0.05 * period and abs(longer) < 0.05 * period):
            break
        start, period = start + float(later), period + float(longer)
        left = _rms(volts - height * here - design @ found)
        error = left * _spread(design, [0.0, 0.0, 1.0]) / period
    return start, period, error


def fit_sine(time: Samples, volts: Samples, flanks: VoltageFlanks, interval: float) -> Waveform | None:
    """A sine above its lowest voltage; None without a period."""
    period = period_of(flanks)
    if period is None:
        return None
    rate, kept = 2.0 * np.pi / period, time >= flanks.rises[0] - 0.25 * period
    moved, volts = time[kept] - time[0], volts[kept]

    def amplitudes(rate: float) -> tuple[Samples, Samples]:
        """Level, cosine and sine, and the waves with the derivative by the rate as the fourth."""
        waves = np.stack([np.ones(moved.size), np.cos(rate * moved), np.sin(rate * moved)], axis=1)
        found = np.linalg.lstsq(waves, volts, rcond=None)[0]
        return found, np.column_stack([waves, moved * (found[2] * waves[:, 1] - found[1] * waves[:, 2])])

    for _ in range(6):
        rate += np.linalg.lstsq(amplitudes(rate)[1], volts, rcond=None)[0][3]
    (level, cosine, sine), joined = amplitudes(rate)
    amplitude = math.hypot(cosine, sine)
    left = _rms(volts - joined[:, :3] @ np.array([level, cosine, sine]))
    error = 2.0 * left * math.sqrt(2.0 / moved.size)
    of_frequency = left * _spread(joined, [0.0, 0.0, 0.0, 1.0]) / rate
    bias = level - amplitude
    # Lowest where the cosine of the wave's turn is -1.
    start = float(time[0]) + (math.atan2(sine, cosine) + math.pi) / rate
    numbers = {"voltage": 2.0 * amplitude, "frequency": rate / (2.0 * math.pi)}
    numbers |= {} if abs(bias) < AT_ZERO * amplitude else {"bias": bias}
    return Waveform(
        "sine", numbers, "", start, "running", left / (2.0 * amplitude),
        voltage_error=error, frequency_error=of_frequency,
    )  # fmt: skip


FITS = (fit_sawtooth, fit_triangle, fit_sine, fit_trapezoid, fit_cycloidal)
"""Fits of the drives that repeat, the simpler ones first."""
