"""Cycles in arrays of samples: frequency, slips and which flanks count, what a cycle leaves, slips that are late."""

import fabricated
import numpy as np
import pytest

from pdssjax import InputError
from pdssjax.metrics import drift_per_cycle, slip_delay
from pdssjax.metrics.cycle_detection import (
    find_cycles,
)

INTERVAL = 1e-3
TIME = np.arange(0.0, 4.0, INTERVAL)


def drops(time, frequency, phase=0.0):
    """Rises by 1 in a period, and drops by 1 where frequency * time - phase is a whole number."""
    return np.mod(frequency * time - phase, 1.0)


@pytest.mark.parametrize("rest", [0.07, 0.2])
def test_a_drive_that_begins_after_a_rest_begins_without_a_slip(rest):
    time = 2e-4 * np.arange(2500)
    after = np.maximum(time - rest, 0.0)
    values = np.mod(20.0 * after, 1.0) + 0.2 * np.floor(20.0 * after)
    values = values + 0.005 * np.random.default_rng(6).normal(size=time.size)
    found = find_cycles(time, values, None, "here")
    assert found.slip_frequency == pytest.approx(20.0, abs=0.05) and found.slip_frequency_error < 0.02


@pytest.mark.parametrize("given", [None, 5.0])
@pytest.mark.parametrize("jitter", [0.0, 0.3])
def test_cycles_are_found_whatever_the_spacing_of_the_samples(given, jitter):
    random = np.random.default_rng(1)
    time = TIME + jitter * INTERVAL * random.random(TIME.size)
    values = 3e-6 * drops(time, 5.0, 0.25) + 1e-8 * random.normal(size=time.size)
    found = find_cycles(time, values, given, "here")
    assert found.frequency == pytest.approx(5.0, rel=1e-4) if given is None else found.frequency == given
    assert abs(found.slip_frequency - 5.0) < 5 * found.slip_frequency_error
    assert found.slip_frequency_error < 1e-3
    # The slips are at 0.05 s + n / 5 s: 20 of them, with 19 whole flanks between, of which the last only tells a slip.
    assert found.start == pytest.approx(0.05, abs=2e-3)
    assert (found.count, found.falls) == (18, False)
    assert found.fit > 0.9


@pytest.mark.parametrize(("until", "scale"), [(0.2, 3.0), (1.0, 0.1)], ids=["a stage put down", "not on in full"])
def test_motions_before_the_drive_is_on_in_full_and_after_it_has_ended_are_no_cycles(until, scale):
    values = drops(TIME, 5.0) * np.where(until > TIME, scale, TIME < 3.0)
    found = find_cycles(TIME, values + 1e-3 * np.random.default_rng(1).normal(size=TIME.size), 5.0, "here")
    assert found.start == pytest.approx(until, abs=2e-3)
    assert found.count == round(5.0 * (3.0 - until)) - 1


@pytest.mark.parametrize(
    ("frequency", "said"),
    [(0.2, "found the frequency 0.2 Hz"), (400.0, "found the frequency 400 Hz"), (7.9, "found no cycles")],
)
def test_a_frequency_that_the_record_cannot_show_is_refused(frequency, said):
    with pytest.raises(InputError, match=said):
        find_cycles(TIME, drops(TIME, 5.0) * 1e-6, frequency, "here")


def test_too_few_samples_are_refused():
    with pytest.raises(InputError, match="expected more: 8 in each of two cycles"):
        find_cycles(TIME[:9], drops(TIME[:9], 500.0), None, "here")


PERIOD = 0.05
NET = 3e-7


def walk(time, net=NET):
    """A stroke of 2 um that each cycle ends short of, by less in the first."""
    cycles = time / PERIOD
    return net * np.maximum(cycles, 1.0) + 1e-6 * np.sin(2.0 * np.pi * cycles)


@pytest.mark.parametrize("interval", [1e-3, 7.3e-4])
def test_a_walk_s_net_step_and_stroke_are_found_whatever_the_first_cycle_did(interval):
    time = np.arange(0.0, 0.4, interval)
    found = drift_per_cycle(time, walk(time), 1.0 / PERIOD)
    assert found.net == pytest.approx(NET, rel=1e-3)
    assert found.stroke == pytest.approx(2e-6, rel=0.2)


def test_the_error_holds_what_noise_does():
    time, random, noise = np.arange(0.0, 0.4, 1e-3), np.random.default_rng(9), 1e-8
    found = [drift_per_cycle(time, noise * random.standard_normal(time.size), 1.0 / PERIOD) for _ in range(200)]
    pulls = np.array([each.net / each.standard_error for each in found])
    # The differences overlap, so that their mean is known better than their scatter tells.
    assert 0.1 < np.std(pulls) < 1.0
    assert np.abs(pulls).max() < 3.0


def test_less_than_two_cycles_tell_nothing():
    time = np.arange(0.0, 0.09, 1e-3)
    assert drift_per_cycle(time, walk(time), 1.0 / PERIOD) is None


SLIP_TIME = 1e-4 * np.arange(10_000)
PREDICTED = fabricated.walk_motion(SLIP_TIME)
SLIP_NOISE = 1e-8 * np.random.default_rng(2).standard_normal(SLIP_TIME.size)


@pytest.mark.parametrize("late", [-4e-4, -1e-4, 5e-5, 2e-4])
def test_a_delay_is_found_within_its_error_and_explains_what_is_left(late):
    measured = fabricated.walk_motion(SLIP_TIME - late) + SLIP_NOISE + 3e-7
    found = slip_delay(SLIP_TIME, PREDICTED, measured - PREDICTED)
    # A slip is no line over a delay: the error holds the rest.
    assert found.delay == pytest.approx(late, rel=0.2)
    assert found.explained_share > 0.7 and abs(found.delay) > 5.0 * found.standard_error


def test_noise_and_another_stroke_are_no_delay():
    found = slip_delay(SLIP_TIME, PREDICTED, SLIP_NOISE)
    assert abs(found.delay) < 4.0 * found.standard_error and found.explained_share < 0.1
    stroke = slip_delay(SLIP_TIME, PREDICTED, 0.02 * (PREDICTED - np.mean(PREDICTED)) + SLIP_NOISE)
    assert stroke.explained_share < 0.5


def test_what_never_slips_has_no_delay():
    assert slip_delay(SLIP_TIME, 1e-6 * np.sin(30.0 * SLIP_TIME), SLIP_NOISE) is None
    assert slip_delay(SLIP_TIME, PREDICTED, np.full(SLIP_TIME.size, np.nan)) is None
