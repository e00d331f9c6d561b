"""Exchange finds what is best by closed form or by trying all selections."""

import itertools

import numpy as np
import pytest

from pdssjax.design.criteria import Combinations, Determinant, Discrimination, Trace
from pdssjax.design.exchange import Candidates, Search, chosen, promising

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
    plan = chosen(of_rows(np.column_stack([np.ones(21), times])), search(Determinant(), 6, 2))
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
    found = chosen(candidates, asked)
    assert float(criterion(asked.prior + candidates.information[found].sum(axis=0))) == pytest.approx(best, abs=1e-9)


def test_the_budget_holds_for_every_resource():
    random = np.random.default_rng(7)
    candidates = of_rows(random.normal(size=(30, 2)))
    sizes = random.integers(1, 9, 30)
    takes = np.column_stack([sizes, np.ones(30), 0.1 * sizes, 1.0 + 0.2 * sizes])
    candidates = Candidates(candidates.information * sizes[:, None, None, None], takes)
    asked = Search(Determinant(), np.zeros((1, 2, 2)), np.array([20.0, 5.0, 1.7, 8.5]))
    plan = chosen(candidates, asked)
    assert np.all(takes[plan].sum(axis=0) <= asked.budget + 1e-9)
    assert len(plan) >= 3


def test_the_mean_over_draws_counts():
    """Under either draw another candidate is best; the one that is good under both is chosen."""
    information = np.zeros((3, 2, 1, 1))
    information[:, :, 0, 0] = [[10.0, 0.01], [0.01, 10.0], [4.0, 4.0]]
    candidates = Candidates(information, np.tile(RESOURCES, (3, 1)))
    asked = Search(Determinant(), np.zeros((2, 1, 1)), np.array([1.0, 1.0, np.inf, np.inf]))
    assert chosen(candidates, asked) == [2]


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
