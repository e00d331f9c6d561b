"""Covariances are exact where theory gives them, and silent where the data are."""

import numpy as np
import pytest

from pdssjax.inference import least_squares_covariance
from pdssjax.inference.covariance import correlation, scaled_least_squares

RANDOM = np.random.default_rng(7)
DESIGN = RANDOM.normal(size=(40, 4)) * np.array([1e-6, 1.0, 3e3, 1e8])
"""A Jacobian with badly scaled columns."""
NONE_HELD = np.zeros(4, bool)


def test_a_linear_model_has_the_covariance_of_the_normal_equations():
    # Rescaled by hand, since the plain inverse loses half of the digits on such columns.
    size = np.linalg.norm(DESIGN, axis=0)
    exact = np.linalg.inv((DESIGN / size).T @ (DESIGN / size)) / np.outer(size, size)
    found = least_squares_covariance(DESIGN, NONE_HELD)
    np.testing.assert_allclose(found.matrix, exact, rtol=1e-10)
    assert found.identifiable.all()
    assert found.null == []


def test_a_straight_line_has_the_errors_of_the_textbook():
    x, noise = np.linspace(0.0, 3.0, 25), 0.2
    line = np.stack([np.ones_like(x), x], axis=1) / noise
    slope, spread = noise**2 / np.sum((x - x.mean()) ** 2), np.sum((x - x.mean()) ** 2)
    found = least_squares_covariance(line, np.zeros(2, bool)).matrix
    assert found[1, 1] == pytest.approx(slope)
    assert found[0, 0] == pytest.approx(noise**2 * (1 / x.size + x.mean() ** 2 / spread))
    assert correlation(found)[0, 1] == pytest.approx(-x.mean() / np.sqrt(np.mean(x**2)))


def test_a_held_parameter_counts_as_known():
    held = np.array([False, True, False, False])
    found = least_squares_covariance(DESIGN, held)
    others = least_squares_covariance(DESIGN[:, ~held], np.zeros(3, bool))
    np.testing.assert_allclose(found.matrix[np.ix_(~held, ~held)], others.matrix, rtol=1e-10)
    assert np.isnan(found.matrix[1]).all()
    assert found.null == []


def test_a_column_of_zeros_is_reported_and_leaves_the_others_alone():
    design = np.insert(DESIGN, 2, 0.0, axis=1)
    found = least_squares_covariance(design, np.zeros(5, bool))
    assert found.identifiable.tolist() == [True, True, False, True, True]
    (direction,) = found.null
    np.testing.assert_array_equal(direction, [0, 0, 1, 0, 0])
    kept = found.identifiable
    np.testing.assert_allclose(
        found.matrix[np.ix_(kept, kept)], least_squares_covariance(DESIGN, NONE_HELD).matrix, rtol=1e-10
    )
    assert np.isnan(found.matrix[2]).all() and np.isnan(correlation(found.matrix)[2]).all()
    np.testing.assert_allclose(np.diag(correlation(found.matrix))[kept], 1.0)


def test_a_common_factor_is_reported_with_equal_shares_and_leaves_the_others_alone():
    # On logarithmic scales: three columns that cancel when all three move alike.
    a, b = RANDOM.normal(size=(2, 60))
    known = RANDOM.normal(size=60)
    found = least_squares_covariance(np.stack([a, known, b, -a - b], axis=1), NONE_HELD)
    assert found.identifiable.tolist() == [False, True, False, False]
    (direction,) = found.null
    np.testing.assert_allclose(direction, [1, 0, 1, 1], atol=1e-6)
    exact = least_squares_covariance(np.stack([a, known, b], axis=1), np.zeros(3, bool)).matrix[1, 1]
    assert found.matrix[1, 1] == pytest.approx(exact)


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_the_unit_of_a_parameter_does_not_decide_whether_it_is_known(unit):
    a, b, known = RANDOM.normal(size=(3, 60))
    found = least_squares_covariance(np.stack([a * unit, b, a + b, known], axis=1), NONE_HELD)
    assert found.identifiable.tolist() == [False, False, False, True]
    (direction,) = found.null
    np.testing.assert_allclose(direction / direction[2], [-1 / unit, -1, 1, 0], rtol=1e-6)


def test_nothing_informed_is_no_error():
    found = least_squares_covariance(np.zeros((5, 2)), np.zeros(2, bool))
    assert not found.identifiable.any()
    assert len(found.null) == 2
    assert np.isnan(found.matrix).all()


def test_what_is_held_moves_what_is_fitted_as_a_refit_says():
    earlier, later = DESIGN[:, [1, 3]], DESIGN[:, [0, 2]]
    # In units of one column each: a refit of the others with one of the held parameters moved by one.
    refits = [-np.linalg.lstsq(later, column, rcond=None)[0] for column in earlier.T]
    np.testing.assert_allclose(-scaled_least_squares(later, earlier), np.stack(refits, axis=1), rtol=1e-9)
    assert scaled_least_squares(later, later @ np.ones(2)) == pytest.approx([1.0, 1.0])
