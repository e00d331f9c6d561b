"""Noise of any colour is told from its samples, and products with its covariance are those of the dense matrix."""

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from pdssjax.metrics import (
    StationaryNoise,
    grid_positions,
    neighbour_scatter,
    sample_autocovariance,
    stationary_noise,
    toeplitz_product,
)

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
