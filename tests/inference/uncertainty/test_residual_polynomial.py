"""Polynomials of residuals: exact of what is one, near of what is not, and as large as their terms say."""

from itertools import combinations_with_replacement
from math import comb

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pdssjax.inference.uncertainty.residual_polynomial import count_terms, degree_for, learned_polynomial, terms
from pdssjax.inference.uncertainty.second_order import Linearisation

AXES = np.diag([0.3, 0.1, 0.2])
CENTRE = np.array([1.0, -2.0, 0.5])


def cubic(x):
    z = (x - CENTRE) / jnp.diag(AXES)
    rows = [z[0] - z[1] ** 2, z[1] + 0.2 * z[0] * z[1] * z[2], z[2] + 0.1 * z[2] ** 3, 0.3 + z[0] * z[2]]
    return jnp.stack(rows * 3)


def points(residuals, count, seed=0):
    both = jax.jit(lambda at: (residuals(at), jax.jacfwd(residuals)(at)))
    evaluate = lambda at: Linearisation(at, *map(np.asarray, both(at)))
    random = np.random.default_rng(seed)
    return evaluate(CENTRE), [evaluate(CENTRE + AXES @ random.standard_normal(3)) for _ in range(count)]


def test_the_terms_are_all_products_up_to_a_degree():
    z = np.array([2.0, 3.0, 5.0])
    found = np.asarray(terms(jnp.asarray(z), 3))
    assert found.size == count_terms(3, 3) == comb(6, 3)
    expected = [1, 2, 3, 5, 4, 6, 10, 9, 15, 25, 8, 12, 20, 18, 30, 50, 27, 45, 75, 125]
    np.testing.assert_array_equal(found, expected)
    assert terms(jnp.asarray(z), 2).size == count_terms(3, 2) == comb(5, 2)
    fourth = np.asarray(terms(jnp.asarray(z), 4))
    products = [np.prod(chosen) for chosen in combinations_with_replacement(z, 4)]
    np.testing.assert_array_equal(fourth, [*expected, *products])


@pytest.mark.parametrize(
    ("directions", "most", "degree"),
    [(1, 3, 3), (9, 3, 3), (16, 3, 3), (17, 3, 2), (40, 3, 2), (9, 4, 4), (10, 4, 3), (17, 4, 2), (40, 2, 2)],
)
def test_many_directions_allow_a_low_order_only(directions, most, degree):
    assert degree_for(directions, most) == degree


def test_a_cubic_is_found_from_fewer_points_than_it_has_terms():
    optimum, others = points(cubic, 12)
    polynomial = learned_polynomial(optimum, others, AXES, 1.0).turned()
    both = jax.jit(lambda at: (polynomial(at), jax.jacfwd(polynomial)(at)))
    for point in points(cubic, 20, seed=1)[1]:
        turned, slope = map(np.asarray, both(point.at))
        assert np.sum(turned**2) == pytest.approx(point.chi2, rel=1e-4, abs=1e-4)
        np.testing.assert_allclose(slope.T @ turned, point.jacobian.T @ point.residual, rtol=1e-3, atol=1e-2)


def quartic(x):
    z = (x - CENTRE) / jnp.diag(AXES)
    return cubic(x) + 0.3 * jnp.stack([z[0] ** 4, z[0] ** 2 * z[1] * z[2], z[2] ** 4 - z[1] ** 3 * z[0]] * 4)


def test_a_quartic_is_found_where_points_determine_it():
    optimum, others = points(quartic, 20)
    at = [point.at for point in points(quartic, 20, seed=1)[1]]
    exact = np.array([float(jnp.sum(quartic(jnp.asarray(x)) ** 2)) for x in at])
    found = learned_polynomial(optimum, others, AXES, 1.0, most=4)
    assert found.degree == 4
    polynomial = found.turned()
    np.testing.assert_allclose([float(jnp.sum(polynomial(jnp.asarray(x)) ** 2)) for x in at], exact, rtol=1e-3)
    # A polynomial of third order from the same points is not this one.
    third = learned_polynomial(optimum, others, AXES, 1.0).turned()
    assert not np.allclose([float(jnp.sum(third(jnp.asarray(x)) ** 2)) for x in at], exact, rtol=0.05)
    few = learned_polynomial(optimum, others[:6], AXES, 1.0, most=4)
    assert few.degree == 3  # 7 points with 4 numbers of each sample, and 35 coefficients


def test_what_lies_far_above_or_cannot_be_simulated_takes_no_part():
    optimum, others = points(cubic, 12)
    whole = learned_polynomial(optimum, others, AXES, 1.0).turned()
    broken = Linearisation(CENTRE + 0.1, np.full(12, np.nan), np.full((12, 3), np.nan))
    far = Linearisation(CENTRE - 0.1, np.full(12, 50.0), np.zeros((12, 3)))
    same = learned_polynomial(optimum, [*others, broken, far], AXES, 1.0).turned()
    np.testing.assert_allclose(same(jnp.asarray(CENTRE + 0.05)), whole(jnp.asarray(CENTRE + 0.05)))


def test_the_nearest_are_used_where_all_lie_far_above():
    shifted = lambda x: cubic(x) + 100.0 * (x[0] - CENTRE[0])
    optimum, others = points(shifted, 12)
    assert min(point.chi2 for point in others) > 0.0
    polynomial = learned_polynomial(optimum, others, AXES, 1e-6).turned()
    turned = polynomial(jnp.asarray(others[0].at))
    assert float(jnp.sum(turned**2)) == pytest.approx(others[0].chi2, rel=1e-2)
