"""Derivatives of a sawtooth of straight flanks and of the line of its slow ones, against differences."""

import numpy as np
import pytest

from pdssjax.metrics.sharpened_flanks import levels_of, line_of, slopes_of_levels, slopes_of_line

NUMBERS = np.array([60.0, 0.13, 0.021, 0.013])
STEPS = 1e-6 * NUMBERS
TIME = np.linspace(-0.2, 1.0, 61)


def differences(function):
    steps = np.diag(STEPS)
    columns = [
        (function(NUMBERS + step) - function(NUMBERS - step)) / (2.0 * size)
        for step, size in zip(steps, STEPS, strict=True)
    ]
    return np.stack(columns, axis=1)


@pytest.mark.parametrize("forward", [True, False])
def test_derivatives_are_those_of_differences(forward):
    turn = np.mod(TIME - NUMBERS[2], NUMBERS[1])
    at_a_corner = np.minimum(turn, np.abs(turn - NUMBERS[3])) < 1e-4
    assert not np.any(at_a_corner) and np.any(turn < NUMBERS[3])
    levels = lambda numbers: levels_of(TIME, forward, numbers)
    line = lambda numbers: line_of(numbers, forward)
    for slopes, function in (
        (slopes_of_levels(TIME, forward, NUMBERS), levels),
        (slopes_of_line(NUMBERS, forward), line),
    ):
        expected = differences(function)
        np.testing.assert_allclose(slopes, expected, rtol=1e-6, atol=1e-7 * np.max(np.abs(expected)))


@pytest.mark.parametrize("forward", [True, False])
def test_slow_flanks_lie_on_their_line(forward):
    a, slope, drop = line_of(NUMBERS, forward)
    _, period, start, duration = NUMBERS
    turn = (TIME - start) / period
    slow = np.mod(turn, 1.0) > duration / period
    on_line = a + slope * TIME - drop * np.floor(turn)
    np.testing.assert_allclose(levels_of(TIME, forward, NUMBERS)[slow], on_line[slow], atol=1e-9)
