"""Glitches are told from noise and from misfit."""

import numpy as np
import pytest

from pdssjax.metrics import outliers

TIME = np.arange(0.0, 1.6, 1e-3)


def noise(seed=1):
    return np.random.default_rng(seed).normal(0.0, 1.0, TIME.size)


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
