"""Glitches are told from noise and from misfit."""

import numpy as np
import pytest

from pdssjax import metrics

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
