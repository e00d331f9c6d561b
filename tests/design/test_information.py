"""The information of a record is that of the dense matrices, and an exchange keeps the best records."""

import itertools

import numpy as np
import pytest
from scipy.linalg import block_diag, solve_triangular

from pdssjax import InputError
from pdssjax.design import Noise, record_information
from pdssjax.design.criteria import Combinations, Determinant, Discrimination, Trace
from pdssjax.design.exchange import Candidates, Search, best_selection, promising
from pdssjax.design.information import check_seen, inverse_of, least_squares_errors, unseen_combinations, whitened

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


RESOURCES = np.array([1.0, 1.0, 0.0, 1.0])
"""Of a candidate that is one sample."""


def of_rows(rows):
    """A candidate for each row of a Jacobian, whitened."""
    rows = np.asarray(rows, float)
    return Candidates(rows[:, None, :, None] * rows[:, None, None, :], np.tile(RESOURCES, (len(rows), 1)))


def search(criterion, count, size, prior=0.0):
    budget = np.array([count, count, np.inf, np.inf])
    return Search(criterion, prior * np.eye(size)[None], budget)


def test_a_line_is_measured_at_its_ends():
    """y = a + b t on -1..1: half of the samples at each end are D-optimal."""
    times = np.linspace(-1.0, 1.0, 21)
    plan = best_selection(of_rows(np.column_stack([np.ones(21), times])), search(Determinant(), 6, 2))
    assert plan == [0, 0, 0, 20, 20, 20]


@pytest.mark.parametrize("criterion", [Determinant(), Trace(), Combinations(np.array([[[0.0, 1.0, 0.0]]]))])
@pytest.mark.parametrize("seed", range(2))
def test_exchange_finds_the_best_of_all_selections(criterion, seed):
    candidates = of_rows(np.random.default_rng(seed).normal(size=(9, 3)))
    asked = search(criterion, 4, 3, prior=1e-2)
    best = min(
        float(criterion(asked.prior + candidates.information[list(some)].sum(axis=0)))
        for some in itertools.combinations_with_replacement(range(9), 4)
    )
    found = best_selection(candidates, asked)
    assert float(criterion(asked.prior + candidates.information[found].sum(axis=0))) == pytest.approx(best, abs=1e-9)


def test_the_budget_holds_for_every_resource():
    random = np.random.default_rng(7)
    candidates = of_rows(random.normal(size=(30, 2)))
    sizes = random.integers(1, 9, 30)
    takes = np.column_stack([sizes, np.ones(30), 0.1 * sizes, 1.0 + 0.2 * sizes])
    candidates = Candidates(candidates.information * sizes[:, None, None, None], takes)
    asked = Search(Determinant(), np.zeros((1, 2, 2)), np.array([20.0, 5.0, 1.7, 8.5]))
    plan = best_selection(candidates, asked)
    assert np.all(takes[plan].sum(axis=0) <= asked.budget + 1e-9)
    assert len(plan) >= 3


def test_the_mean_over_draws_counts():
    """Under either draw another candidate is best; the one that is good under both is chosen."""
    information = np.zeros((3, 2, 1, 1))
    information[:, :, 0, 0] = [[10.0, 0.01], [0.01, 10.0], [4.0, 4.0]]
    candidates = Candidates(information, np.tile(RESOURCES, (3, 1)))
    asked = Search(Determinant(), np.zeros((2, 1, 1)), np.array([1.0, 1.0, np.inf, np.inf]))
    assert best_selection(candidates, asked) == [2]


def test_promising_candidates_hold_the_best_plan():
    candidates = of_rows(np.column_stack([np.ones(200), np.linspace(-1.0, 1.0, 200)]))
    kept = promising(candidates, search(Determinant(), 6, 2), 20)
    assert {0, 199} <= set(kept) and len(kept) < 30


def test_a_rival_is_told_by_what_its_best_fit_leaves():
    """Information of [J, J_rival, d]; the divergence is that of two least-squares fits."""
    random = np.random.default_rng(3)
    own, rival, difference = random.normal(size=(30, 2)), random.normal(size=(30, 3)), random.normal(size=30)
    columns = np.column_stack([own, rival, difference])
    left = [np.sum((difference - j @ np.linalg.lstsq(j, difference, rcond=None)[0]) ** 2) for j in (own, rival)]
    found = Discrimination(2).evidence((columns.T @ columns)[None])
    assert found[0] == pytest.approx(0.25 * sum(left))


def test_what_is_known_of_a_rival_before_keeps_it_from_taking_up():
    rival = np.random.default_rng(5).normal(size=(30, 2))
    columns = np.column_stack([rival, rival, rival @ [1.0, -2.0]])
    known = np.zeros((5, 5))
    known[:4, :4] = 1e6 * np.eye(4)
    found = Discrimination(2).evidence((columns.T @ columns + known)[None])[0]
    assert found == pytest.approx(0.5 * np.sum((rival @ [1.0, -2.0]) ** 2), rel=1e-3)
