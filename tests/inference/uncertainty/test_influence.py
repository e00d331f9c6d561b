"""How an estimate follows its samples: against refits, closed forms, and the covariances that follow."""

import numpy as np
import pytest

from pdssjax.inference import curvature_of, influence_of, principal_directions
from pdssjax.inference.uncertainty.influence import TwoSteps

RANDOM = np.random.default_rng(2)
DESIGN = RANDOM.normal(size=(50, 4)) * np.array([1e-6, 1.0, 3e3, 1e8])
TIME = np.linspace(0.0, 2.0, 50)


def test_of_a_linear_model_it_is_the_pseudo_inverse():
    size = np.linalg.norm(DESIGN, axis=0)
    np.testing.assert_allclose(influence_of(DESIGN) * size, np.linalg.pinv(DESIGN / size).T, rtol=1e-10, atol=1e-13)


def test_a_direction_without_information_is_left_out():
    twice = np.column_stack([DESIGN[:, 1], DESIGN[:, 1]])
    np.testing.assert_allclose(influence_of(twice), np.tile(influence_of(DESIGN[:, 1:2]) / 2.0, 2), rtol=1e-10)
    assert not influence_of(np.zeros((6, 2))).any()


def decay(free):
    """exp(-t/tau) by the logarithms of height and tau, with its Jacobian, for data that it does not explain."""
    height, tau = np.exp(free)
    value = height * np.exp(-TIME / tau)
    return value, np.stack([value, value * TIME / tau], axis=1)


MEASURED = np.exp(-TIME / 0.1) + np.exp(-TIME / 2.0)


def refitted(measured, free):
    for _ in range(60):
        value, slopes = decay(free)
        moves = [(slopes[:, i] * (value - measured)) for i in range(2)]
        gradient = np.array([m.sum() for m in moves])
        hessian = slopes.T @ slopes + second(value - measured, free)
        free = free - np.linalg.solve(hessian, gradient)
    return free


def second(residual, free):
    """Sum of residuals times second derivatives, in closed form."""
    value, _ = decay(free)
    rate = TIME / np.exp(free[1])
    mixed = residual @ (value * rate)
    return np.array([[residual @ value, mixed], [mixed, residual @ (value * (rate**2 - rate))]])


def test_with_its_curvature_it_is_what_a_refit_does_where_the_model_is_wrong():
    best = refitted(MEASURED, np.log([1.4, 1.0]))
    value, slopes = decay(best)
    curvature = second(value - MEASURED, best) @ principal_directions(slopes)
    error = RANDOM.normal(size=TIME.size)
    error /= np.linalg.norm(error)
    moved = (refitted(MEASURED + 1e-5 * error, best) - refitted(MEASURED - 1e-5 * error, best)) / 2e-5
    np.testing.assert_allclose(influence_of(slopes, curvature).T @ error, moved, rtol=1e-6)
    assert np.max(np.abs(influence_of(slopes).T @ error / moved - 1.0)) > 0.1


EARLY = TIME < 0.7


def fitted_alone(i, measured, free, rows):
    """`free` with its number i fitted to some rows, by Newton's method."""
    free = free.copy()
    for _ in range(80):
        value, slopes = decay(free)
        off = (value - measured) * rows
        free[i] -= slopes[:, i] @ off / (slopes[rows, i] @ slopes[rows, i] + second(off, free)[i, i])
    return free


def test_in_two_steps_too():
    """The height from the early samples, as if tau were 1; then tau from the others, the height held."""

    def first(measured):
        return fitted_alone(0, measured, np.array([0.3, 0.0]), EARLY)

    def both(measured):
        return fitted_alone(1, measured, first(measured), ~EARLY)

    error = RANDOM.normal(size=TIME.size)
    error /= np.linalg.norm(error)
    moved = (both(MEASURED + 1e-5 * error) - both(MEASURED - 1e-5 * error)) / 2e-5
    ends = first(MEASURED), both(MEASURED)
    (early, late), rows = (decay(end) for end in ends), (EARLY, ~EARLY)
    slopes = [step[1] * use[:, None] for step, use in zip((early, late), rows, strict=True)]
    steps = TwoSteps(*slopes, np.array([0]), np.array([1]))
    along = steps.directions()
    curved = [
        second((s[0] - MEASURED) * use, end) @ along for s, use, end in zip((early, late), rows, ends, strict=True)
    ]
    found = steps.influence((curved[0], curved[1]))
    np.testing.assert_allclose(found.T @ error, moved, rtol=1e-5)


