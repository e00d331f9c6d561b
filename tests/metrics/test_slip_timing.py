"""Slips that come early or late are told from what else may be left of them."""

import fabricated
import numpy as np
import pytest

from pdssjax.metrics import slip_delay

TIME = 1e-4 * np.arange(10_000)
PREDICTED = fabricated.walk_motion(TIME)
NOISE = 1e-8 * np.random.default_rng(2).standard_normal(TIME.size)


@pytest.mark.parametrize("late", [-4e-4, -1e-4, 5e-5, 2e-4])
def test_a_delay_is_found_within_its_error_and_explains_what_is_left(late):
    measured = fabricated.walk_motion(TIME - late) + NOISE + 3e-7
    found = slip_delay(TIME, PREDICTED, measured - PREDICTED)
    # A slip is no line over a delay: the error holds the rest.
    assert found.delay == pytest.approx(late, rel=0.2)
    assert found.explains > 0.7 and abs(found.delay) > 5.0 * found.standard_error


def test_noise_and_another_stroke_are_no_delay():
    found = slip_delay(TIME, PREDICTED, NOISE)
    assert abs(found.delay) < 4.0 * found.standard_error and found.explains < 0.1
    stroke = slip_delay(TIME, PREDICTED, 0.02 * (PREDICTED - np.mean(PREDICTED)) + NOISE)
    assert stroke.explains < 0.5


def test_what_never_slips_has_no_delay():
    assert slip_delay(TIME, 1e-6 * np.sin(30.0 * TIME), NOISE) is None
    assert slip_delay(TIME, PREDICTED, np.full(TIME.size, np.nan)) is None
