"""Noise of any colour, on an even grid or at any times: products are those of the dense matrix, colour is found."""

import numpy as np
import pytest
from marks import slow
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from pdssjax.metrics import (
    NoiseInTime,
    StationaryNoise,
    fit_noise,
    grid_positions,
    neighbour_scatter,
    noise_in_time,
    sample_autocovariance,
    stationary_noise,
    toeplitz_product,
)
from pdssjax.metrics.coloured_noise import _deviances

RANDOM = np.random.default_rng(5)
EVERYWHERE = np.arange(4000)


def made(coefficients, count=4000, moving=(1.0,)):
    """Samples of a noise, settled."""
    return lfilter(moving, [1.0, *(-np.asarray(coefficients))], RANDOM.normal(size=count + 500))[500:]


def test_the_autocovariance_of_an_ar1_is_the_textbook_s():
    noise = StationaryNoise(np.array([0.8]), 2.0)
    np.testing.assert_allclose(
        noise.autocovariance(300), 2.0 / (1 - 0.64) * 0.8 ** np.arange(300), rtol=1e-10, atol=1e-14
    )


def test_white_noise_has_none_but_its_variance():
    np.testing.assert_allclose(StationaryNoise(np.zeros(0), 3.0).autocovariance(5), [3.0, 0, 0, 0, 0], atol=1e-15)


@pytest.mark.parametrize("missing", [[], [3, 4, 17]], ids=["whole", "with gaps"])
def test_products_are_those_of_the_dense_matrix(missing):
    places = np.delete(np.arange(60), missing)
    c = 1.3 * 0.7 ** np.arange(60)
    columns = RANDOM.normal(size=(places.size, 4))
    dense = toeplitz(c)[np.ix_(places, places)] @ columns
    np.testing.assert_allclose(toeplitz_product(c, columns, places), dense, rtol=1e-12, atol=1e-12)


def test_sample_autocovariances_are_the_sums_of_products():
    values = RANDOM.normal(size=30)
    expected = [values[: 30 - k] @ values[k:] / 30 for k in range(6)]
    np.testing.assert_allclose(sample_autocovariance(values, np.arange(30), 6), expected, rtol=1e-10)


def test_samples_that_share_a_place_count_by_their_pairs():
    values, places = np.array([1.0, 2.0, -3.0, 5.0]), np.array([0, 0, 1, 3])
    expected = np.array([39.0 / 4.0, (1.0 + 2.0) * -3.0 / 2.0, -15.0, (1.0 + 2.0) * 5.0 / 2.0]) * (
        1.0 - np.arange(4) / 4.0
    )
    np.testing.assert_allclose(sample_autocovariance(values, places, 4), expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("coefficients", "missing"),
    [
        ([], 0.0),
        ([], 0.3),
        ([0.5], 0.0),
        ([0.5], 0.3),
        ([0.9], 0.0),
        ([0.9], 0.3),
        ([2 * 0.9 * np.cos(0.6), -0.81], 0.0),
    ],
)
def test_the_long_run_variance_of_a_noise_is_found(coefficients, missing):
    """What a slow parameter's error is made of: the sum over all lags."""
    exact = 1.0 / (1.0 - np.sum(coefficients)) ** 2
    found = []
    for _ in range(20):
        values = np.where(RANDOM.random(4000) < missing, np.nan, made(coefficients))
        seen = float(np.sum(np.isfinite(values)))
        noise = stationary_noise(values, EVERYWHERE, seen, 50)
        found.append(noise.innovation / (1.0 - noise.coefficients.sum()) ** 2)
    assert np.mean(found) == pytest.approx(exact, rel=0.12)


def test_noise_that_is_no_autoregression_is_found_too():
    moving = np.ones(8)
    found = [stationary_noise(made([], moving=moving), EVERYWHERE, 4000.0, 50) for _ in range(20)]
    c = np.mean([noise.autocovariance(12) for noise in found], axis=0)
    np.testing.assert_allclose(c, np.maximum(8.0 - np.arange(12), 0.0), atol=0.6)


def test_variances_grow_by_the_freedom_that_a_fit_took():
    values = made([0.5])
    whole, less = (stationary_noise(values, EVERYWHERE, freedom, 0).innovation for freedom in (4000.0, 2000.0))
    assert less == pytest.approx(2.0 * whole)


@pytest.mark.parametrize("values", [np.zeros(50), np.full(50, np.nan), np.ones(1)], ids=["zero", "NaN", "one sample"])
def test_samples_that_say_nothing_are_no_trouble(values):
    noise = stationary_noise(values, np.arange(values.size), float(values.size), 10)
    assert np.isfinite(noise.autocovariance(5)).all()


def test_a_gap_in_an_even_grid_stays_a_gap():
    time = np.delete(0.2 + 1e-3 * np.arange(100), [10, 11, 40])
    assert grid_positions(time).tolist() == np.delete(np.arange(100), [10, 11, 40]).tolist()


