"""Ends of likelihood intervals: against closed forms, and against brute force where nothing is quadratic."""

import numpy as np
import pytest
from scipy.optimize import brentq, least_squares, minimize

from pdssjax.inference.uncertainty.profile_intervals import Curve, profile_curve, verdict_of
from pdssjax.inference.uncertainty.profile_likelihood import (
    End,
    ProfileLikelihood,
    SharedCurvature,
    Verdict,
    linearise,
    standard_errors,
)

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


def likelihood(evaluate, optimum, box=FREE, reach=7.0, curvature=None):
    """The likelihood around an optimum; nothing is known of how residuals bend unless a curvature is given."""
    found = ProfileLikelihood(evaluate, optimum, THRESHOLD, box, reach=reach)
    unknown = SharedCurvature(optimum, [], standard_errors(optimum, THRESHOLD, reach)[1])
    found.shared = unknown if curvature is None else curvature
    return found


def interval_end(evaluate, optimum, index, side, box=FREE, reach=7.0, curvature=None):
    """One end alone."""
    return likelihood(evaluate, optimum, box, reach, curvature).ends([(index, side)])[index, side]


def end_of(residual, optimum, index, side, reach=7.0, curvature=None):
    """Where nothing is bounded."""
    evaluate = of(residual)
    return interval_end(evaluate, linearise(evaluate, optimum), index, side, FREE, reach, curvature)


X = np.linspace(0.0, 2.0, 40)
NOISE = RANDOM.normal(size=40)
LINE = np.stack([np.ones(40), X, X**2], axis=1)


@pytest.mark.parametrize("index", range(3))
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_of_a_linear_model_they_are_the_textbook_s(index, side):
    evaluate = of(lambda at: LINE @ at - NOISE)
    optimum = np.linalg.lstsq(LINE, NOISE, rcond=None)[0]
    error = np.sqrt(np.linalg.inv(LINE.T @ LINE)[index, index] * THRESHOLD)
    end = interval_end(evaluate, linearise(evaluate, optimum), index, side, (np.full(3, -50.0), np.full(3, 50.0)))
    assert end.verdict == Verdict.BOUNDED
    assert end.value == pytest.approx(optimum[index] + side * error, abs=1e-6 * error)
    assert end.evaluations <= 5


def test_what_changes_nothing_as_far_as_it_can_be_followed_leaves_the_half_widths_of_others_alone():
    """A stiffness that has run to where its records no longer show it had made others' 5000 times too short."""
    optimum = linearise(of(lambda at: LINE @ at - NOISE), np.zeros(3))
    weakly_determined = optimum._replace(jacobian=optimum.jacobian * [1.0, 1.0, 1e-8])
    alone = standard_errors(optimum._replace(at=np.zeros(2), jacobian=LINE[:, :2]), THRESHOLD, 7.0)[0]
    sizes, scale = standard_errors(weakly_determined, THRESHOLD, 7.0)
    np.testing.assert_allclose(sizes, [*alone, 7.0], rtol=1e-12)
    np.testing.assert_allclose(scale[2], [0.0, 0.0, 7.0])
    told = weakly_determined.jacobian @ scale[:, :2]
    np.testing.assert_allclose(told.T @ told, np.eye(2), atol=1e-12)


def decay(at):
    """A decay whose amplitude and rate are known badly, on logarithmic scales."""
    return np.exp(at[0]) * np.exp(-np.exp(at[1]) * X) - np.exp(-0.7 * X) + 0.3 * NOISE


def banana(at):
    """Rosenbrock's valley."""
    return np.stack([10.0 * (at[1] - at[0] ** 2), 0.4 * (1.0 - at[0])])


BOTH = [(index, side) for index in (0, 1) for side in (-1.0, 1.0)]
CURVED = [
    *((decay, [0.0, -0.4], 3.0, index, side) for index, side in [(0, -1.0), (0, 1.0), (1, 1.0)]),
    *((banana, [1.0, 1.0], 40.0, index, side) for index, side in BOTH),
]


def curvature_of(residual, optimum):
    """What the searches of all its ends share."""
    evaluate = of(residual)
    return ProfileLikelihood(evaluate, linearise(evaluate, optimum), THRESHOLD, FREE).shared


@pytest.mark.parametrize("residual, start, reach, index, side", CURVED)
def test_of_a_curved_valley_they_are_those_of_brute_force(residual, start, reach, index, side):
    optimum = optimum_of(residual, start)
    end = end_of(residual, optimum, index, side, 45.0 if residual is banana else 7.0)
    assert end.verdict == Verdict.BOUNDED
    expected = brute(residual, optimum, index, side, reach)
    assert end.value == pytest.approx(expected, abs=1e-3 * abs(expected - optimum[index]) / np.sqrt(THRESHOLD))
    assert end.evaluations <= 9


SLOPES = RANDOM.normal(size=(40, 5)) * [1000.0, 300.0, 30.0, 3.0, 1.0] @ np.linalg.qr(RANDOM.normal(size=(5, 5)))[0]
BENDS = 0.02 * RANDOM.normal(size=(5, 5, 5))
ERRORS = RANDOM.normal(size=40)


