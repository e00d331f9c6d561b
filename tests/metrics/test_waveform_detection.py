"""The drive that went in is found in samples of its voltage: kind, frequency, voltage, flanks, direction, start."""

import itertools
import re

import jax.numpy as jnp
import numpy as np
import pytest
from marks import slow
from voltages import INTERVAL, SHAPES, check, samples, sawtooth

from pdssjax.drive.sine import Sine
from pdssjax.metrics import detect_waveform, neighbour_scatter, resolution_of, scatter_floor
from pdssjax.metrics.sensor_samples import scatter_between_corners

NOISY, CLEAN = (64.2, 0.005, 7.3), (-30.0, 0.0, 23.0)
"""Voltage, noise and frequency of the drives that the default tests look at, the second of few shapes."""
RUNNING = [
    case if case[1:] == NOISY or case in (("backward", *CLEAN), ("sine", *CLEAN)) else slow(*case)
    for case in itertools.product(SHAPES, (64.2, -30.0), (0.005, 0.0), (7.3, 23.0))
]


@pytest.mark.parametrize(("name", "voltage", "noise", "frequency"), RUNNING)
def test_a_drive_that_runs_is_found(name, voltage, noise, frequency):
    kind, direction, shape, numbers = SHAPES[name]
    start = {7.3: 0.0123, 23.0: 0.0}[frequency]
    time, volts = samples(shape, frequency, voltage, start, noise * abs(voltage), first=0.2)
    found = detect_waveform(time, volts)
    check(found, kind, frequency, voltage, numbers, direction)
    assert found.begins == ("clock" if start == 0.0 else "running")
    late = (found.start - start) * frequency
    assert abs(late - round(late)) < 1.5 * INTERVAL * frequency + (0.01 if kind == "sine" else 0.0) * noise / 0.005
    assert found.start <= time[0] + 1e-9


@pytest.mark.parametrize("forward", [True, False])
@pytest.mark.parametrize(
    ("fall", "interval", "start"),
    [
        (1.5e-4, 1e-4, 33e-6),
        slow(5e-5, 1e-4, 61e-6),
        slow(1.5e-4, 1.03e-4, 33e-6),
        (4e-5, 1.03e-4, 33e-6),
        slow(1e-4, 2e-5, 7e-6),
    ],
)
def test_a_few_samples_on_the_fast_flanks_locate_them(fall, interval, start, forward):
    """Without them the voltage is wrong by the fall time in parts of the period, 0.1 to 0.3 %, and the start by it."""
    time = interval * np.arange(round(-0.01 / interval), round(0.5 / interval))
    level = sawtooth(np.mod(20.0 * (time - start), 1.0), 20.0 * fall, forward)
    first = np.where(20.0 * (time - start) < 1.0, 20.0 * (time - start), level) if forward else level
    noise = 0.03 * np.random.default_rng(5).normal(size=time.size)
    found = detect_waveform(time, 60.0 * np.where(time < start, 0.0, first) + noise)
    assert (found.name, found.begins) == ("sawtooth", "seen")
    assert found.numbers["voltage"] == pytest.approx(60.0, rel=2e-4)
    assert found.numbers["fall_time"] == pytest.approx(fall, abs=0.1 * interval)
    assert found.start == pytest.approx(start, abs=0.1 * interval)


