"""The bound on steps follows the quickest transient of a field, in closed form for two components."""

import math

import jax.numpy as jnp
import pytest

from pdssjax.integration import SETTLED
from pdssjax.integration.one_step import longest_step

RATE, DAMPING, SPAN = 6736.0, 0.1772, 16.0 / 3.0


def oscillator(t_local, x):
    """Displacement and velocity of an oscillator."""
    return x[1], -(RATE**2) * x[0] - 2.0 * DAMPING * RATE * x[1]


def bound(field, components=2, mode=1.0, closed=(), remaining=1.0):
    x = [jnp.asarray(0.1 * (i + 1)) for i in range(components)]
    return float(longest_step(field, jnp.zeros(()), x, jnp.asarray(mode), closed, SPAN, jnp.asarray(remaining)))


def test_an_oscillator_may_be_stepped_by_a_span_of_its_time_constant_whatever_its_units():
    quickest = RATE * math.sqrt(1.0 + 4.0 * DAMPING**2)
    assert bound(oscillator) == pytest.approx(SPAN / quickest)

    def in_other_units(t_local, x):
        rates = oscillator(t_local, (1e-6 * x[0], x[1]))
        return 1e6 * rates[0], rates[1]

    assert bound(in_other_units) == pytest.approx(SPAN / quickest)


def test_what_is_known_in_closed_form_only_forces_the_rest_and_may_be_spanned_longer():
    assert bound(oscillator, closed=(0, 1)) == pytest.approx(1.5 * bound(oscillator))


def test_what_only_one_component_feels_changes_nothing():
    def driven(t_local, x):
        return (*oscillator(t_local, x), -5.0 * x[2] + 1e12 * x[0])

    assert bound(driven, components=3) == pytest.approx(bound(oscillator))


@pytest.mark.parametrize("mode, remaining", [(SETTLED, 1.0), (1.0, 1e-5)])
def test_what_has_settled_and_what_ends_before_is_not_bounded(mode, remaining):
    assert bound(oscillator, mode=mode, remaining=remaining) == remaining


def test_a_slope_that_is_not_finite_bounds_nothing():
    rooted = lambda t_local, x: (*oscillator(t_local, x), (0.0 * x[2]) ** 0.5)
    assert bound(rooted, components=3) == pytest.approx(bound(oscillator))
