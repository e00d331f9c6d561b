"""A border is found to its tolerance with few points."""

import numpy as np
import pytest
from quick_blocks import example_study

import pdssjax
from pdssjax import InputError
from pdssjax.sweeps import execution, find_border

FREQUENCIES = np.linspace(5.0, 50.0, 10)
TRUTH = 12.0 + 0.7 * FREQUENCIES
"""The border [V] at each of them."""


@pytest.fixture(scope="module")
def study():
    return example_study()


@pytest.fixture
def dead(monkeypatch):
    """The step efficiency rises from zero at a voltage that depends on the frequency; says how many points it had."""
    asked = []

    def computed_block(function, points):
        asked.append(len(points))
        frequency, voltage = points.T
        efficiency = np.maximum(0.01 + 0.05 * (voltage - 12.0 - 0.7 * frequency), 0.0)
        return np.column_stack([*[efficiency] * 5, np.zeros(len(points))])

    monkeypatch.setattr(execution, "computed_block", computed_block)
    return asked


def test_the_border_is_found_with_a_tenth_of_the_points_of_a_grid(study, dead):
    found = find_border(study, "drive.voltage", (8.0, 150.0), {"drive.frequency": FREQUENCIES}, tolerance=0.2)
    np.testing.assert_allclose(found.border, TRUTH, rtol=0.0, atol=0.1)
    assert found.border.attrs["units"] == "V" and (found.passes == 1).all()
    assert found.attrs["points"] < 0.1 * len(FREQUENCIES) * (150.0 - 8.0) / 0.2


def test_where_there_is_no_border_there_is_none(study, dead):
    found = find_border(study, "drive.voltage", (8.0, 30.0), {"drive.frequency": FREQUENCIES}, tolerance=0.2)
    np.testing.assert_array_equal(np.isfinite(found.border), TRUTH < 30.0)


@pytest.mark.parametrize(
    ("change", "essential"),
    [
        (dict(ends=(150.0, 8.0)), "expected the lower end first"),
        (dict(tolerance=0.0), "expected both positive"),
        (dict(metric="speeds"), 'unknown metric "speeds"'),
        (dict(path="drive.volt"), "did you mean"),
    ],
)
def test_what_has_no_border_is_refused_before_any_work(study, dead, change, essential):
    asked = dict(path="drive.voltage", ends=(8.0, 150.0), over={"drive.frequency": [5.0]}, tolerance=0.2) | change
    with pytest.raises(InputError) as refused:
        find_border(study, **asked)
    assert essential in str(refused.value) and not dead


@pytest.mark.slow
def test_the_border_of_the_example_is_that_of_its_sweep(study):
    found = find_border(study, "drive.voltage", (1.0, 20.0), {"drive.frequency": [20.0, 40.0]}, tolerance=0.2)
    for border, frequency in zip(found.border.values, [20.0, 40.0], strict=True):
        over = {"drive.voltage": [border - 0.2, border + 0.2], "drive.frequency": [frequency]}
        below, above = pdssjax.sweep(study, over).efficiency.values.ravel()
        assert below < 0.01 < above
