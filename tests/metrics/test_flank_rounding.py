"""A straight flank and one behind an amplifier are told apart, wherever the samples fall."""

import math

import numpy as np
import pytest

from pdssjax.metrics import Waveform, rounding_of

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
