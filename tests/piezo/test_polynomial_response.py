"""How a lag and an oscillator follow powers of time, against their Taylor series in decimals of 200 digits."""

from decimal import Decimal, localcontext

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pdssjax.piezo._dynamics import lag_response, oscillator_response

TIMES = np.array([1e-9, 1e-4, 0.1, 0.9, 1.1, 1.8, 1.9, 2.5, 3.5, 4.1, 4.2, 5.0, 8.0, 20.0])
DAMPINGS = [0.01, 0.3, 1.0, 1.019, 1.021, 3.0, 8.0]
H = 1e-5


def followed(x, damping, degree):
    """h_0 to h_degree, by r_k' = k r_(k-1) in the equations, from where all that is left out is below 1e-100."""
    known: dict[int, Decimal] = {}
    with localcontext(prec=200):
        far = int(degree + 80 + 8 * x * (1 + 2 * (damping or 0.0)))
        x, xi = Decimal(float(x)), Decimal(damping or 0.0)
        h, before = Decimal(0), Decimal(0)
        for k in range(far, 0, -1):
            if damping is None:
                h = known[k - 1] = x / k * (1 - h)
            elif k > 1:
                h, before = x * x / (k * (k - 1)) * (1 - before) - 2 * xi * x / (k - 1) * h, h
                known[k - 2] = h
    return np.array([float(known[k]) for k in range(degree + 1)])


def check(of, x, damping, degree):
    """Values and derivatives by time at points that are compiled as one."""
    expected = np.array([followed(*at, degree) for at in zip(x, damping, strict=True)])
    arguments = jnp.asarray(x), jnp.asarray(np.array(damping, float))
    values, slopes = jax.jit(jax.vmap(lambda *at: jax.jvp(lambda x: of(x, at[1]), at[:1], (1.0,))))(*arguments)
    np.testing.assert_allclose(values, expected, rtol=4e-13)
    # r_k' = k r_(k-1) is x h_k' = k (h_(k-1) - h_k).
    difference = np.arange(1, degree + 1) * (expected[:, :-1] - expected[:, 1:])
    np.testing.assert_allclose(slopes[:, 1:] * x[:, None], difference, rtol=4e-12, atol=4e-15 * degree)


@pytest.mark.parametrize("degree", [1, 9])
def test_a_lag_follows_powers_of_time_to_rounding(degree):
    check(lambda x, _: jnp.stack(lag_response(x, degree)), TIMES, [None] * TIMES.size, degree)


# By default `test_piezos` holds an oscillator under lines, and `test_composed` a lag under powers, against SciPy.
@pytest.mark.slow
@pytest.mark.parametrize("degree", [1, 3, 9])
def test_an_oscillator_follows_powers_of_time_to_rounding(degree):
    x, damping = (grid.ravel() for grid in np.meshgrid(TIMES, DAMPINGS))
    of = lambda x, xi: jnp.stack(oscillator_response(x, xi, degree))
    check(of, x, damping, degree)
    by_damping = jax.jit(jax.vmap(lambda x, xi: jax.jvp(lambda xi: of(x, xi), (xi,), (1.0,))[1]))(x, damping)
    above, below = (
        np.array([followed(*at, degree) for at in zip(x, damping * s, strict=True)]) for s in (1 + H, 1 - H)
    )
    np.testing.assert_allclose(by_damping, (above - below) / (2 * H * damping[:, None]), rtol=1e-6, atol=1e-10)