ANYWHERE = np.full(2, -np.inf), np.full(2, np.inf)


@pytest.mark.parametrize("side", ["free", "lower", "upper"])
def test_the_curvature_is_found_by_differences_of_the_jacobian(side):
    best = refitted(MEASURED, np.log([1.4, 1.0]))
    value, slopes = decay(best)
    residual, jacobian = 1e3 * (value - MEASURED), 1e3 * slopes
    halves = [slice(0, 20), slice(20, 50)]
    bounds = {"free": ANYWHERE, "lower": (best - 1e-9, ANYWHERE[1]), "upper": (ANYWHERE[0], best + 1e-9)}[side]
    asked = []

    def jacobian_at(free):
        asked.append(free)
        return 1e3 * decay(free)[1]

    along = principal_directions(jacobian)
    found = curvature_of(jacobian_at, best, residual, jacobian, along, halves, bounds)
    assert len(asked) == 2
    assert all(np.all((bounds[0] <= at) & (at <= bounds[1])) for at in asked)
    for matrix, rows in zip(found, halves, strict=True):
        only = np.zeros(50)
        only[rows] = residual[rows]
        exact = 1e3 * second(only, best) @ along
        np.testing.assert_allclose(matrix, exact, atol=4e-3 * np.abs(exact).max())


def test_steps_are_no_longer_than_the_scale_allows():
    asked = []
    wide = np.array([[30.0], [-60.0]])
    curvature_of(
        lambda free: (asked.append(free), decay(free)[1])[1],
        np.zeros(2),
        TIME,
        decay(np.zeros(2))[1],
        wide,
        [slice(0, 50)],
        ANYWHERE,
    )
    assert np.max(np.abs(asked[0])) == pytest.approx(0.1)


def test_a_sum_of_squares_that_is_no_bowl_still_gives_a_finite_influence():
    assert np.isfinite(influence_of(DESIGN, -1e3 * DESIGN.T @ DESIGN @ principal_directions(DESIGN))).all()


def test_where_the_jacobian_cannot_be_had_there_is_no_curvature():
    slopes = decay(np.zeros(2))[1]
    (found,) = curvature_of(
        lambda free: np.full_like(slopes, np.nan), np.zeros(2), TIME, slopes, np.eye(2), [slice(0, 50)], ANYWHERE
    )
    assert not found.any()


CLOSE = np.log([1.0, 0.30, 1.0, 0.36])


def two_decays(free):
    """Two decays that are hard to tell apart, by the logarithms of heights and times, with their Jacobian."""
    first, second = (np.exp(h) * np.exp(-TIME / np.exp(t)) for h, t in (free[:2], free[2:]))
    columns = (first, first * TIME / np.exp(free[1]), second, second * TIME / np.exp(free[3]))
    return first + second, np.stack(columns, axis=1)


def test_in_a_narrow_valley_the_curvature_survives_rough_derivatives():
    """Columns all but parallel (a condition of thousands), and Jacobians that are wrong by 1e-7."""
    random = np.random.default_rng(1)
    _, slopes = two_decays(CLOSE)
    unit = slopes / np.linalg.norm(slopes, axis=0)
    assert np.linalg.cond(unit) > 3e3
    slopes = slopes * 1e3
    left = np.linalg.qr(slopes)[0]
    wave = np.sin(40.0 * TIME)
    residual = wave - left @ (left.T @ wave)
    rough = lambda free: 1e3 * two_decays(free)[1] * (1.0 + 1e-7 * random.normal(size=slopes.shape))
    along = principal_directions(slopes)
    everywhere = [slice(0, 50)], (np.full(4, -np.inf), np.full(4, np.inf))
    exact = curvature_of(lambda free: 1e3 * two_decays(free)[1], CLOSE, residual, slopes, along, *everywhere)[0]
    found = curvature_of(rough, CLOSE, residual, slopes, along, *everywhere)[0]
    np.testing.assert_allclose(along.T @ found, along.T @ exact, atol=0.02)
