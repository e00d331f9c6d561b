"""Distances from a bound as normal numbers, against SciPy and there and back; which parameters have one."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from pdssjax.inference.uncertainty.at_bounds import AtBounds, at_bounds
from pdssjax.inference.uncertainty.posterior import principal_axes
from pdssjax.inference.uncertainty.second_order import Linearisation

E = np.linspace(-6.0, 9.0, 31)


def held(end):
    """As many parameters as E has, at the same bound."""
    return AtBounds(np.zeros(E.size), np.eye(E.size), np.full(E.size, 3.0), np.full(E.size, end))


@pytest.mark.parametrize("end", [np.inf, 40.0, 1.0, 1e-3])
def test_normal_numbers_are_those_of_a_truncated_exponential(end):
    of = held(end)
    scaled = np.asarray(of.scaled_of(jnp.asarray(E)))
    exact = stats.expon.ppf(stats.norm.cdf(E)) if np.isinf(end) else stats.truncexpon(end).ppf(stats.norm.cdf(E))
    np.testing.assert_allclose(scaled[:26], exact[:26], rtol=1e-6, atol=1e-15)  # cdf is 1 to rounding further up
    inside = (E < 5.0) | np.isinf(end)  # nearer to the other bound rounding tells
    np.testing.assert_allclose(np.asarray(of.normal_of(jnp.asarray(scaled)))[inside], E[inside], atol=1e-4)
    slopes = np.asarray(jax.vmap(jax.grad(lambda e, i: of.scaled_of(jnp.full(E.size, e))[i]))(E, np.arange(E.size)))
    np.testing.assert_allclose(
        -np.log(slopes)[:26], np.asarray(of.log_slope(jnp.asarray(E)))[:26], rtol=1e-9, atol=1e-9
    )


def test_beyond_a_bound_there_is_no_normal_number():
    of = AtBounds(np.zeros(3), np.eye(3), np.ones(3), np.full(3, 2.0))
    assert np.isnan(np.asarray(of.normal_of(jnp.array([-0.1, 2.1, 1.0])))).tolist() == [True, True, False]


def test_those_at_bounds_are_found_with_the_slope_and_bend_that_others_leave():
    """Of x0, at its lower bound, and x2, at its upper one; x1 is free and takes up a part of what x0 changes."""
    jacobian = np.array([[3.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 2.0], [1.0, 0.0, 0.0]])
    residual = np.array([0.0, 0.0, -50.0, 4.0])  # at right angles to the column of x1
    optimum = Linearisation(np.array([1.0, 0.0, 5.0]), residual, jacobian)
    axes = principal_axes(optimum, np.arange(3), 2.0)
    bounds = np.array([1.0, -np.inf, -np.inf]), np.array([np.inf, np.inf, 5.0])
    found = at_bounds(optimum, axes, np.arange(3), bounds, 2.0, np.array([0.5, 0.0, 0.0]))
    np.testing.assert_allclose(found.rows, [axes[0], -axes[2]])
    np.testing.assert_array_equal(found.begin, [0.0, 0.0])
    # g = r' J / v less the prior's slope; h of x0: 9 + 1 less the 9 / 2 that x1 takes up, over v.
    means = [1.5 / 1.5, 0.0]
    for number, (slope, bend) in enumerate([(4.0 / 2.0 - 0.5, 5.5 / 2.0), (100.0 / 2.0, 4.0 / 2.0)]):
        cut = stats.truncnorm(slope / np.sqrt(bend), np.inf, -slope / bend, 1.0 / np.sqrt(bend))
        means[number] = cut.mean()
    np.testing.assert_allclose(1.0 / found.rates, means, rtol=2e-3)
    none = at_bounds(optimum, axes, np.arange(3), (np.full(3, -np.inf), np.full(3, np.inf)), 2.0, np.zeros(3))
    assert none.rates.size == 0 and none.free_directions().shape == (3, 3)
