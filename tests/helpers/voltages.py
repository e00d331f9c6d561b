"""Samples of drives, made from what they are said to be, and the check that the same is found in them."""

import numpy as np
import pytest

INTERVAL = 1e-4


def sawtooth(phase, fall, forward):
    """Between 0 and 1, of the phase from the begin of the fast flank on; `fall` in periods."""
    slow = (phase - fall) / (1.0 - fall)
    level = np.where(phase < fall, 1.0 - phase / (fall or 1.0), slow)
    return level if forward else 1.0 - level


def cycloidal(phase, fall, forward):
    """The same with a slow flank that begins and ends without slope."""
    slow = (phase - fall) / (1.0 - fall)
    level = np.where(phase < fall, 1.0 - phase / (fall or 1.0), slow - np.sin(2.0 * np.pi * slow) / (2.0 * np.pi))
    return level if forward else 1.0 - level


def trapezoid(phase, width, rise, fall):
    up = np.clip(phase / rise, 0.0, 1.0) if rise else np.ones_like(phase)
    down = np.clip((phase - width) / fall, 0.0, 1.0) if fall else (phase >= width) * 1.0
    return up - down


def triangle(phase, symmetry):
    return np.where(phase < symmetry, phase / symmetry, (1.0 - phase) / (1.0 - symmetry))


SHAPES = {
    "forward": ("sawtooth", "forward", lambda p: sawtooth(p, 0.0, True), {}),
    "backward": ("sawtooth", "backward", lambda p: sawtooth(p, 0.0, False), {}),
    "forward, slow fall": ("sawtooth", "forward", lambda p: sawtooth(p, 0.05, True), {"fall_time": 0.05}),
    "backward, slow rise": ("sawtooth", "backward", lambda p: sawtooth(p, 0.05, False), {"fall_time": 0.05}),
    "cycloid forward": ("cycloidal", "forward", lambda p: cycloidal(p, 0.0, True), {}),
    "cycloid backward": ("cycloidal", "backward", lambda p: cycloidal(p, 0.05, False), {"fall_time": 0.05}),
    "triangle": ("triangle", "", lambda p: triangle(p, 0.5), {}),
    "skew triangle": ("triangle", "", lambda p: triangle(p, 0.35), {"symmetry": 0.35}),
    "sine": ("sine", "", lambda p: 0.5 - 0.5 * np.cos(2 * np.pi * p), {}),
    "square": ("trapezoid", "", lambda p: trapezoid(p, 0.4, 0.0, 0.0), {"width": 0.4}),
    "trapezoid": (
        "trapezoid",
        "",
        lambda p: trapezoid(p, 0.5, 0.1, 0.05),
        {"width": 0.5, "rise_time": 0.1, "fall_time": 0.05},
    ),
}
"""By name: kind, direction, level by phase, other numbers (lengths in periods)."""


def samples(shape, frequency, voltage, start, noise=0.0, first=0.0, length=1.0, rests=False):
    """Samples of a drive that starts at `start`, at rest before where it `rests`, else running."""
    time = first + INTERVAL * np.arange(round(length / INTERVAL))
    turn = (time - start) * frequency
    volts = voltage * shape(np.mod(turn, 1.0))
    if rests:
        volts = np.where(turn < 0, 0.0, volts)
    return time, volts + noise * np.random.default_rng(4).normal(size=time.size)


def first_rise(turn, kind):
    """Of a drive forward from rest, which has no fast flank before it."""
    part = np.clip(turn, 0.0, 1.0)
    return cycloidal(part, 0.0, True) if kind == "cycloidal" else part


def check(found, kind, frequency, voltage, numbers, direction):
    assert (found.name, found.direction) == (kind, direction)
    assert found.numbers["frequency"] == pytest.approx(frequency, rel=1e-3)
    assert found.numbers["voltage"] == pytest.approx(voltage, rel=1e-2)
    for field, part in numbers.items():
        if field.endswith("time"):
            assert found.numbers[field] == pytest.approx(part / frequency, abs=INTERVAL)
        else:
            assert found.numbers[field] == pytest.approx(part, rel=0.02)
    assert set(found.numbers) == {"frequency", "voltage", *numbers}