@pytest.mark.parametrize("time", [np.cumsum(RANDOM.random(50)), np.array([0.0, 1.0, 1e9])])
def test_times_on_no_grid_have_no_places(time):
    assert grid_positions(time) is None


def test_neighbours_scatter_by_the_white_noise_whatever_moves_slowly():
    time = np.linspace(0.0, 1.0, 4000)
    found = neighbour_scatter(5.0 * np.sin(3.0 * time) + np.where(time < 0.01, 400.0 * time, 4.0) + made([]))
    assert found == pytest.approx(1.0, rel=0.05)
    assert neighbour_scatter(np.array([1.0, 3.0])) == 1.0


DICE = np.random.default_rng(7)


def clock(kind, count):
    """Times within 40 ms: half of the samples nine times as dense, intervals in a geometric row, or at random."""
    gaps = {
        "dense": np.repeat([1.0, 9.0], count // 2)[1:],
        "geometric": np.geomspace(1.0, 100.0, count - 1),
        "random": DICE.random(count - 1),
    }[kind]
    return 40e-3 * np.append(0.0, np.cumsum(gaps)) / np.sum(gaps)


def drawn_from(noise, time, draws):
    """Draws of a `noise`, one a column."""
    dense = noise.covariance_at(time[:, None] - time)
    return np.linalg.cholesky(dense + 1e-12 * noise.variance * np.eye(time.size)) @ DICE.normal(size=(time.size, draws))


@pytest.mark.parametrize("noise", [NoiseInTime(2.0, 0.7, 3e-3, 2000.0), NoiseInTime(2.0, 0.9, 3e-3), NoiseInTime(3.0)])
def test_products_at_any_times_are_those_of_the_dense_matrix(noise):
    time, columns = clock("geometric", 700), DICE.normal(size=(700, 3))
    dense = noise.covariance_at(time[:, None] - time)
    np.testing.assert_allclose(noise.covariance_product(columns, time), dense @ columns, rtol=1e-11, atol=1e-11)
    assert noise.independent_share(time) == pytest.approx(700 * noise.variance**2 / np.sum(dense**2), rel=1e-10)


def test_the_likelihood_is_that_of_the_dense_matrix():
    time = clock("dense", 200)
    values = drawn_from(NoiseInTime(1.0, 0.8, 2e-3, 900.0), time, 1)[:, 0]
    values /= np.sqrt(np.mean(values**2))
    dense = NoiseInTime(1.0, 0.7, 3e-3, 500.0).covariance_at(time[:, None] - time)
    level = values @ np.linalg.solve(dense, values) / 200
    found = _deviances(np.diff(time, prepend=0.0)[None], values[None], np.array([[0.7 / 0.3, 3e-3, 1.5]]))
    assert float(found[1][0]) == pytest.approx(level, rel=1e-10)
    assert float(found[0][0]) == pytest.approx(200 * np.log(level) + np.linalg.slogdet(dense)[1], rel=1e-10)


NOISES = NoiseInTime(1.0, 0.99, 1e-3), NoiseInTime(1.0, 0.6, 1e-3), NoiseInTime(1.0, 0.99, 1e-3, 4000.0)


@pytest.mark.parametrize(
    ("kind", "noise"),
    [
        (kind, noise) if i == k else slow(kind, noise)
        for i, kind in enumerate(["dense", "geometric", "random"])
        for k, noise in enumerate(NOISES)
    ],
)
def test_slow_and_ringing_noise_beside_white_noise_is_found(kind, noise):
    """By what it makes of the mean and of a wave: neighbours taken for evenly spaced are off by factors of 2 to 6."""
    time = clock(kind, 400)
    waves = np.stack([np.ones(400), np.cos(1500.0 * time)], axis=1)
    exact = np.sum(waves * noise.covariance_product(waves, time), axis=0)
    found = [noise_in_time(values, time, 400.0) for values in drawn_from(noise, time, 20).T]
    ratios = np.mean([np.sum(waves * other.covariance_product(waves, time), axis=0) for other in found], axis=0) / exact
    assert np.all((ratios > 0.6) & (ratios < 1.6)), ratios


def test_white_noise_is_white_and_its_variance_grows_by_the_freedom_that_a_fit_took():
    time = clock("geometric", 400)
    found = [noise_in_time(values, time, 200.0) for values in DICE.normal(size=(20, 400))]
    assert sum(noise.order == 0 for noise in found) >= 18
    assert np.mean([noise.variance for noise in found]) == pytest.approx(2.0, rel=0.1)


def test_the_grid_decides_which_noise_is_looked_for_and_what_says_nothing_is_no_trouble():
    values = DICE.normal(size=100)
    assert isinstance(fit_noise(1e-3 * np.arange(100), values, 100.0, 10), StationaryNoise)
    assert isinstance(fit_noise(clock("random", 100), values, 100.0, 10), NoiseInTime)
    for silent in (np.zeros(100), np.full(100, np.nan)):
        assert fit_noise(clock("random", 100), silent, 100.0, 10).variance == 0.0
