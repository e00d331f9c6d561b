"""Noise at times on no even grid: its likelihood and products are those of the dense matrix, its colour is found."""

import numpy as np
import pytest
from marks import slow

from pdssjax.metrics import NoiseInTime, StationaryNoise, noise_at, noise_in_time
from pdssjax.metrics.coloured_noise import _deviances

RANDOM = np.random.default_rng(7)


def clock(kind, count):
    """Times within 40 ms: half of the samples nine times as dense, intervals in a geometric row, or at random."""
    gaps = {
        "dense": np.repeat([1.0, 9.0], count // 2)[1:],
        "geometric": np.geomspace(1.0, 100.0, count - 1),
        "random": RANDOM.random(count - 1),
    }[kind]
    return 40e-3 * np.append(0.0, np.cumsum(gaps)) / np.sum(gaps)


def made(noise, time, draws):
    """Draws of a `noise`, one a column."""
    dense = noise.covariance_at(time[:, None] - time)
    return np.linalg.cholesky(dense + 1e-12 * noise.variance * np.eye(time.size)) @ RANDOM.normal(
        size=(time.size, draws)
    )


@pytest.mark.parametrize("noise", [NoiseInTime(2.0, 0.7, 3e-3, 2000.0), NoiseInTime(2.0, 0.9, 3e-3), NoiseInTime(3.0)])
def test_products_are_those_of_the_dense_matrix(noise):
    time, columns = clock("geometric", 700), RANDOM.normal(size=(700, 3))
    dense = noise.covariance_at(time[:, None] - time)
    np.testing.assert_allclose(noise.covariance_product(columns, time), dense @ columns, rtol=1e-11, atol=1e-11)
    assert noise.independent(time) == pytest.approx(700 * noise.variance**2 / np.sum(dense**2), rel=1e-10)


def test_the_likelihood_is_that_of_the_dense_matrix():
    time = clock("dense", 200)
    values = made(NoiseInTime(1.0, 0.8, 2e-3, 900.0), time, 1)[:, 0]
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
    found = [noise_in_time(values, time, 400.0) for values in made(noise, time, 20).T]
    ratios = np.mean([np.sum(waves * other.covariance_product(waves, time), axis=0) for other in found], axis=0) / exact
    assert np.all((ratios > 0.6) & (ratios < 1.6)), ratios


def test_white_noise_is_white_and_its_variance_grows_by_the_freedom_that_a_fit_took():
    time = clock("geometric", 400)
    found = [noise_in_time(values, time, 200.0) for values in RANDOM.normal(size=(20, 400))]
    assert sum(noise.order == 0 for noise in found) >= 18
    assert np.mean([noise.variance for noise in found]) == pytest.approx(2.0, rel=0.1)


def test_the_grid_decides_which_noise_is_looked_for_and_what_says_nothing_is_no_trouble():
    values = RANDOM.normal(size=100)
    assert isinstance(noise_at(1e-3 * np.arange(100), values, 100.0, 10), StationaryNoise)
    assert isinstance(noise_at(clock("random", 100), values, 100.0, 10), NoiseInTime)
    for silent in (np.zeros(100), np.full(100, np.nan)):
        assert noise_at(clock("random", 100), silent, 100.0, 10).variance == 0.0
