"""Draws from a posterior whose parameters end at bounds, beside densities in closed form."""

import jax.numpy as jnp
import numpy as np
import pytest
from drawn_posteriors import DESIGN, EVERYWHERE, both, drawn, linear, slow_nuts
from scipy import stats

from pdssjax import Drawing
from pdssjax.metrics import effective_size, rhat


@slow_nuts
@pytest.mark.parametrize("beyond", [0.0, 300.0, pytest.param(3.0, marks=pytest.mark.slow)])
def test_of_an_optimum_at_a_bound_they_have_the_moments_of_a_truncated_normal(sampler, beyond):
    """Without the bound it would lie so many standard deviations `beyond`."""
    covariance = np.linalg.inv(DESIGN.T @ DESIGN)
    deviation, slope = np.sqrt(covariance[0, 0]), covariance[0, 1] / covariance[0, 0]
    free = np.array([-beyond * deviation, 0.0])
    chains = drawn(
        lambda x: linear(x - free),
        [0.0, -slope * free[0]],
        Drawing(1000, seed=5, sampler=sampler),
        (np.array([0.0, -np.inf]), EVERYWHERE[1]),
    )
    assert chains.failed < 0.4 * chains.free[:, :, 0].size
    exact = stats.truncnorm(beyond, np.inf, free[0], deviation)
    draws = chains.free[:, :, 0]
    size = effective_size(draws)
    assert np.min(draws) >= 0.0 and rhat(draws) < 1.01 and size > 400
    assert np.mean(draws) == pytest.approx(exact.mean(), abs=4.0 * exact.std() / np.sqrt(size))
    assert np.std(draws) == pytest.approx(exact.std(), rel=4.0 * np.sqrt(2.0 / effective_size(draws**2)))
    other = chains.free[:, :, 1] - slope * (draws - free[0])
    left = np.sqrt(covariance[1, 1] - slope * covariance[0, 1])
    assert np.mean(other) == pytest.approx(0.0, abs=4.0 * left / np.sqrt(effective_size(other)))
    assert np.std(other) == pytest.approx(left, rel=4.0 * np.sqrt(0.5 / effective_size(other**2)))


@pytest.mark.slow
@both
def test_of_an_optimum_at_a_corner_they_are_there(sampler):
    """All parameters at bounds, one of them an upper one: a density that falls off as two exponentials."""
    rates = np.array([50.0, 7.0])
    residuals = lambda x: jnp.stack([1e3 + rates[0] * x[0] / 1e3, 1e3 - rates[1] * x[1] / 1e3, 0.0 * x[0]])
    low, high = np.array([2.0, -np.inf]), np.array([np.inf, 3.0])
    chains = drawn(residuals, [2.0, 3.0], Drawing(1000, seed=6, sampler=sampler), (low, high))
    for i, inside in enumerate((chains.free[:, :, 0] - 2.0, 3.0 - chains.free[:, :, 1])):
        size = effective_size(inside)
        assert np.min(inside) >= 0.0 and rhat(inside) < 1.01 and size > 400
        assert np.mean(inside) * rates[i] == pytest.approx(1.0, abs=4.0 / np.sqrt(size))
        assert np.mean(inside * rates[i] > 3.0) == pytest.approx(np.exp(-3.0), abs=0.2 * np.exp(-3.0))
