"""Flanks of a sawtooth: straight ones and rounded ones told apart, and their derivatives against differences."""

import math

import numpy as np
import pytest

from pdssjax.metrics import Waveform, rounding_of
from pdssjax.metrics.sharpened_flanks import levels_of, line_of, slopes_of_levels, slopes_of_line

INTERVAL = 1e-5


def shapes(time, duration):
    """From 0 to 1 at t = 0: within a duration, and behind an amplifier whose rise from 10 to 90 % takes as long."""
    return {
        "straight": np.clip(time / duration, 0.0, 1.0),
        "rounded": 1.0 - np.exp(-np.log(9.0) * np.maximum(time, 0.0) / duration),
    }


def found(name, direction, voltage):
    return Waveform(name, {"voltage": voltage}, direction, 0.0, "seen", 0.0)


@pytest.mark.parametrize("voltage", [50.0, -30.0])
@pytest.mark.parametrize("intervals", [4.0, 6.0, 12.0])
def test_a_rise_behind_an_amplifier_takes_longer_for_its_second_half(intervals, voltage):
    random = np.random.default_rng(8)
    for shift in random.uniform(0.0, INTERVAL, 40):
        time = np.arange(-50, 200) * INTERVAL
        for name, level in shapes(time - shift, intervals * INTERVAL).items():
            volts = voltage * (level + 0.003 * random.normal(size=time.size))
            ratio = rounding_of(time, volts, found("step", "", voltage))
            assert (0.85 < ratio < 1.2) if name == "straight" else (1.9 < ratio < 3.0), (name, shift)


def test_falls_of_a_sawtooth_are_judged_not_its_slow_flanks():
    time = np.arange(-50, 2000) * INTERVAL
    phase = np.mod(time, 5e-3)
    for name, expected in (("straight", 1.0), ("rounded", 2.7)):
        level = np.where(time < 5e-3, time / 5e-3, (phase / 5e-3) + 1.0 - shapes(phase, 1e-4)[name])
        ratio = rounding_of(time, 40.0 * np.where(time < 0.0, 0.0, level), found("sawtooth", "forward", 40.0))
        assert ratio == pytest.approx(expected, rel=0.2), name


def test_a_jump_between_two_samples_and_other_waveforms_tell_nothing():
    time = np.arange(-50, 200) * INTERVAL
    assert math.isnan(rounding_of(time, 40.0 * (time > 0.0), found("step", "", 40.0)))
    assert math.isnan(rounding_of(time, np.sin(1e3 * time), found("sine", "", 1.0)))


NUMBERS = np.array([60.0, 0.13, 0.021, 0.013])
STEPS = 1e-6 * NUMBERS
TIME = np.linspace(-0.2, 1.0, 61)


def differences(function):
    steps = np.diag(STEPS)
    columns = [
        (function(NUMBERS + step) - function(NUMBERS - step)) / (2.0 * size)
        for step, size in zip(steps, STEPS, strict=True)
    ]
    return np.stack(columns, axis=1)


@pytest.mark.parametrize("forward", [True, False])
def test_derivatives_are_those_of_differences(forward):
    turn = np.mod(TIME - NUMBERS[2], NUMBERS[1])
    at_a_corner = np.minimum(turn, np.abs(turn - NUMBERS[3])) < 1e-4
    assert not np.any(at_a_corner) and np.any(turn < NUMBERS[3])
    levels = lambda numbers: levels_of(TIME, forward, numbers)
    line = lambda numbers: line_of(numbers, forward)
    for slopes, function in (
        (slopes_of_levels(TIME, forward, NUMBERS), levels),
        (slopes_of_line(NUMBERS, forward), line),
    ):
        expected = differences(function)
        np.testing.assert_allclose(slopes, expected, rtol=1e-6, atol=1e-7 * np.max(np.abs(expected)))


@pytest.mark.parametrize("forward", [True, False])
def test_slow_flanks_lie_on_their_line(forward):
    a, slope, drop = line_of(NUMBERS, forward)
    _, period, start, duration = NUMBERS
    turn = (TIME - start) / period
    slow = np.mod(turn, 1.0) > duration / period
    on_line = a + slope * TIME - drop * np.floor(turn)
    np.testing.assert_allclose(levels_of(TIME, forward, NUMBERS)[slow], on_line[slow], atol=1e-9)
