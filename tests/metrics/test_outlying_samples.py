"""Glitches, clipped samples and held ones are told from noise, misfit, rest and a coarse sensor."""

import numpy as np
import pytest

from pdssjax import metrics
from pdssjax.metrics import clipped_counts, describe_hold, fresh_samples, hold_length

TIME = np.arange(0.0, 1.6, 1e-3)


def noise(seed=1):
    return np.random.default_rng(seed).normal(0.0, 1.0, TIME.size)


def outliers(measured, time, frequency, predicted=0.0):
    return metrics.outliers(measured, np.full(measured.shape, predicted), time, frequency)


def test_glitches_are_found_and_nothing_else():
    residual = noise()
    residual[[5, 700, 701, 1599]] += [12.0, -30.0, 15.0, 11.0]
    assert list(outliers(residual, TIME, None)) == [5, 700, 701, 1599]
    assert list(outliers(residual, TIME, 5.0)) == [5, 700, 701, 1599]
    assert outliers(noise(), TIME, 5.0).size == outliers(noise(), TIME, None).size == 0


def test_what_every_cycle_repeats_is_misfit():
    slip = np.where(np.mod(np.arange(TIME.size), 200) < 2, 25.0, 0.0)
    assert outliers(noise() + slip, TIME, 5.0).size == 0
    once = slip * (np.arange(TIME.size) < 200)
    assert list(outliers(noise() + slip - once, TIME, 5.0)) == [0, 1]


@pytest.mark.parametrize("cycles", [2, 3, 4, 5])
def test_few_cycles_of_noise_have_no_outliers(cycles):
    """Of three cycles a third of the samples were the median at their phase: samples at 1.4 deviations stood out."""
    few = np.arange(TIME.size) < 200 * cycles
    for seed in range(20):
        residual = noise(seed)[few]
        assert outliers(residual, TIME[few], 5.0).size == 0
        residual[70] += 15.0
        assert list(outliers(residual, TIME[few], 5.0)) == [70]


@pytest.mark.parametrize("frequency", [5.0, None])
def test_a_slip_predicted_at_another_time_is_no_glitch(frequency):
    """But glitches beside it are, in a steep motion, too."""
    measured = noise() + 0.1 * np.arange(TIME.size) - 30.0 * (TIME >= 0.05)
    predicted = 0.1 * np.arange(TIME.size) - 30.0 * (TIME >= 0.053)
    assert metrics.outliers(measured, predicted, TIME, frequency).size == 0
    steep = 20.0 * np.clip(np.arange(TIME.size) - 700, 0, 40)
    measured[60] += 20.0
    measured[[720, 721]] += 25.0
    assert list(metrics.outliers(measured + steep, predicted + steep, TIME, frequency)) == [60, 720, 721]


def test_a_smooth_misfit_is_no_glitch_however_few_of_its_samples_are_far_off():
    """As the start of a motion is, by a law that does not have it."""
    residual = noise() + 12.0 * np.exp(-0.5 * ((np.arange(TIME.size) - 300) / 2.0) ** 2)
    assert np.sum(np.abs(residual) > 7.0) in range(1, 6)
    assert outliers(residual, TIME, None).size == 0


def test_a_long_misfit_is_no_glitch():
    residual = noise()
    residual[400:440] += 20.0
    assert outliers(residual, TIME, None).size == 0


@pytest.mark.parametrize("residual", [np.zeros(30), np.full(30, np.nan), np.ones(3)])
def test_nothing_stands_out_of_nothing(residual):
    assert outliers(residual, 1e-3 * np.arange(residual.size), 100.0).size == 0


def test_what_is_missing_is_passed_over():
    residual = noise()
    residual[[3, 4]] = np.nan
    residual[9] = 40.0
    assert list(outliers(residual, TIME, 5.0)) == [9]


CLIPPED_TIME = np.arange(0.0, 1.0, 1e-3)
MOTION = np.mod(20.0 * CLIPPED_TIME, 1.0) + 3.0 * CLIPPED_TIME
CLIPPED_NOISE = 0.01 * np.random.default_rng(5).normal(size=CLIPPED_TIME.size)


def test_a_motion_that_is_cut_off_is_seen_and_one_that_is_not_is_not():
    assert clipped_counts(MOTION + CLIPPED_NOISE) == {}
    cut = np.minimum(MOTION + CLIPPED_NOISE, 3.0)
    found = clipped_counts(cut)
    # All but a few single ones that noise lifts to the end of the range.
    assert list(found) == ["highest"] and 0.95 * np.sum(cut == 3.0) < found["highest"] <= np.sum(cut == 3.0)
    low = clipped_counts(np.maximum(np.cos(30.0 * CLIPPED_TIME), -0.9))
    assert list(low) == ["lowest"] and low["lowest"] > 50