def bent(at):
    """A linear model of numbers that are bent: a valley that is narrow, and leaves its tangent at once."""
    return SLOPES @ (at + np.einsum("ijk,j,k->i", BENDS, at, at) + 0.01 * at**3) + ERRORS


def test_curvature_at_the_optimum_serves_every_end_of_a_narrow_valley():
    evaluate = of(bent)
    optimum = linearise(evaluate, optimum_of(bent, np.zeros(5)))
    box = np.full(5, -50.0), np.full(5, 50.0)
    both = [(index, side) for index in range(5) for side in (-1.0, 1.0)]
    ends = list(ProfileLikelihood(evaluate, optimum, THRESHOLD, box).ends(both).values())
    alone = [interval_end(evaluate, optimum, *which, box) for which in both]
    assert 5 + sum(end.evaluations for end in ends) <= 30 < 34 < sum(end.evaluations for end in alone)
    for which, end, other in zip(both, ends, alone, strict=True):
        error = abs(end.value - optimum.at[which[0]]) / np.sqrt(THRESHOLD)
        assert (end.verdict, end.value) == (Verdict.BOUNDED, pytest.approx(other.value, abs=1e-3 * error))
    assert ends[-1].value == pytest.approx(brute(bent, optimum.at, 4, 1.0, 3.0), abs=1e-4 * error)


EVENTS = RANDOM.normal(size=(40, 5)) * [1000.0, 300.0, 30.0, 3.0, 1.0]


def kinked(at):
    """`bent`, with a kink and a small jump in every residual, as where an event of the contact comes or goes."""
    past = EVENTS @ at + 3.0 * np.sin(7.0 * np.arange(40))
    side = np.where(np.real(past) > 0.0, 1.0, -1.0)
    return bent(at) + 0.005 * past * side + 0.005 * side


def test_kinks_and_small_jumps_on_the_way_cost_precision_but_no_end():
    evaluate = of(kinked)
    optimum = linearise(evaluate, optimum_of(kinked, np.zeros(5)))
    best = least_squares(lambda at: np.real(kinked(at + 0j)), optimum.at, method="trf", x_scale="jac")
    optimum = linearise(evaluate, best.x)
    box = np.full(5, -50.0), np.full(5, 50.0)
    curvature = ProfileLikelihood(evaluate, optimum, THRESHOLD, box).shared
    for index in range(5):
        end = interval_end(evaluate, optimum, index, 1.0, box, 7.0, curvature)
        assert end.verdict == Verdict.BOUNDED
        assert end.point.chi2 == pytest.approx(optimum.chi2 + THRESHOLD, abs=0.01 * THRESHOLD)
        others = np.delete(end.point.at, index)
        chi2 = lambda at, index=index, end=end: np.sum(np.real(kinked(np.insert(at, index, end.value) + 0j)) ** 2)
        found = minimize(chi2, others, method="Nelder-Mead", options=dict(maxiter=300))
        assert found.fun > end.point.chi2 - 0.05 * THRESHOLD


@pytest.mark.parametrize("residual, start, reach", [(decay, [0.0, -0.4], 7.0), (banana, [1.0, 1.0], 45.0)])
@pytest.mark.parametrize("index", [0, 1])
def test_the_curve_between_the_ends_is_that_of_brute_force(residual, start, reach, index):
    optimum = optimum_of(residual, start)
    curvature = curvature_of(residual, optimum)
    ends = tuple(end_of(residual, optimum, index, side, reach, curvature) for side in (-1.0, 1.0))
    evaluate = of(residual)
    around = likelihood(evaluate, linearise(evaluate, optimum), FREE, reach, curvature)
    curve = profile_curve(around, index, ends)
    assert curve.value.size == 25
    assert curve.computed.sum() in (5, 7, 9)
    assert np.all(np.diff(curve.value) > 0.0)
    near = [ends[0].point.at, optimum, ends[1].point.at]
    expected = np.array([minimised(residual, index, value, near) for value in curve.value]) - minimised(residual)
    np.testing.assert_allclose(curve.excess[curve.computed], expected[curve.computed], atol=0.02 * THRESHOLD)
    np.testing.assert_allclose(curve.excess, expected, atol=0.05 * THRESHOLD)
    assert (curve.falls, curve.missed < 0.15) == (pytest.approx(0.0, abs=1e-6), True)
    assert curve.evaluations <= 12


def minimised(residual, index=None, value=0.0, near=((1.0, 1.0),)):
    """Chi-square, minimised over all parameters, or over the others from starts `near`."""
    real = lambda at: np.real(residual(np.asarray(at) + 0j))
    free = real if index is None else lambda others: real(np.insert(others, index, value))
    starts = [at if index is None else np.delete(at, index) for at in near]
    return min(2.0 * least_squares(free, start, xtol=1e-15, ftol=1e-15, gtol=1e-15).cost for start in starts)


def saturating(at):
    """A rate so large that only a lower end of it can be told."""
    return 3.0 * (1.0 - np.exp(-np.exp(at[0]) * (X + 0.3))) - 3.0 + at[1] - 0.2 * NOISE


