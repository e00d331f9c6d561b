"""Coordinates of a posterior: there and back, derivatives, and a damping that may be zero."""

import jax
import jax.numpy as jnp
import numpy as np

from pdssjax.inference.uncertainty.drawn_intervals import (
    InCoordinates,
    PosteriorCoordinates,
    posterior_coordinates,
)
from pdssjax.inference.uncertainty.second_order import Linearisation

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
