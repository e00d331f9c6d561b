"""Ends of likelihood intervals: against closed forms, and against brute force where nothing is quadratic."""

import numpy as np
import pytest
from scipy.optimize import brentq, least_squares

from pdssjax.inference.profile_likelihood import Verdict, interval_end

THRESHOLD = 3.841458820694124
RANDOM = np.random.default_rng(5)
FREE = np.full(2, -50.0), np.full(2, 50.0)


def of(residual):
    """Residual and Jacobian, the latter by complex steps: exact."""

    def evaluate(at):
        at = np.asarray(at, float)
        steps = [at + 1e-30j * e for e in np.eye(at.size)]
        return np.real(residual(at + 0j)), np.stack([np.imag(residual(s)) / 1e-30 for s in steps], axis=1)

    return evaluate


def brute(residual, optimum, index, side, reach):
    """The same end by refits of the other parameters and bisection."""
    real = lambda at: np.real(residual(np.asarray(at) + 0j))
    least = np.sum(real(optimum) ** 2)

    def excess(value):
        fixed = lambda others: real(np.insert(others, index, value))
        found = least_squares(fixed, np.delete(optimum, index), xtol=1e-15, ftol=1e-15, gtol=1e-15)
        return 2.0 * found.cost - least - THRESHOLD

    return brentq(excess, optimum[index], optimum[index] + side * reach, xtol=1e-12)


def optimum_of(residual, start):
    real = lambda at: np.real(residual(np.asarray(at) + 0j))
    return least_squares(real, start, xtol=1e-15, ftol=1e-15, gtol=1e-15).x


X = np.linspace(0.0, 2.0, 40)
NOISE = RANDOM.normal(size=40)
LINE = np.stack([np.ones(40), X, X**2], axis=1)


@pytest.mark.parametrize("index", range(3))
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_of_a_linear_model_they_are_the_textbook_s(index, side):
    evaluate = of(lambda at: LINE @ at - NOISE)
    optimum = np.linalg.lstsq(LINE, NOISE, rcond=None)[0]
    error = np.sqrt(np.linalg.inv(LINE.T @ LINE)[index, index] * THRESHOLD)
    end = interval_end(evaluate, optimum, index, side, THRESHOLD, (np.full(3, -50.0), np.full(3, 50.0)))
    assert end.verdict == Verdict.BOUNDED
    assert end.value == pytest.approx(optimum[index] + side * error, abs=1e-6 * error)
    assert end.evaluations <= 5


def decay(at):
    """A decay whose amplitude and rate are known badly, on logarithmic scales."""
    return np.exp(at[0]) * np.exp(-np.exp(at[1]) * X) - np.exp(-0.7 * X) + 0.3 * NOISE


def banana(at):
    """Rosenbrock's valley."""
    return np.stack([10.0 * (at[1] - at[0] ** 2), 0.4 * (1.0 - at[0])])


CURVED = [
    *((decay, [0.0, -0.4], 3.0, index, side) for index, side in [(0, -1.0), (0, 1.0), (1, 1.0)]),
    *((banana, [1.0, 1.0], 40.0, index, side) for index, side in [(0, -1.0), (0, 1.0), (1, 1.0)]),
]


@pytest.mark.parametrize("residual, start, reach, index, side", CURVED)
def test_of_a_curved_valley_they_are_those_of_brute_force(residual, start, reach, index, side):
    optimum = optimum_of(residual, start)
    end = interval_end(of(residual), optimum, index, side, THRESHOLD, FREE, reach=45.0 if residual is banana else 7.0)
    assert end.verdict == Verdict.BOUNDED
    expected = brute(residual, optimum, index, side, reach)
    assert end.value == pytest.approx(expected, abs=1e-3 * abs(expected - optimum[index]) / np.sqrt(THRESHOLD))


def saturating(at):
    """A rate so large that only a lower end of it can be told."""
    return 3.0 * (1.0 - np.exp(-np.exp(at[0]) * (X + 0.3))) - 3.0 + at[1] - 0.2 * NOISE


def test_one_side_may_be_flat():
    optimum = optimum_of(saturating, [3.0, 0.0])
    low = interval_end(of(saturating), optimum, 0, -1.0, THRESHOLD, FREE)
    high = interval_end(of(saturating), optimum, 0, 1.0, THRESHOLD, FREE)
    assert low.verdict == Verdict.BOUNDED
    assert low.value == pytest.approx(brute(saturating, optimum, 0, -1.0, 3.0), abs=1e-4)
    assert high.verdict == Verdict.FLAT
    assert high.value == np.inf


def test_a_bound_holds_and_the_others_make_the_best_of_theirs():
    evaluate = of(lambda at: LINE @ at - NOISE)
    optimum = np.linalg.lstsq(LINE, NOISE, rcond=None)[0]
    error = np.sqrt(np.linalg.inv(LINE.T @ LINE)[1, 1])
    low, high = np.full(3, -50.0), np.full(3, 50.0)
    high[1] = optimum[1] + 0.5 * error
    end = interval_end(evaluate, optimum, 1, 1.0, THRESHOLD, (low, high))
    assert (end.verdict, end.value) == (Verdict.AT_BOUND, high[1])
    # With the offset held where it is, the slope's interval is that of a line through it.
    high[1], low[0], high[0] = 50.0, optimum[0], optimum[0]
    end = interval_end(evaluate, optimum, 1, 1.0, THRESHOLD, (low, high))
    rest = np.sqrt(np.linalg.inv(LINE[:, 1:].T @ LINE[:, 1:])[0, 0] * THRESHOLD)
    assert end.value == pytest.approx(optimum[1] + rest, abs=1e-6)


def test_a_lower_minimum_on_the_way_and_a_step_are_said():
    two = lambda at: np.stack([at[0] ** 2 - 1.0, 0.5 * (at[0] - 1.0), at[1]])
    wrong = optimum_of(two, [-1.2, 0.0])
    assert wrong[0] < 0.0
    assert interval_end(of(two), wrong, 0, 1.0, THRESHOLD, FREE).verdict == Verdict.LOWER
    step = lambda at: np.stack([at[0] + np.where(np.real(at[0]) > 0.7, 5.0, 0.0), at[1]])
    assert interval_end(of(step), np.zeros(2), 0, 1.0, THRESHOLD, FREE).verdict == Verdict.LOST
