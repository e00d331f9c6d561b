"""Waveforms as segments of the commanded voltage, on each of which it is a line and a harmonic."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

LAST = 1e9
"""End [s] of a segment that lasts as long as anybody looks."""


@dataclasses.dataclass(frozen=True)
class Segment:
    """u = start + slope s + amplitude cos(rate s + phase) [V] with s = t - begin, for begin <= t < end [s]."""

    begin: float
    end: float
    start: float
    slope: float
    amplitude: float = 0.0
    rate: float = 0.0
    phase: float = 0.0

    def at(self, t: float) -> float:
        """The voltage [V] at a time [s]."""
        s = t - self.begin
        return self.start + self.slope * s + self.amplitude * math.cos(self.rate * s + self.phase)


def cycles(period: float, until: float) -> range:
    """The cycles that begin before `until` [s], and perhaps one more."""
    return range(int(until / period) + 1)


def flanks(numbers: dict[str, Any], until: float, rounded: bool) -> list[Segment]:
    """A fast flank, then a slow one, a line or (rounded) a cycloid; forward, the first cycle has the slow one only."""
    period, peak = 1.0 / numbers["frequency"], numbers["voltage"]
    forward = numbers.get("direction", 1.0) > 0
    fast = numbers["fall_time"] + (0.0 if rounded else (1.0 - numbers.get("duty", 1.0)) * period)
    if numbers.get("told_by", 0.0):
        # By the slope of the slow flank: what that would come to in a whole period.
        peak = peak * (period - fast) / period
    high, low = (peak, 0.0) if forward else (0.0, peak)
    segments, k = [], 0
    while k * period < until:
        lasts = 0.0 if forward and k == 0 else fast
        if lasts > 0:
            segments.append(Segment(k * period, k * period + lasts, high, (low - high) / lasts))
        slow = period - lasts
        amplitude = (high - low) / (2 * math.pi) if rounded else 0.0
        rate = 2 * math.pi / slow if amplitude else 0.0
        line = low, (high - low) / slow
        segments.append(Segment(k * period + lasts, (k + 1) * period, *line, amplitude, rate, math.pi / 2))
        k += 1
    return segments


def sawtooth(numbers: dict[str, Any], until: float) -> list[Segment]:
    """Straight flanks; the fast one lasts a fall time and what the duty leaves of the period."""
    return flanks(numbers, until, rounded=False)


def cycloidal(numbers: dict[str, Any], until: float) -> list[Segment]:
    """A slow flank that begins and ends with no slope, V (s/T - sin(2 pi s/T) / (2 pi))."""
    return flanks(numbers, until, rounded=True)


def triangle(numbers: dict[str, Any], until: float) -> list[Segment]:
    """Up within a share of the period, its symmetry, and down."""
    period = 1.0 / numbers["frequency"]
    peak, rising = numbers["voltage"], numbers["symmetry"]
    segments = []
    for k in cycles(period, until):
        top = k * period + rising * period
        segments.append(Segment(k * period, top, 0.0, peak / (rising * period)))
        segments.append(Segment(top, (k + 1) * period, peak, -peak / ((1 - rising) * period)))
    return segments


def trapezoid(numbers: dict[str, Any], until: float) -> list[Segment]:
    """Pulses whose width, with the rise, is a share of the period."""
    period, peak, width = 1.0 / numbers["frequency"], numbers["voltage"], numbers["width"]
    rise, fall = numbers["rise_time"], numbers["fall_time"]
    segments = []
    for k in cycles(period, until):
        begin, falls = k * period, k * period + width * period
        if rise > 0:
            segments.append(Segment(begin, begin + rise, 0.0, peak / rise))
        segments.append(Segment(begin + rise, falls, peak, 0.0))
        if fall > 0:
            segments.append(Segment(falls, falls + fall, peak, -peak / fall))
        segments.append(Segment(falls + fall, (k + 1) * period, 0.0, 0.0))
    return segments


def sine(numbers: dict[str, Any], until: float) -> list[Segment]:
    """bias + V/2 (1 - cos(2 pi f t + phase)); it begins with a jump unless bias and phase are 0."""
    peak, frequency = numbers["voltage"], numbers["frequency"]
    period, middle = 1.0 / frequency, numbers.get("bias", 0.0) + peak / 2
    wave = middle, 0.0, -peak / 2, 2 * math.pi * frequency, numbers.get("phase", 0.0)
    return [Segment(k * period, (k + 1) * period, *wave) for k in cycles(period, until)]


def step(numbers: dict[str, Any], until: float) -> list[Segment]:
    """Up within a rise time, and there it stays."""
    peak, rise = numbers["voltage"], numbers["rise_time"]
    up = [Segment(0.0, rise, 0.0, peak / rise)] if rise > 0 else []
    return [*up, Segment(rise, LAST, peak, 0.0)]


def sampled(numbers: dict[str, Any], until: float) -> list[Segment]:
    """Samples joined by lines (interpolation 1) or each held up to the next (0)."""
    times, voltages, lines = numbers["times"], numbers["voltages"], numbers["interpolation"]
    segments = [Segment(0.0, times[0], voltages[0], 0.0)] if times[0] > 0 else []
    for i in range(len(times) - 1):
        slope = lines * (voltages[i + 1] - voltages[i]) / (times[i + 1] - times[i])
        segments.append(Segment(times[i], times[i + 1], voltages[i], slope))
    return [*segments, Segment(times[-1], LAST, voltages[-1], 0.0)]


def zero_order_hold(numbers: dict[str, Any], until: float) -> list[Segment]:
    """A converter's staircase on another waveform, `base` = (kind, numbers)."""
    interval = numbers["interval"]
    held = segments_of(*numbers["base"], until + interval)
    segments = []
    for i in cycles(interval, until):
        # A little inside: at a corner of the waveform, rounding would choose the side.
        at = (i + 1e-6) * interval
        segment = next(s for s in reversed(held) if at >= s.begin)
        segments.append(Segment(i * interval, (i + 1) * interval, segment.at(at), 0.0))
    return segments


WAVEFORMS: dict[str, Callable[[dict[str, Any], float], list[Segment]]] = {
    "Sawtooth": sawtooth,
    "Cycloidal": cycloidal,
    "Triangle": triangle,
    "Trapezoid": trapezoid,
    "Sine": sine,
    "Step": step,
    "Sampled": sampled,
    "ZeroOrderHold": zero_order_hold,
}


def segments_of(kind: str, numbers: dict[str, Any], until: float) -> list[Segment]:
    """The segments of a waveform that begin before `until` [s], the last of them cut there."""
    segments = [s for s in WAVEFORMS[kind](numbers, until) if s.begin < until]
    return [dataclasses.replace(s, end=min(s.end, until)) for s in segments]
