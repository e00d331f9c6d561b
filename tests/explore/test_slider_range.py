"""Sliders: where numbers lie on them, and what they reach."""

import pytest

from pdssjax.core import Quantity
from pdssjax.explore.settings import POSITIONS, slider_range

POSITIVE = Quantity(1.0, "N/m", True, 0.0, float("inf"), False)
SIGNED = Quantity(0.0, "N", False, -float("inf"), float("inf"), True)
FROM_ZERO = Quantity(0.0, "s", False, 0.0, float("inf"), True)
SHARE = Quantity(1.0, "", True, 0.0, 1.0, True)


def test_a_positive_number_has_a_decade_either_way_by_equal_ratios():
    found = slider_range(POSITIVE, 2e6)
    assert (found.low, found.high, found.logarithmic) == (pytest.approx(2e5), pytest.approx(2e7), True)
    assert found.position(2e6) == POSITIONS // 2
    assert found.number(POSITIONS // 2) == 2e6
    assert found.number(POSITIONS) / found.number(POSITIONS - 1) == pytest.approx(10 ** (2 / POSITIONS), rel=1e-3)


def test_the_bounds_of_a_study_are_the_ends():
    found = slider_range(POSITIVE, 2e6, 1e6, 5e6)
    assert (found.low, found.high) == (1e6, 5e6)
    assert slider_range(POSITIVE, 2e6, 0.0, 5e6).low > 0


@pytest.mark.parametrize(
    ("quantity", "number", "ends"),
    [
        (SIGNED, 0.0, (-1.0, 1.0)),
        (SIGNED, 0.3, (0.0, 0.6)),
        (SIGNED, -0.3, (-0.6, 0.0)),
        (FROM_ZERO, 0.0, (0.0, 2e-3)),
        (FROM_ZERO, 5e-3, (0.0, 1e-2)),
    ],
)
def test_others_go_linearly(quantity, number, ends):
    found = slider_range(quantity, number)
    assert (found.low, found.high) == pytest.approx(ends)
    assert not found.logarithmic
    assert found.number(found.position(number)) == pytest.approx(number)


def test_a_slider_stays_below_an_end_that_is_not_legal():
    found = slider_range(SHARE, 0.5)
    assert 0.5 < found.number(POSITIONS) < 1.0
    assert found.widened(0.01, SHARE).high < 1.0


@pytest.mark.parametrize("quantity", [POSITIVE, SIGNED])
def test_positions_and_numbers_belong_together(quantity):
    found = slider_range(quantity, 0.7)
    assert all(found.position(found.number(position)) == position for position in range(POSITIONS + 1))


def test_a_number_typed_outside_widens_the_range():
    found = slider_range(POSITIVE, 1.0).widened(500.0, POSITIVE)
    assert found.low == 0.1
    assert found.high > 500.0
    assert slider_range(SIGNED, 0.3).widened(-2.0, SIGNED).low < -2.0
    assert slider_range(POSITIVE, 1.0).widened(3.0, POSITIVE) == slider_range(POSITIVE, 1.0)
