"""Whether residuals are as large along all of a record, as noise is, or lie where a model is wrong."""

import numpy as np
import pytest
from scipy.signal import lfilter

from pdssjax.metrics import unevenness

STEP = 1e-3
COLOURS = {"white": [], "one millisecond in ten": [0.9], "slow": [0.95], "ringing": [1.8, -0.9]}


def noise(random, count, colour):
    """Stationary noise of unit variance."""
    filtered = lfilter([1.0], np.r_[1.0, -np.array(COLOURS[colour])], random.normal(size=count + 2000))[2000:]
    return filtered / np.std(filtered)


@pytest.mark.parametrize("colour", COLOURS)
@pytest.mark.parametrize("count", [1000, 4000])
def test_stationary_noise_of_any_colour_is_even(colour, count):
    random, time = np.random.default_rng(count), STEP * np.arange(count)
    found = np.array([unevenness(noise(random, count, colour), time) for _ in range(100)])
    found = found[np.isfinite(found)]
    assert found.size > 50
    assert found.max() < 4.0
    assert abs(found.mean()) < 0.7
    assert 0.6 < found.std() < 1.2


def test_times_need_not_be_even():
    random = np.random.default_rng(5)
    whole = noise(random, 4000, "one millisecond in ten")
    chosen = np.sort(random.choice(4000, 1000, replace=False))
    assert unevenness(whole[chosen], STEP * chosen) < 4.0
    assert unevenness(whole[chosen] * np.where(chosen < 800, 2.0, 1.0), STEP * chosen) > 4.0


@pytest.mark.parametrize("colour", COLOURS)
def test_a_misfit_lies_where_the_model_is_wrong(colour):
    """A decaying misfit behind each of four flanks, a half larger than the noise all in all."""
    random, time = np.random.default_rng(3), STEP * np.arange(4000)
    misfit = np.exp(-np.mod(time, 1.0) / 0.05)
    both = noise(random, 4000, colour) + 1.5 * misfit / np.sqrt(np.mean(misfit**2))
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
