"""The Taylor series as a solver of diffrax: Van der Pol's equation beside SciPy, and what it refuses."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from scipy.integrate import solve_ivp

from pdssjax import InputError, TaylorSolver
from pdssjax.integration.taylor_solver import taylor_of

TIMES = np.linspace(0.0, 20.0, 41)
START = {"x": jnp.array(2.0), "v": jnp.array(0.0)}


def van_der_pol(t, y, mu):
    return {"x": y["v"], "v": mu * (1.0 - y["x"] ** 2) * y["v"] - y["x"]}


def solved(solver):
    control = diffrax.PIDController(rtol=1e-12, atol=1e-12)
    term, saved = diffrax.ODETerm(van_der_pol), diffrax.SaveAt(ts=jnp.asarray(TIMES))
    return diffrax.diffeqsolve(term, solver, 0.0, 20.0, 1e-3, START, 5.0, stepsize_controller=control, saveat=saved)


def test_van_der_pol_takes_a_hundred_steps_and_agrees_with_scipy_between_them():
    found = solved(TaylorSolver())
    field = lambda t, y: [y[1], 5.0 * (1.0 - y[0] ** 2) * y[1] - y[0]]
    beside = solve_ivp(field, (0.0, 20.0), [2.0, 0.0], "DOP853", TIMES, rtol=3e-14, atol=1e-14)
    np.testing.assert_allclose(found.ys["x"], beside.y[0], atol=2e-10)
    np.testing.assert_allclose(found.ys["v"], beside.y[1], atol=1e-9)
    # 99 accepted and 130 in all when this was written.
    assert int(found.stats["num_accepted_steps"]) <= 105
    assert int(found.stats["num_steps"]) <= 150


def test_the_coefficients_are_those_of_the_solution():
    # y' = t + y from y = 0: e^t - 1 - t; and the exponential of a matrix of arrays.
    first = taylor_of(lambda t, y: t + y, jnp.zeros(()), 6)
    np.testing.assert_allclose(first, [0.0, 0.0, *(1.0 / np.cumprod(np.arange(1.0, 7.0))[1:])], rtol=1e-14)
    turned = taylor_of(lambda t, y: (jnp.array([[0.0, 1.0], [-1.0, 0.0]]) @ y[0],), (jnp.array([1.0, 0.0]),), 4)
    np.testing.assert_allclose(turned[0], [[1, 0], [0, -1], [-0.5, 0], [0, 1 / 6], [1 / 24, 0]], rtol=1e-14)


def test_a_field_that_cannot_be_expanded_is_refused():
    loop = lambda t, y: lax.while_loop(lambda c: c < 1.0, lambda c: c + 1.0, y)
    with pytest.raises(NotImplementedError, match=r"TaylorSolver: the field has an operation that .* cannot expand"):
        jax.eval_shape(lambda y: taylor_of(loop, y, 3), jnp.ones(()))


def test_what_is_no_order_and_no_real_state_is_refused():
    with pytest.raises(InputError, match="order: found 1, expected a whole number of at least 2"):
        TaylorSolver(1)
    with pytest.raises(InputError, match="y0: found an array of complex128, expected real"):
        TaylorSolver().init(None, 0.0, 1.0, jnp.ones(2) + 1j, None)
    with pytest.raises(InputError, match="y0: found an array of float32, expected real arrays of float64"):
        TaylorSolver().init(None, 0.0, 1.0, {"x": jnp.ones(2, jnp.float32)}, None)
