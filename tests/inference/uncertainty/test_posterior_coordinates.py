"""Coordinates of a posterior: there and back, derivatives, and a damping that may be zero."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from pdssjax import Drawing
from pdssjax.inference.uncertainty.drawn_intervals import (
    InCoordinates,
    PosteriorCoordinates,
    posterior_coordinates,
)
from pdssjax.inference.uncertainty.posterior import sample_posterior
from pdssjax.inference.uncertainty.posterior_model import posterior_model
from pdssjax.inference.uncertainty.second_order import Linearisation
from pdssjax.metrics import effective_size, rhat

X = np.array([np.log(2.0), np.log(10.0), 0.1, np.log(5.0), np.log(7.0)])
ERRORS = np.array([0.5, 0.1, 0.5, 0.5, 0.5])
"""Of the fit's numbers: of a logarithm it is relative."""
BOUNDS = np.full(5, -3.0), np.array([np.inf, np.inf, np.inf, 2.0, np.inf])
COORDINATES = posterior_coordinates(
    Linearisation(X, np.zeros(5), np.diag(1.0 / ERRORS)),
    np.array([0, 1, 2, 3]),
    BOUNDS,
    1.0,
    np.array([True, True, False, True, True]),
)
"""Near zero, far from it, no logarithm, nearer to its upper bound, and one that does not move."""


def test_values_are_drawn_where_zero_is_near_and_logarithms_where_it_is_not():
    np.testing.assert_array_equal(COORDINATES.by_value, [True, False, False, False, False])
    y = COORDINATES.of_fit(X)
    np.testing.assert_allclose(y, [2.0, *X[1:]])  # a unit is a standard error, 1
    np.testing.assert_allclose(COORDINATES.to_fit(y), X)
    np.testing.assert_allclose(COORDINATES.to_fit(np.stack([y, y])), [X, X])
    np.testing.assert_allclose(np.diag(COORDINATES.slopes(y)), jax.jacfwd(COORDINATES.to_fit)(y))
    low, high = COORDINATES.bounds((np.full(5, -np.inf), BOUNDS[1]))
    np.testing.assert_allclose(low, [1e-6, *[-np.inf] * 4])
    np.testing.assert_allclose(high, BOUNDS[1])


def residuals(x):
    """Of a damping exp(x0), measured as 0.02 and 0.06 with an error of 0.1, in a valley with another number."""
    damping = jnp.exp(x[0])
    return jnp.stack([(damping - 0.02) / 0.1, (damping - 0.06) / 0.1, x[1] - 30.0 * damping, 2.0 * x[1] + damping])


def test_derivatives_are_by_the_coordinates():
    coordinates = PosteriorCoordinates(np.array([True, False]), np.array([0.07, 1.0]))
    evaluate = lambda x: (residuals(x), jax.jacfwd(residuals)(x))
    y = jnp.array([0.7, 0.3])
    residual, jacobian = InCoordinates(evaluate, coordinates)(y)
    there = lambda y: residuals(coordinates.to_fit(y))
    np.testing.assert_allclose(residual, there(y))
    np.testing.assert_allclose(jacobian, jax.jacfwd(there)(y))
    x = np.asarray(coordinates.to_fit(y))
    point = coordinates.linearised(Linearisation(x, *map(np.asarray, evaluate(x))))
    np.testing.assert_allclose(point.at, y)
    np.testing.assert_allclose(point.jacobian, jacobian)


@pytest.mark.slow
@pytest.mark.parametrize("measured", [pytest.param(0.04, marks=pytest.mark.slow), -0.02])
def test_a_damping_that_may_be_zero_is_a_normal_distribution_cut_off_there(measured):
    """Measured below zero it is fitted at its bound, where residuals have no derivative by its logarithm."""
    error, lowest = 0.1, 1e-6
    residuals = lambda x: jnp.concatenate([jnp.stack([(jnp.exp(x[0]) - measured) / error, x[1]]), jnp.zeros(5)])
    linearise = jax.jit(lambda x: (residuals(x), jax.jacfwd(residuals)(x)))
    at = np.array([np.log(max(measured, lowest)), 0.0])
    fitted = Linearisation(at, *map(np.asarray, linearise(at)))
    bounds = np.array([np.log(lowest), -np.inf]), np.full(2, np.inf)
    coordinates = posterior_coordinates(fitted, np.arange(2), bounds, 1.0, np.array([True, False]))
    model = posterior_model(
        InCoordinates(linearise, coordinates),
        jax.jit(lambda y: residuals(coordinates.to_fit(y))),
        coordinates.linearised(fitted),
        np.arange(2),
        coordinates.bounds(bounds),
        np.zeros(2, bool),
        1.0,
        None,
        lambda message: None,
    )
    chains = sample_posterior(model, Drawing(1000, seed=1), None, lambda message: None)
    damping = np.exp(np.asarray(coordinates.to_fit(chains.free)))[:, :, 0]
    exact = stats.truncnorm(-measured / error, np.inf, measured, error)
    size = effective_size(damping)
    assert rhat(damping) < 1.01 and size > 1000
    assert np.mean(damping) == pytest.approx(exact.mean(), abs=4.0 * exact.std() / np.sqrt(size))
    np.testing.assert_allclose(np.quantile(damping, 0.975), exact.ppf(0.975), rtol=0.05)