@pytest.mark.slow
def test_errors_hold_all_flanks_that_explain_the_same_samples():
    """Drawn where single samples lie on flanks: the same samples may belong to flanks microseconds apart."""
    off = []
    for seed in range(12):
        random = np.random.default_rng([7, seed])
        interval, fall, noise = random.uniform([3e-5, 2e-5, 0.01], [8e-5, 4e-5, 0.06])
        # A generator set to 10 Hz, by the clock of an instrument that is some 1e-5 fast or slow.
        frequency = 10.0 * (1.0 + 1e-5 * random.uniform(-1.0, 1.0) * (seed % 2))
        start, forward = random.uniform(0.0, 2.0 * interval), bool(seed // 2 % 2)
        time = interval * np.arange(round(-0.005 / interval), round(0.5 / interval))
        turn = frequency * (time - start)
        level = sawtooth(np.mod(turn, 1.0), frequency * fall, forward)
        level = np.where(turn < 0.0, 0.0, np.where((turn < 1.0) & forward, turn, level))
        found = detect_waveform(time, 42.0 * level + noise * random.standard_normal(time.size))
        assert found.numbers["frequency"] == pytest.approx(frequency, rel=2e-5)
        if found.timing.errors is None:
            lasts, error = 0.5 * (found.timing.shortest + found.timing.longest), found.timing.longest
            off.append((lasts - fall) / error)
        else:
            lasts, begins = found.timing.errors
            off += [(found.numbers["fall_time"] - fall) / lasts, (found.start - start) / begins]
    assert len(off) > 12 and np.max(np.abs(off)) < 3.5
    assert np.sqrt(np.mean(np.square(off))) < 1.4


@pytest.mark.parametrize("forward", [True, False])
def test_a_jump_between_samples_has_no_fall_time(forward):
    time = 1e-3 * np.arange(2000)
    volts = 60.0 * sawtooth(np.mod(5.0 * (time - 3.1e-4), 1.0), 0.0, forward)
    found = detect_waveform(time, volts + 0.02 * np.random.default_rng(5).normal(size=time.size))
    assert "fall_time" not in found.numbers
    assert found.uncertain == ("fall_time: below 0.0016 s, which leaves 0.8 % of the voltage open",)


def test_a_ramp_that_is_seen_locates_a_step_beside_the_clocks_zero():
    time = 1e-5 * np.arange(-200, 3000)
    volts = 60.0 * np.clip((time - 3.7e-6) / 40e-6, 0.0, 1.0) + 0.03 * np.random.default_rng(5).normal(size=time.size)
    found = detect_waveform(time, volts)
    assert found.start == pytest.approx(3.7e-6, abs=5e-7)
    assert found.numbers["rise_time"] == pytest.approx(40e-6, rel=0.02)


@pytest.mark.parametrize(
    ("rise", "start", "voltage"), [(0.0, 0.0, 48.2), (0.0, 0.0312, -75.0), (4e-3, 0.0312, 48.2), (4e-3, 0.0, -75.0)]
)
def test_a_step_is_found(rise, start, voltage):
    time = -0.01 + INTERVAL * np.arange(1000)
    ramp = np.clip((time - start) / rise, 0.0, 1.0) if rise else (time >= start - 1e-12) * 1.0
    found = detect_waveform(time, voltage * ramp + 0.02 * np.random.default_rng(1).normal(size=time.size))
    assert found.name == "step" and found.begins == "seen"
    assert found.numbers["voltage"] == pytest.approx(voltage, rel=1e-2)
    assert found.numbers.get("rise_time", 0.0) == pytest.approx(rise, abs=2 * INTERVAL)
    assert found.start == pytest.approx(start, abs=INTERVAL)


def test_what_no_waveform_explains_is_taken_as_it_was_sampled():
    time = INTERVAL * np.arange(10_000)
    random = np.random.default_rng(7)
    shown = {
        "two tones": 20.0 + 5.0 * np.sin(60.0 * time) + 5.0 * np.sin(137.0 * time),
        "noise": random.normal(size=time.size),
        "a walk": np.cumsum(random.normal(size=time.size)),
        "growing": time * np.sin(100.0 * time),
        "three levels": np.select([time < 0.3, time < 0.6], [20.0, 60.0], 35.0),
        "a sawtooth that decays": 20.0 + 30.0 * np.exp(-3.0 * time) * np.mod(7.0 * time, 1.0),
        "a ramp": 50.0 * time,
    }
    assert {name: detect_waveform(time, volts).name for name, volts in shown.items()} == dict.fromkeys(shown, "sampled")


def test_a_sine_may_have_a_bias():
    time = INTERVAL * np.arange(20_000)
    found = detect_waveform(time, 30.0 + 12.0 * np.sin(2 * np.pi * 3.0 * time + 0.4))
    assert found.name == "sine"
    assert found.numbers["bias"] == pytest.approx(18.0, rel=1e-6)
    assert found.numbers["voltage"] == pytest.approx(24.0, rel=1e-6)


def test_a_voltage_that_never_changes_is_refused():
    with pytest.raises(ValueError, match="3 V in all 10 samples"):
        detect_waveform(np.arange(10.0), np.full(10, 3.0))


def test_noise_and_resolution_are_told():
    random = np.random.default_rng(3)
    motion = np.sin(np.linspace(0.0, 20.0, 4000)) + 0.02 * random.normal(size=4000)
    assert scatter_floor(motion) == pytest.approx(0.02, rel=0.05)
    assert resolution_of(motion) is None
    assert resolution_of(0.013 * np.round(motion / 0.013)) == pytest.approx(0.013, rel=1e-6)


def drawn(random):
    """A drive at random, as `samples` and the tests above make one: name, time, volts, frequency, voltage, start."""
    name = str(random.choice(list(SHAPES)))
    per_cycle, cycles = 10 ** random.uniform(1.5, 3.0), random.uniform(2.2, 20.0)
    frequency, noise = 10 ** random.uniform(-1.0, 3.0), random.choice([0.0, 1e-3, 5e-3])
    voltage, start = random.choice([-1.0, 1.0]) * 10 ** random.uniform(0.0, 2.2), random.uniform(0.0, 5.0) / frequency
    time = random.uniform(0.0, 3.0) / frequency + np.arange(int(per_cycle * cycles)) / (per_cycle * frequency)
    level = SHAPES[name][2](np.mod((time - start) * frequency, 1.0))
    return name, time, voltage * (level + noise * random.normal(size=time.size)), frequency, voltage, start


@pytest.mark.parametrize("name", [pytest.param("backward", marks=pytest.mark.slow), "skew triangle", "sine"])
def test_how_well_noise_leaves_the_frequency_told_is_known(name):
    time, pulls = 4e-3 * np.arange(130), []
    clean = 60.0 * SHAPES[name][2](np.mod((time - 0.0123) * 5.3, 1.0))
    for seed in range(60):
        found = detect_waveform(time, clean + 0.3 * np.random.default_rng(seed).normal(size=time.size))
        pulls.append((found.numbers["frequency"] / 5.3 - 1.0) / found.frequency_error)
    # Three standard deviations of the root mean square of as many normal numbers.
    assert np.sqrt(np.mean(np.square(pulls))) == pytest.approx(1.0, abs=0.28)


def test_a_frequency_that_noise_leaves_open_is_said_to_be():
    time = 4e-3 * np.arange(130)
    clean = 60.0 * SHAPES["backward"][2](np.mod((time - 0.0123) * 5.3, 1.0))
    noise = np.random.default_rng(1).normal(size=time.size)
    (bound,) = [text for text in detect_waveform(time, clean + 0.3 * noise).uncertain if "frequency" in text]
    assert re.fullmatch(r"frequency: within 0\.1\d? %", bound)
    assert not any("frequency" in text for text in detect_waveform(time, clean + 0.03 * noise).uncertain)


@pytest.mark.parametrize("first", [slow(1e5), slow(1e7), 1.7e9])
@pytest.mark.parametrize("name", [slow("forward"), "backward, slow rise", slow("skew triangle"), "trapezoid"])
def test_what_a_clock_counts_from_changes_nothing(name, first):
    kind, direction, shape, numbers = SHAPES[name]
    time, volts = samples(shape, 7.3, 64.2, 0.0123, 0.3)
    found, late = detect_waveform(time, volts), detect_waveform(time + first, volts)
    check(late, kind, 7.3, 64.2, numbers, direction)
    assert late.numbers == pytest.approx(found.numbers, rel=1e-5)
    assert late.frequency_error == pytest.approx(found.frequency_error, rel=1e-3)
    assert late.start - first == pytest.approx(found.start, abs=0.02 * INTERVAL)


@pytest.mark.parametrize(("stair", "begins"), [(0.3, "held"), (0.01, "running")])
def test_a_voltage_was_held_before_where_it_lasts_and_not_on_a_staircase(stair, begins):
    time = 1e-3 * np.arange(1000)
    steps = np.floor(time / stair + 1e-9)
    volts = 30.0 + 20.0 * np.sin(1.7 * steps) + 0.01 * np.random.default_rng(9).normal(size=time.size)
    found = detect_waveform(time, volts)
    assert (found.name, found.begins) == ("sampled", begins)


@pytest.mark.parametrize(("hum", "rest"), [(0.3, 0.025), (0.05, 0.2), slow(0.05, 0.025), slow(0.3, 0.2)])
@pytest.mark.parametrize("forward", [True, False])
def test_hum_does_not_hide_when_a_drive_leaves_its_rest(hum, rest, forward):
    """Neighbouring samples hardly differ by it."""
    time = 2e-4 * np.arange(round((rest + 0.25) / 2e-4)) - rest + (-3e-5 if forward else 3e-5)
    # Each cycle begins with its fast flank: the first one forward falls from 0 V to 0 V.
    phase = np.mod((time + 6e-5 * forward) * 20.0, 1.0)
    volts = np.where(time < 0, 0.0, 55.0 * sawtooth(phase, 1.2e-3, forward))
    volts = volts + hum * np.sin(2 * np.pi * 50.0 * time + 1.0) + 0.02 * np.random.default_rng(3).normal(size=time.size)
    found = detect_waveform(time, volts)
    assert (found.name, found.begins) == ("sawtooth", "seen")
    assert found.direction == ("forward" if forward else "backward")
    assert found.start == pytest.approx(-6e-5 if forward else 0.0, abs=2e-5)
    assert found.numbers["voltage"] == pytest.approx(55.0, abs=0.1)
    assert found.numbers["fall_time"] == pytest.approx(6e-5, abs=2e-5)


@pytest.mark.parametrize("samples_a_cycle", [10, slow(12), slow(16)])
def test_of_few_samples_a_cycle_one_on_the_fast_flank_is_enough(samples_a_cycle):
    """And is not taken for a flank of two intervals, which would leave a fifth of the voltage out."""
    time = np.arange(8 * samples_a_cycle) / (20.0 * samples_a_cycle) + 2e-5
    clean = 55.0 * sawtooth(np.mod(time * 20.0, 1.0), 1.2e-3, True)
    found = detect_waveform(time, clean + 0.02 * np.random.default_rng(2).normal(size=time.size))
    assert (found.name, found.direction) == ("sawtooth", "forward")
    assert found.numbers["voltage"] == pytest.approx(55.0, abs=0.1)
    assert found.numbers["frequency"] == pytest.approx(20.0, rel=1e-3)


@pytest.mark.slow
def test_drives_at_random_are_found_or_taken_as_sampled_but_never_for_others():
    random = np.random.default_rng(2026)
    told = []
    for _ in range(600):
        name, time, volts, frequency, voltage, start = drawn(random)
        found = detect_waveform(time, volts)
        assert found.name in (SHAPES[name][0], "sampled"), name
        if found.name == "sampled":
            told.append(False)
            continue
        assert found.direction == SHAPES[name][1]
        turns, interval = (found.start - start) * frequency, time[1] - time[0]
        late = abs(turns - round(turns)) / frequency / interval
        near = abs(found.numbers["voltage"] / voltage - 1.0) < 0.01
        exact = abs(found.numbers["frequency"] / frequency - 1.0) < 1e-3
        told.append(near and exact and late < 1.1)
        # What is not told is said not to be.
        said = " ".join(found.uncertain)
        assert near or "of the voltage open" in said, name
        assert exact or "frequency: within" in said, name
    assert np.mean(told) > 0.97


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_the_noise_of_a_voltage_is_told_beside_corners_that_every_fourth_sample_is_next_to(noise):
    volts = 60.0 * np.mod(np.arange(400) / 8.0, 1.0) + np.random.default_rng(2).normal(0.0, noise, 400)
    # A quarter of the samples with motion in them shift the median to where a third lie.
    assert scatter_between_corners(volts) == pytest.approx(1.43 * noise, rel=0.2)
    assert scatter_between_corners(volts[:3]) == 0.0


def test_the_scatter_of_neighbours_takes_corners_for_noise_where_nothing_else_scatters():
    assert neighbour_scatter(60.0 * np.mod(np.arange(400) / 8.0, 1.0)) > 1.0


@pytest.mark.parametrize("rests", [1, 3, 20])
def test_a_step_may_come_with_the_second_sample(rests):
    time = 2e-5 * np.arange(4000)
    volts = np.where(np.arange(4000) < rests, 0.0, 33.0) + 0.04 * np.random.default_rng(5).normal(size=4000)
    found = detect_waveform(time, volts)
    assert found.name == "step" and found.numbers["voltage"] == pytest.approx(33.0, rel=1e-3)
    assert found.timing is not None
    assert found.start - found.timing.within <= time[rests] <= found.start + found.timing.within


@pytest.mark.parametrize(("low", "high"), [(-30.0, 20.0), (-20.0, -5.0), (-20.0, 30.0), (5.0, 40.0), (5.0, -30.0)])
def test_a_sine_between_any_two_voltages_lies_over_its_samples(low, high):
    """Whichever of the extremes is the larger one, and wherever it begins."""
    time = INTERVAL * np.arange(5000)
    volts = low + (high - low) * (0.5 - 0.5 * np.cos(2.0 * np.pi * 10.0 * time))
    found = detect_waveform(time, volts)
    assert found.name == "sine"
    numbers = {field: found.numbers[field] for field in ("voltage", "frequency")}
    laid = Sine(**numbers, bias=found.numbers.get("bias", 0.0)).at(jnp.asarray(time - found.start + 1.0))
    np.testing.assert_allclose(laid, volts, atol=1e-3 * abs(high - low))