def test_rest_at_the_begin_and_at_the_end_is_none():
    rest = np.concatenate([np.zeros(300), MOTION, np.full(300, MOTION[-1] + 1.0)])
    assert clipped_counts(rest) == {}


def test_nor_are_the_steps_of_a_coarse_sensor():
    coarse = np.round(4.0 * np.sin(9.0 * CLIPPED_TIME)) / 4.0
    assert clipped_counts(coarse) == {}


def test_what_walks_out_of_range_stays_there_to_the_end_while_the_drive_runs():
    volts = 50.0 * np.mod(20.0 * CLIPPED_TIME, 1.0)
    cut = np.minimum(3.0 * CLIPPED_TIME, 2.3)
    assert clipped_counts(cut) == {}
    found = clipped_counts(cut, volts)
    assert list(found) == ["highest"] and found["highest"] > 200
    rest = np.concatenate([np.zeros(300), MOTION, np.full(300, MOTION[-1] + 1.0)])
    assert clipped_counts(rest, np.concatenate([np.zeros(300), volts, np.full(300, volts[-1])])) == {}


def rung(random, elapsed):
    """What a stack with a little damping leaves of a step."""
    rate, damping = 2.0 * np.pi * random.uniform(300.0, 2000.0), 10.0 ** random.uniform(-2.0, -0.6)
    return np.exp(-damping * rate * elapsed) * np.cos(rate * elapsed)


def motion(random, kind, time):
    """One of height 1 or so."""
    count = random.integers(2, 20)
    phase = np.mod(count * time / time[-1], 1.0)
    cycle, elapsed = np.floor(count * time / time[-1]), phase * time[-1] / count
    return {
        "step": lambda: np.where(cycle > 0, 1.0 - rung(random, np.maximum(time - time[-1] / count, 0.0)), 0.0),
        "sawtooth": lambda: phase + random.random() * cycle + 0.2 * rung(random, elapsed),
        "steps": lambda: (np.mod(cycle, 2) * 2 - 1) * (1.0 - 2.0 * rung(random, elapsed)),
        "sine": lambda: np.sin(2.0 * np.pi * count * time / time[-1]),
        "ramp": lambda: time / time[-1],
        "rest": lambda: 0.0 * time,
        "square": lambda: np.mod(cycle, 2),
        "stairs": lambda: cycle,
    }[kind]()


def recorded(random, kinds, held=1):
    """A record with noise, counted by its sensor in steps from a ten thousandth to a tenth of its height."""
    size = int(random.integers(400, 4000))
    time = np.arange(size) * 10.0 ** random.uniform(-5.3, -4.3)
    count = 10.0 ** random.uniform(-4.0, -1.0 if held == 1 else -2.0)
    noise = count * random.choice([0.0, random.uniform(0.0, 1.0), random.uniform(0.0, 5.0)])
    seen = motion(random, random.choice(kinds), time) + noise * random.normal(size=size)
    seen = 1e-6 * count * np.round(seen / count)
    first = int(random.integers(held))
    return seen[np.maximum((np.arange(size) - first) // held * held + first, 0)]


def test_of_1000_records_without_a_hold_none_is_taken_for_one():
    random = np.random.default_rng(1)
    kinds = ["step", "sawtooth", "steps", "sine", "ramp", "rest", "square", "stairs"]
    assert [found for found in (hold_length(recorded(random, kinds)) for _ in range(1000)) if found is not None] == []


@pytest.mark.parametrize("held", [2, 3, 4, 5])
def test_holds_of_records_that_ring_are_found(held):
    random = np.random.default_rng(held)
    found = [hold_length(recorded(random, ["step", "sawtooth", "steps"], held)) for _ in range(50)]
    assert found == [held] * 50


def test_a_sensor_that_is_not_in_step_with_its_digitiser_is_found():
    time = 1e-5 * np.arange(2000)
    shown = np.floor(time / 2.5e-5 + 1e-9) * 2.5e-5
    seen = rung(np.random.default_rng(3), shown)
    assert hold_length(seen) == pytest.approx(2.5, abs=0.02)
    assert "at the rate" in describe_hold(seen) and "held =" not in describe_hold(seen)


@pytest.mark.parametrize("first", [0, 1, 2])
def test_fresh_samples_are_those_at_which_the_value_changes(first):
    new = np.random.default_rng(0).normal(size=100)
    seen = np.concatenate([np.full(first, 9.0), np.repeat(new, 3)])
    kept = fresh_samples(seen, 3)
    np.testing.assert_array_equal(seen[kept], new)
    assert np.flatnonzero(kept)[0] == first
    assert "held = 3" in describe_hold(seen)


@pytest.mark.parametrize("values", [np.zeros(50), np.arange(3.0), np.full(40, np.nan), np.zeros(0)])
def test_records_that_say_nothing_are_no_trouble(values):
    assert hold_length(values) is None and describe_hold(values) == ""
