"""Least squares of unknowns that may not be negative, beside signed ones."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from pdssjax.inference.solver.box_least_squares import nonnegative_least_squares


@pytest.mark.parametrize("share_signed", [0.0, 0.3, 1.0])
def test_columns_of_any_size_lead_to_the_same_as_those_of_unit_norm(share_signed):
    random = np.random.default_rng(5)
    columns = (
        random.normal(size=(60, 9)) @ (np.eye(9) + 0.8 * random.normal(size=(9, 9))) * 10.0 ** random.uniform(-9, 3, 9)
    )
    signed = random.random(9) < share_signed
    target = random.normal(size=60)
    x, left = nonnegative_least_squares(columns, target, signed)
    assert np.all(x[~signed] >= 0.0)
    size = np.linalg.norm(columns, axis=0)
    expected = lsq_linear(columns / size, target, (np.where(signed, -np.inf, 0.0), np.inf), method="bvls", tol=1e-14)
    assert left == pytest.approx(2.0 * expected.cost, rel=1e-9)
    np.testing.assert_allclose(x * size, expected.x, atol=1e-6 * np.max(np.abs(expected.x)))


def test_columns_that_are_alike_or_nothing_are_no_trouble():
    random = np.random.default_rng(3)
    columns = random.random((30, 4))
    columns[:, 1], columns[:, 3] = columns[:, 0], 0.0
    x, left = nonnegative_least_squares(columns, columns @ [1.0, 1.0, 2.0, 0.0], np.zeros(4, bool))
    assert left < 1e-20 and x[0] + x[1] == pytest.approx(2.0) and x[2] == pytest.approx(2.0) and x[3] == 0.0


def test_a_target_that_nothing_reaches_leaves_all_of_it():
    x, left = nonnegative_least_squares(np.eye(3), -np.ones(3), np.zeros(3, bool))
    assert not x.any() and left == pytest.approx(3.0)
