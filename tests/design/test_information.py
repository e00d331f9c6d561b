"""The information of a record is that of the dense matrices: coloured noise whitened, free zeros eliminated."""

import numpy as np
import pytest
from scipy.linalg import block_diag, solve_triangular

from pdssjax import InputError
from pdssjax.design import Noise, record_information
from pdssjax.design.information import (
    check_seen,
    inverse_of,
    least_squares_errors,
    unseen_combinations,
    whitened,
)

RANDOM = np.random.default_rng(4)
TIMES = np.sort(RANDOM.uniform(0.0, 0.3, 40))
COLUMNS = RANDOM.normal(size=(40, 3))
COLOURED, WHITE = Noise(0.7, 0.05), Noise(0.7)


def dense(noise, times=TIMES):
    """The covariance of the noise at all times."""
    if not noise.correlation_time:
        return noise.deviation**2 * np.eye(times.size)
    return noise.deviation**2 * np.exp(-np.abs(times[:, None] - times) / noise.correlation_time)


@pytest.mark.parametrize("noise", [WHITE, COLOURED])
def test_whitening_by_neighbours_is_that_of_the_cholesky_factor(noise):
    factor = np.linalg.cholesky(dense(noise))
    assert np.allclose(whitened(COLUMNS, TIMES, noise), solve_triangular(factor, COLUMNS, lower=True))


@pytest.mark.parametrize("noise", [WHITE, COLOURED])
def test_the_covariance_times_columns_is_that_of_the_dense_matrix(noise):
    assert np.allclose(noise.covariance_product(COLUMNS, TIMES), dense(noise) @ COLUMNS)


def test_noise_is_drawn_by_the_factor_of_its_covariance():
    steps = np.random.default_rng(1).normal(size=TIMES.size)
    drawn = COLOURED.drawn(TIMES, np.random.default_rng(1))
    assert np.allclose(drawn, np.linalg.cholesky(dense(COLOURED)) @ steps)


@pytest.mark.parametrize("noise", [WHITE, COLOURED])
def test_free_zeros_are_projected_out_as_the_joint_matrix_has_it(noise):
    """Two records with a zero each, beside the matrix of all five unknowns."""
    halves = [(COLUMNS[:25], TIMES[:25]), (COLUMNS[25:], TIMES[25:])]
    found = sum(record_information(columns, times, noise) for columns, times in halves)
    zeros = block_diag(np.ones((25, 1)), np.ones((15, 1)))
    inverse = block_diag(*(np.linalg.inv(dense(noise, times)) for _, times in halves))
    joint = np.column_stack([COLUMNS, zeros])
    whole = np.linalg.inv(joint.T @ inverse @ joint)
    assert np.allclose(np.linalg.inv(found), whole[:3, :3])


def test_ordinary_least_squares_has_the_sandwich_of_the_dense_matrix():
    design = np.column_stack([COLUMNS, np.ones(TIMES.size)])
    fit = np.linalg.pinv(design)
    sandwich = (fit @ dense(COLOURED) @ fit.T)[:3, :3]
    found = least_squares_errors([(COLUMNS, TIMES, COLOURED)], np.zeros((3, 3)))
    assert np.allclose(found, sandwich)
    best = np.linalg.inv(record_information(COLUMNS, TIMES, COLOURED))
    assert np.all(np.linalg.eigvalsh(found - best) > -1e-9)


def test_ordinary_least_squares_is_best_where_noise_is_white():
    found = least_squares_errors([(COLUMNS, TIMES, WHITE)], np.eye(3))
    assert np.allclose(found, np.linalg.inv(record_information(COLUMNS, TIMES, WHITE) + np.eye(3)))


def test_scales_far_apart_are_inverted():
    scale = np.array([1e-9, 1.0, 1e8])
    matrix = COLUMNS.T @ COLUMNS
    found = inverse_of(np.outer(scale, scale) * matrix)
    assert np.allclose(found * np.outer(scale, scale), np.linalg.inv(matrix))


PATHS = ["effector.mass", "friction.f_c", "piezo.gain"]


def test_a_common_factor_is_named():
    """Force over mass is all that a displacement tells."""
    ratio = RANDOM.normal(size=40)
    columns = np.column_stack([-ratio, ratio, RANDOM.normal(size=40)])
    (found,) = unseen_combinations(columns.T @ columns, PATHS)
    assert found.exponents == pytest.approx({"effector.mass": 1.0, "friction.f_c": 1.0})
    assert found.words == "effector.mass * friction.f_c"


def test_a_parameter_that_nothing_sees_is_named_alone():
    columns = np.column_stack([COLUMNS[:, 0], np.zeros(40), COLUMNS[:, 2]])
    (found,) = unseen_combinations(columns.T @ columns, PATHS)
    assert found.words == "friction.f_c"
    with pytest.raises(InputError, match=r"rig\.toml: found no experiment .* changes with friction\.f_c;"):
        check_seen([found], "rig.toml")


def test_a_power_is_named():
    common = RANDOM.normal(size=40)
    columns = np.column_stack([2.0 * common, -common, RANDOM.normal(size=40)])
    (found,) = unseen_combinations(columns.T @ columns, PATHS)
    assert found.words == "friction.f_c * effector.mass^0.5"


def test_what_is_all_seen_has_no_such_combination():
    assert not unseen_combinations(COLUMNS.T @ COLUMNS * np.outer([1e-4, 1, 1e4], [1e-4, 1, 1e4]), PATHS)
    check_seen([], "rig.toml")
