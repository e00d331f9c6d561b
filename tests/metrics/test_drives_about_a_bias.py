"""A voltage about a bias is found, counted from the level at which it rests or to which it returns."""

import itertools

import numpy as np
import pytest
from marks import slow
from voltages import INTERVAL, SHAPES, check, first_rise, samples, sawtooth

from pdssjax.metrics import detect_waveform, flicker_of

BIASED = ["forward, slow fall", "backward", "cycloid forward", "cycloid backward", "skew triangle", "trapezoid"]


@pytest.mark.parametrize(
    ("name", "low", "voltage"),
    [
        *itertools.product(SHAPES, [0.0], [40.0]),
        *((name, -60.0, 120.0) for name in BIASED),
        *((slow if name != "backward" else pytest.param)(name, 30.0, -100.0) for name in BIASED),
    ],
)
def test_a_drive_is_counted_from_the_level_at_which_it_rests_and_begins_where_it_leaves_it(name, low, voltage):
    kind, direction, shape, numbers = SHAPES[name]
    time, volts = samples(shape, 9.0, voltage, 0.2137, rests=True)
    if direction == "forward":
        volts = np.where((time - 0.2137) * 9.0 < 1.0, voltage * first_rise((time - 0.2137) * 9.0, kind), volts)
    found = detect_waveform(time, low + volts + 0.02 * np.random.default_rng(6).normal(size=time.size))
    check(found, kind, 9.0, voltage, numbers, direction)
    assert found.counted_from == pytest.approx(low, abs=0.01)
    assert found.begins == "seen" and found.start == pytest.approx(0.2137, abs=1.01 * INTERVAL)


@pytest.mark.parametrize(("low", "voltage"), [(-20.0, 120.0), slow(30.0, -100.0)])
@pytest.mark.parametrize("name", BIASED)
def test_a_drive_about_a_bias_that_runs_is_counted_from_its_end_nearer_to_zero(name, low, voltage):
    """Or the other way round, as a sawtooth the other way: both are the same voltage."""
    kind, direction, shape, numbers = SHAPES[name]
    time, volts = samples(shape, 7.3, voltage, 0.0123, first=0.2)
    volts = low + volts + 0.02 * np.random.default_rng(6).normal(size=time.size)
    found = detect_waveform(time, volts)
    if found.numbers["voltage"] * voltage < 0.0:
        other = {"forward": "backward", "backward": "forward", "": ""}[direction]
        assert (found.name, found.direction) == (kind, other)
        assert found.numbers["voltage"] == pytest.approx(-voltage, rel=1e-3)
        assert found.counted_from == pytest.approx(low + voltage, abs=3e-4 * abs(voltage))
        return
    check(found, kind, 7.3, voltage, numbers, direction)
    assert found.numbers["voltage"] == pytest.approx(voltage, rel=1e-3)
    assert found.counted_from == pytest.approx(low, abs=3e-4 * abs(voltage))


def test_a_level_known_to_its_noise_tells_flanks_to_that_over_the_slope():
    time, noise, voltage = INTERVAL * np.arange(5000), 0.5, 60.0
    volts = voltage * sawtooth(np.mod(5.0 * time, 1.0), 2.5e-3, False)
    volts += noise * np.random.default_rng(1).normal(size=time.size)
    (_, alone), (_, biased) = (detect_waveform(time, volts + bias).timing.errors for bias in (0.0, 40.0))
    # The lowest voltage is that of one sample in each of two and a half cycles.
    widened = noise / np.sqrt(2.5) / (voltage * 5.0)
    assert biased == pytest.approx(np.hypot(alone, widened), rel=0.05)


@pytest.mark.parametrize("name", ["cycloid forward", "cycloid backward"])
def test_a_cycloid_that_has_just_begun_is_no_rest(name):
    *_, shape, _ = SHAPES[name]
    time, volts = samples(shape, 7.3, 64.2, -0.003)
    found = detect_waveform(time, volts + 0.02 * np.random.default_rng(6).normal(size=time.size))
    assert (found.name, found.begins) == ("cycloidal", "running")


@pytest.mark.parametrize("name", ["cycloid forward", "cycloid backward"])
def test_a_short_rest_before_a_cycloid_is_one(name):
    """Of a twentieth of a period, in which a cycloid that runs hardly moves."""
    kind, direction, shape, _ = SHAPES[name]
    time, volts = samples(shape, 10.0, 60.0, 0.0, first=-0.005, rests=True)
    if direction == "forward":
        volts = np.where(time < 0.1, 60.0 * first_rise(10.0 * time, kind), volts)
    found = detect_waveform(time + 1.0, volts + 0.02 * np.random.default_rng(6).normal(size=time.size))
    assert (found.name, found.begins) == ("cycloidal", "seen")
    assert found.start == pytest.approx(1.0, abs=INTERVAL)


@pytest.mark.parametrize(("step", "share"), [(0.3, 0.5), (1.0, 0.05), (2.0, 0.3)])
def test_a_converter_that_flickers_by_one_step_hides_neither_a_rest_nor_a_square_wave(step, share):
    time = np.arange(0.0, 2.0, 5e-4)
    flicker = step * (np.random.default_rng(0).random(time.size) < share)
    square = detect_waveform(time, np.where((5.0 * time) % 1.0 < 0.5, 60.0, 20.0) + flicker)
    assert square.name == "trapezoid" and square.begins == "running"
    assert square.numbers["frequency"] == pytest.approx(5.0, rel=1e-4)
    assert square.counted_from == pytest.approx(60.0 + share * step, abs=0.3)
    stairs = np.select([time < 0.1, time < 0.4, time < 0.62, time < 1.1, time < 1.5], [60, 80, 50, 95, 30], 70.0)
    assert detect_waveform(time, stairs + flicker).begins == "held"


def test_the_flicker_of_a_voltage_is_that_of_neighbours_and_not_its_motion():
    time = np.arange(0.0, 2.0, 5e-4)
    smooth = 50.0 * np.sin(2.0 * np.pi * 5.0 * time)
    bit = 0.25 * (np.random.default_rng(1).random(time.size) < 0.02)
    assert flicker_of(smooth) < 0.01 and flicker_of(np.sign(smooth)) == 0.0
    assert flicker_of(np.sign(smooth) + bit) == pytest.approx(0.25)
    noise = np.random.default_rng(2).standard_normal(time.size)
    assert flicker_of(smooth + noise) == pytest.approx(1.7, rel=0.2)
