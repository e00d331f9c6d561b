"""The recurrence as a loop over the order against the unrolled one, side by side and with derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pdssjax import Taylor
from pdssjax.integration import constant, cosine_and_sine, exp, power
from pdssjax.integration.step_methods.base import KnownStep
from pdssjax.integration.taylor_series import taylor_coefficients

ORDER = 6
"""Of every series: high enough for all terms to show, low enough to compile fast."""


FIELDS = {
    "product": lambda t, x: [x[0] * x[1] * 0.3, x[1] * x[1] - x[0] * (t * 0.5), 0],
    "product with the same": lambda t, x: [x[0] * x[0] + (x[0] * 2.0) * (x[1] * 3.0), x[1] * x[0], 0],
    "quotient": lambda t, x: [x[1] / x[0], 1.5 / (x[0] + t), x[1] / x[2]],
    "exp": lambda t, x: [exp(x[1] * (-0.7)), exp(x[0] - x[1]) * 0.2, exp(x[2])],
    "power": lambda t, x: [power(x[0], 0.3), power(x[1], -1.6) * x[0], power(x[2], 2.5)],
    "cosine and sine": lambda t, x: [*cosine_and_sine(x[0] + 2.0 * t), cosine_and_sine(x[2])[0]],
    "constants": lambda t, x: [x[2] * x[2] + constant(x[0]), 0.4, 0],
    "a component at rest": lambda t, x: [x[0] * x[2], x[2] / x[0], 0],
}
STATES = jnp.array([[0.8, 1.1, 0.6], [1.7, 0.4, 2.0], [1.0, 1.0, 1.0]])
"""Three solutions side by side, each with its three components."""


def unrolled(field, states):
    """Coefficients, shape (solutions, components, ORDER + 1)."""

    def coefficients(state):
        known = taylor_coefficients(field, jnp.asarray(0.3), list(state), ORDER, 1.0)
        return jnp.stack([jnp.stack([jnp.asarray(c, float) for c in row]) for row in known])

    return jax.vmap(coefficients)(states)


def looped(field, states):
    """The same by the loop."""
    step = lambda state: KnownStep(field, jnp.asarray(0.3), list(state), [], jnp.asarray(1.0))
    return jnp.stack(Taylor(ORDER).expand(step, states)).transpose(2, 0, 1)


def assert_same(found, expected, rounding=1e-13):
    """Equal to rounding, each coefficient measured by the largest one of its component and order."""
    found, expected = np.asarray(found), np.asarray(expected)
    assert np.isfinite(expected).all()
    size = np.max(np.abs(expected), axis=0, keepdims=True)
    assert np.max(np.abs(found - expected) / (size + 1e-300)) < rounding


@pytest.mark.parametrize("name", FIELDS)
def test_every_operation_gives_the_unrolled_coefficients_and_their_derivatives(name):
    rate = jnp.asarray(0.9)

    def values_and_slopes(expand):
        scaled = lambda p, s: expand(lambda t, x: [0 if isinstance(r, int) else r * p for r in FIELDS[name](t, x)], s)
        directions = jnp.eye(1 + STATES.shape[1])
        along = lambda d: jax.jvp(scaled, (rate, STATES), (d[0], jnp.broadcast_to(d[1:], STATES.shape)))
        return jax.vmap(along, out_axes=(None, 0))(directions)

    (values, slopes), (expected, right) = jax.jit(lambda: (values_and_slopes(looped), values_and_slopes(unrolled)))()
    assert_same(values, expected)
    for slope, expected_slope in zip(slopes, right, strict=True):
        assert_same(slope, expected_slope, 1e-12)