def test_one_side_may_be_flat():
    optimum = optimum_of(saturating, [3.0, 0.0])
    low = end_of(saturating, optimum, 0, -1.0)
    high = end_of(saturating, optimum, 0, 1.0)
    assert low.verdict == Verdict.BOUNDED
    assert low.value == pytest.approx(brute(saturating, optimum, 0, -1.0, 3.0), abs=1e-4)
    assert high.verdict == Verdict.FLAT
    assert high.value == np.inf
    evaluate = of(saturating)
    best = linearise(evaluate, optimum)
    curve = profile_curve(likelihood(evaluate, best), 0, (low, high))
    assert verdict_of((low, high), curve) == "one-sided: only a lower end"
    assert curve.excess[-1] < 0.01 * THRESHOLD


def test_a_bound_holds_and_the_others_make_the_best_of_theirs():
    evaluate = of(lambda at: LINE @ at - NOISE)
    optimum = np.linalg.lstsq(LINE, NOISE, rcond=None)[0]
    error = np.sqrt(np.linalg.inv(LINE.T @ LINE)[1, 1])
    low, high = np.full(3, -50.0), np.full(3, 50.0)
    high[1] = optimum[1] + 0.5 * error
    end = interval_end(evaluate, linearise(evaluate, optimum), 1, 1.0, (low, high))
    assert (end.verdict, end.value) == (Verdict.AT_BOUND, high[1])
    # With the offset held where it is, the slope's interval is that of a line through it.
    high[1], low[0], high[0] = 50.0, optimum[0], optimum[0]
    end = interval_end(evaluate, linearise(evaluate, optimum), 1, 1.0, (low, high))
    rest = np.sqrt(np.linalg.inv(LINE[:, 1:].T @ LINE[:, 1:])[0, 0] * THRESHOLD)
    assert end.value == pytest.approx(optimum[1] + rest, abs=1e-6)


def test_a_curve_has_a_quality_where_one_side_could_be_followed():
    evaluate = of(banana)
    optimum = linearise(evaluate, optimum_of(banana, [1.0, 1.0]))
    bounded = interval_end(evaluate, optimum, 0, 1.0, FREE, 40.0)
    unfollowed = bounded._replace(point=optimum)
    curve = lambda *ends: profile_curve(likelihood(evaluate, optimum, FREE, 40.0), 0, ends)
    assert 0.5 < curve(unfollowed, bounded).quality <= 1.0
    assert np.isnan(curve(unfollowed, unfollowed).quality)


def test_a_lower_minimum_on_the_way_and_a_step_are_said():
    two = lambda at: np.stack([at[0] ** 2 - 1.0, 0.5 * (at[0] - 1.0), at[1]])
    wrong = optimum_of(two, [-1.2, 0.0])
    assert wrong[0] < 0.0
    assert end_of(two, wrong, 0, 1.0).verdict == Verdict.LOWER
    step = lambda at: np.stack([at[0] + np.where(np.real(at[0]) > 0.7, 5.0, 0.0), at[1]])
    assert end_of(step, np.zeros(2), 0, 1.0).verdict == Verdict.LOST


@pytest.mark.parametrize(
    "verdicts, falls, said",
    [
        ((Verdict.BOUNDED, Verdict.BOUNDED), 0.0, "bounded"),
        ((Verdict.FLAT, Verdict.FLAT), 0.0, "flat"),
        ((Verdict.FLAT, Verdict.BOUNDED), 0.0, "one-sided: only an upper end"),
        ((Verdict.BOUNDED, Verdict.AT_BOUND), 0.0, "held by a bound: upper end"),
        ((Verdict.LOST, Verdict.LOST), 0.0, "not followed: lower and upper end"),
        ((Verdict.BOUNDED, Verdict.LOWER), 0.0, "several minima: a lower one was found"),
        ((Verdict.BOUNDED, Verdict.BOUNDED), 0.2, "several minima: chi-square falls on the way to an end"),
    ],
)
def test_a_verdict_in_words_of_both_ends_and_the_curve(verdicts, falls, said):
    point = linearise(of(banana), np.ones(2))
    nothing = np.zeros(1)
    curve = Curve(nothing, nothing, nothing == 0.0, 0.0, falls, 0)
    assert verdict_of(tuple(End(0.0, verdict, point, 0) for verdict in verdicts), curve) == said


def test_two_valleys_are_seen_on_the_curve():
    """The optimum's valley and another that is no lower: chi-square falls between them."""
    waves = lambda at: np.stack([0.5 * at[0], 2.0 * np.sin(2.0 * at[0]), at[1]])
    optimum = np.zeros(2)
    evaluate = of(waves)
    best = linearise(evaluate, optimum)
    far = End(4.0, Verdict.BOUNDED, linearise(evaluate, np.array([4.0, 0.0])), 0)
    near = end_of(waves, optimum, 0, -1.0)
    curve = profile_curve(likelihood(evaluate, best), 0, (near, far))
    assert curve.falls > 0.2 and curve.missed > 0.2
    assert verdict_of((near, far), curve).startswith("several minima")
