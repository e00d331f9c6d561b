"""Samples at the end of a range are told from rest and from a coarse sensor."""

import numpy as np

from pdssjax.metrics import clipped

TIME = np.arange(0.0, 1.0, 1e-3)
MOTION = np.mod(20.0 * TIME, 1.0) + 3.0 * TIME
NOISE = 0.01 * np.random.default_rng(5).normal(size=TIME.size)


def test_a_motion_that_is_cut_off_is_seen_and_one_that_is_not_is_not():
    assert clipped(MOTION + NOISE) == {}
    cut = np.minimum(MOTION + NOISE, 3.0)
    found = clipped(cut)
    # All but a few single ones that noise lifts to the end of the range.
    assert list(found) == ["highest"] and 0.95 * np.sum(cut == 3.0) < found["highest"] <= np.sum(cut == 3.0)
    low = clipped(np.maximum(np.cos(30.0 * TIME), -0.9))
    assert list(low) == ["lowest"] and low["lowest"] > 50


def test_rest_at_the_begin_and_at_the_end_is_none():
    rest = np.concatenate([np.zeros(300), MOTION, np.full(300, MOTION[-1] + 1.0)])
    assert clipped(rest) == {}


def test_nor_are_the_steps_of_a_coarse_sensor():
    coarse = np.round(4.0 * np.sin(9.0 * TIME)) / 4.0
    assert clipped(coarse) == {}


def test_what_walks_out_of_range_stays_there_to_the_end_while_the_drive_runs():
    volts = 50.0 * np.mod(20.0 * TIME, 1.0)
    cut = np.minimum(3.0 * TIME, 2.3)
    assert clipped(cut) == {}
    found = clipped(cut, volts)
    assert list(found) == ["highest"] and found["highest"] > 200
    rest = np.concatenate([np.zeros(300), MOTION, np.full(300, MOTION[-1] + 1.0)])
    assert clipped(rest, np.concatenate([np.zeros(300), volts, np.full(300, volts[-1])])) == {}
