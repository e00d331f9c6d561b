"""Sets of points: their numbers, their order, and what is refused."""

import numpy as np
import pytest

from pdssjax import InputError
from pdssjax.sweeps import CovarianceDraws, Crossed, GivenDraws, Grid, LatinHypercube, Listed, Sobol
from pdssjax.sweeps.blocks import plan_blocks

RANGES = {"drive.voltage": (20.0, 80.0), "drive.frequency": (2.0, 50.0)}


def test_a_grid_has_every_combination_the_last_axis_fastest():
    grid = Grid({"drive.voltage": [30.0, 64.0], "drive.frequency": [5.0, 23.0, 40.0]})
    assert grid.dimensions() == {"drive_voltage": 2, "drive_frequency": 3} and len(grid) == 6
    np.testing.assert_array_equal(grid.values()[:, 0], [30.0] * 3 + [64.0] * 3)
    np.testing.assert_array_equal(grid.values()[:, 1], [5.0, 23.0, 40.0] * 2)
    assert Grid({}).values().shape == (1, 0)


def test_a_list_has_its_points_as_they_are():
    listed = Listed({"drive.voltage": [30.0, 64.0], "drive.frequency": [5.0, 23.0]})
    assert listed.dimensions() == {"point": 2}
    np.testing.assert_array_equal(listed.values(), [[30.0, 5.0], [64.0, 23.0]])
    assert listed.coordinates()["drive.frequency"][0] == "point"


@pytest.mark.parametrize("kind", [Sobol, LatinHypercube])
def test_a_sample_fills_its_ranges_evenly_and_is_the_same_for_the_same_seed(kind):
    values = kind(RANGES, 32, seed=3).values()
    np.testing.assert_array_equal(values, kind(RANGES, 32, seed=3).values())
    assert not np.array_equal(values, kind(RANGES, 32, seed=4).values())
    for column, (low, high) in zip(values.T, RANGES.values(), strict=True):
        assert low <= column.min() and column.max() <= high
        # Both kinds put one point into each of 32 slices.
        assert set(np.floor(32 * (column - low) / (high - low)).astype(int)) == set(range(32))


def test_draws_have_the_covariance_of_the_estimate():
    means, errors = np.array([2.0, -1.0]), np.array([0.02, 0.05])
    covariance = np.outer(errors, errors) * np.array([[1.0, 0.6], [0.6, 1.0]])
    draws = CovarianceDraws(["a.b", "c.d"], means, covariance, np.array([True, False]), 20_000, seed=1)
    values = draws.values()
    assert (values[:, 0] > 0).all() and draws.dimensions() == {"draw": 20_000}
    np.testing.assert_allclose(values.mean(axis=0), means, atol=2e-3)
    np.testing.assert_allclose(np.cov(values.T), covariance, rtol=0.05)


def test_draws_made_elsewhere_are_taken_evenly():
    table = np.arange(20.0).reshape(10, 2)
    drawn = GivenDraws(["a.b", "c.d"], table, 4)
    assert drawn.dimensions() == {"draw": 4} and drawn.paths == ("a.b", "c.d")
    np.testing.assert_array_equal(drawn.values(), table[[0, 3, 6, 9]])
    np.testing.assert_array_equal(GivenDraws(["a.b", "c.d"], table, 200).values(), table)


def test_a_grid_crossed_with_a_sample_has_the_sample_at_every_point():
    crossed = Crossed(Grid({"drive.voltage": [30.0, 64.0]}), Sobol({"effector.load": (0.0, 0.1)}, 3))
    assert crossed.dimensions() == {"drive_voltage": 2, "point": 3}
    values = crossed.values().reshape(2, 3, 2)
    np.testing.assert_array_equal(values[0, :, 1], values[1, :, 1])
    np.testing.assert_array_equal(values[:, :, 0], [[30.0] * 3, [64.0] * 3])


@pytest.mark.parametrize(
    ("made", "essential"),
    [
        (lambda: Grid({"drive.voltage": []}), "expected some values"),
        (lambda: Grid({"drive.voltage": [1.0, np.inf]}), "finite"),
        (lambda: Listed({"drive.voltage": [1.0], "drive.frequency": [1.0, 2.0]}), "of one length"),
        (lambda: Sobol({"drive.voltage": (80.0, 20.0)}, 8), "80 to 20, expected the lower end first"),
        (lambda: Sobol({"drive.voltage": (20.0, 80.0)}, 0), "at least 1"),
        (lambda: Sobol({}, 8), "at least one path"),
        (lambda: LatinHypercube({"drive.voltage": (1.0, 2.0, 3.0)}, 8), "3 numbers"),
        (lambda: Crossed(Grid({"a.b": [1.0]}), Listed({"a.b": [1.0]})), "twice"),
        (lambda: Crossed(Listed({"a.b": [1.0]}), Listed({"a.c": [1.0]})), 'along "point"'),
        (lambda: CovarianceDraws(["a.b"], np.ones(1), np.full((1, 1), np.nan), np.ones(1, bool), 3), "no finite"),
        (lambda: GivenDraws(["a.b"], np.ones((3, 2))), "1 columns"),
        (lambda: GivenDraws(["a.b"], np.full((3, 1), np.nan)), "finite"),
        (lambda: GivenDraws(["a.b"], np.ones((3, 1)), 0), "at least 1"),
    ],
)
def test_what_is_no_set_of_points_is_refused(made, essential):
    with pytest.raises(InputError, match="sweep") as refused:
        made()
    assert essential in str(refused.value)


def test_a_plan_holds_every_point_once_in_whole_blocks_of_like_frequency():
    grid = Grid({"drive.frequency": np.linspace(50.0, 2.0, 25), "drive.voltage": np.linspace(20.0, 80.0, 5)})
    plan = plan_blocks(grid.paths, grid.values(), lanes=8)
    assert plan.blocks == 16 and sorted(plan.order) == list(range(125))
    np.testing.assert_array_equal(plan.values, grid.values()[plan.order])
    assert (np.diff(plan.values[:, 0]) >= 0).all()
    assert {plan.block(number).shape for number in range(plan.blocks)} == {(8, 2)}
    last = plan.block(15)
    np.testing.assert_array_equal(last[5:], np.repeat(last[4:5], 3, axis=0))
