"""A platform's resonance is read off its motion under any voltage, and none where none is seen."""

import numpy as np
import pytest
from marks import slow
from scipy.signal import lsim

from pdssjax.inference.initial_values.record_features import ringing


def response(time, volts, gain, rate, damping):
    """By SciPy's simulation of the equation of one mode."""
    return lsim(([gain * rate**2], [1.0, 2.0 * damping * rate, rate**2]), volts, time)[1]


def waveform(kind, time, frequency, rng):
    phase = np.mod(frequency * time, 1.0)
    if kind == "square":
        return 60.0 * (phase < 0.5)
    if kind == "sawtooth":
        return 60.0 * phase
    if kind == "steps":
        return 10.0 * np.repeat(rng.integers(0, 8, 16), -(-time.size // 16))[: time.size]
    return 60.0 * np.abs(2.0 * phase - 1.0)


@pytest.mark.parametrize("kind", [slow("square"), "sawtooth", slow("steps"), slow("triangle")])
def test_rings_of_random_platforms_are_found(kind):
    rng = np.random.default_rng(3)
    for _ in range(4):
        rate, damping, gain = 10.0 ** rng.uniform(3.0, 6.0), 10.0 ** rng.uniform(-2.0, -0.5), 1e-7
        time = np.linspace(0.0, 200.0 / rate, 3000)
        # A triangle moves what rings fast by its corners alone, and little.
        frequency = rate / (2.0 * np.pi) / rng.uniform(4.0, 12.0)
        volts = waveform(kind, time, frequency, rng)
        motion = response(time, volts, gain, rate, damping) + 2e-9 * rng.standard_normal(time.size) + 1e-6
        found = ringing(time + 0.3, motion, volts)
        assert found["natural_frequency"] == pytest.approx(rate, rel=0.02)
        assert found["damping_ratio"] == pytest.approx(damping, rel=0.1, abs=2e-3)
        assert found["gain"] == pytest.approx(gain, rel=0.02)


def test_no_ring_is_seen_in_a_slow_one_a_loop_a_drift_or_noise():
    rng, time = np.random.default_rng(4), np.linspace(0.0, 1.0, 4000)
    volts = 60.0 * np.abs(2.0 * np.mod(5.0 * time, 1.0) - 1.0)
    noise = 2e-9 * rng.standard_normal(time.size)
    slow = lsim(([1e-7], [3e-3, 1.0]), volts, time)[1]
    held = [0.0]
    for level in volts[1:]:
        held.append(float(np.clip(held[-1], level - 5.0, level + 5.0)))
    seen = {
        "a slow one": slow + noise,
        "a loop": 1e-7 * np.asarray(held) + noise,
        "a drift": 1e-7 * volts + 1e-6 * time**0.3 + noise,
        "noise": 50.0 * noise,
        "a faster one": response(time, volts - volts[0], 1e-7, 1e5, 0.1) + noise,
    }
    assert {name: ringing(time, motion, volts) for name, motion in seen.items()} == {name: {} for name in seen}


def test_too_few_samples_or_no_voltage_show_no_ring():
    time = np.linspace(0.0, 1.0, 10)
    assert ringing(time, time, time) == {}
    time = np.linspace(0.0, 1.0, 1000)
    assert ringing(time, np.sin(80.0 * time), np.full(1000, 40.0)) == {}
