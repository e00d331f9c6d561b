"""What repeats every cycle is told from noise, and noise that is as large everywhere from a misfit."""

import numpy as np
import pytest
from marks import slow
from scipy.signal import lfilter

from pdssjax.metrics import lack_of_fit, unevenness

FREQUENCY, CYCLES = 5.0, 6
RANDOM = np.random.default_rng(3)


def sampled(interval):
    return np.arange(round(CYCLES / FREQUENCY / interval)) * interval


def bump(time, size):
    """Misfit for a twentieth of each cycle, right after it begins."""
    return size * (np.mod(time * FREQUENCY + 1e-9, 1.0) < 0.05)


@pytest.mark.parametrize("interval", [1e-3, 1.0317e-3], ids=["whole number a cycle", "any"])
def test_white_noise_is_none_and_its_size_is_found(interval):
    time = sampled(interval)
    found = [lack_of_fit(RANDOM.normal(0.0, 2e-8, time.size), time, FREQUENCY) for _ in range(400)]
    sigmas = np.array([f.sigmas for f in found])
    assert abs(sigmas.mean()) < 0.2 and 0.9 < sigmas.std() < 1.1
    assert np.mean([f.noise for f in found]) == pytest.approx(2e-8, rel=0.01)


@pytest.mark.parametrize("interval", [1e-3, 1.0317e-3], ids=["whole number a cycle", "any"])
def test_what_repeats_is_seen_better_than_by_a_sum_of_squares_whose_noise_is_known(interval):
    time, share = sampled(interval), 0.15
    misfit = bump(time, 1e-8 * np.sqrt(share / 0.05))
    found = [lack_of_fit(RANDOM.normal(0.0, 1e-8, time.size) + misfit, time, FREQUENCY) for _ in range(100)]
    chi_square = share / np.sqrt(2.0 / time.size)
    assert np.median([f.sigmas for f in found]) > 1.4 * chi_square > 5.0
    assert np.median([f.misfit for f in found]) == pytest.approx(1e-8 * np.sqrt(share), rel=0.15)
    assert np.median([f.noise for f in found]) == pytest.approx(1e-8, rel=0.06)


@pytest.mark.parametrize("coefficient", [slow(0.8), 0.95])
@pytest.mark.parametrize("samples, begin", [(200.0, 0.0), (200.0, 0.5), (193.7, 0.5)])  # a cycle; the first, in samples
def test_noise_whose_neighbours_are_alike_is_no_misfit(coefficient, samples, begin):
    time = (np.arange(1600) + begin) / samples / FREQUENCY
    found = []
    for _ in range(300):
        noise = lfilter([1.0], [1.0, -coefficient], RANDOM.normal(size=time.size + 300))[300:]
        found.append(lack_of_fit(noise, time, FREQUENCY).sigmas)
    assert -0.5 < np.mean(found) < 0.3 and 0.8 < np.std(found) < 1.2
    assert np.mean(np.array(found) > 4.0) == 0.0


def test_what_comes_once_is_noise_as_far_as_it_can_tell():
    time = sampled(1e-3)
    once = np.where(np.abs(time - 0.33) < 0.02, 3e-8, 0.0)
    assert lack_of_fit(RANDOM.normal(0.0, 1e-8, time.size) + once, time, FREQUENCY).sigmas < 4.0


def test_a_record_that_hardly_repeats_says_nothing():
    time = sampled(1e-3)
    assert lack_of_fit(np.zeros(250), time[:250], FREQUENCY) is None
    assert lack_of_fit(np.zeros(30), time[:30], 500.0) is None
    assert lack_of_fit(np.zeros(time.size), time, FREQUENCY).sigmas == 0.0


STEP = 1e-3
COLOURS = {"white": [], "one millisecond in ten": [0.9], "slow": [0.95], "ringing": [1.8, -0.9]}


def coloured(random, count, colour):
    """Stationary coloured of unit variance."""
    filtered = lfilter([1.0], np.r_[1.0, -np.array(COLOURS[colour])], random.normal(size=count + 2000))[2000:]
    return filtered / np.std(filtered)


@pytest.mark.parametrize("colour", COLOURS)
@pytest.mark.parametrize("count", [1000, 4000])
def test_stationary_noise_of_any_colour_is_even(colour, count):
    random, time = np.random.default_rng(count), STEP * np.arange(count)
    found = np.array([unevenness(coloured(random, count, colour), time) for _ in range(100)])
    found = found[np.isfinite(found)]
    assert found.size > 50
    assert found.max() < 4.0
    assert abs(found.mean()) < 0.7
    assert 0.6 < found.std() < 1.2


def test_times_need_not_be_even():
    random = np.random.default_rng(5)
    whole = coloured(random, 4000, "one millisecond in ten")
    chosen = np.sort(random.choice(4000, 1000, replace=False))
    assert unevenness(whole[chosen], STEP * chosen) < 4.0
    assert unevenness(whole[chosen] * np.where(chosen < 800, 2.0, 1.0), STEP * chosen) > 4.0


@pytest.mark.parametrize("colour", COLOURS)
def test_a_misfit_lies_where_the_model_is_wrong(colour):
    """A decaying misfit behind each of four flanks, a half larger than the coloured all in all."""
    random, time = np.random.default_rng(3), STEP * np.arange(4000)
    misfit = np.exp(-np.mod(time, 1.0) / 0.05)
    both = coloured(random, 4000, colour) + 1.5 * misfit / np.sqrt(np.mean(misfit**2))
    assert unevenness(both, time) > 4.0


def test_what_is_alike_for_as_long_as_the_record_is_no_noise():
    time = STEP * np.arange(1000)
    white = 0.01 * np.random.default_rng(1).normal(size=1000)
    for misfit in (np.ones(1000), time, np.sin(5.0 * time)):
        assert unevenness(misfit + white, time) > 4.0


def test_few_samples_are_even_if_they_are_white():
    white = np.random.default_rng(2).normal(size=20)
    assert unevenness(white, STEP * np.arange(20)) == 0.0
    assert unevenness(np.full(20, np.nan), STEP * np.arange(20)) == 0.0
