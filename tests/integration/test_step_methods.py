"""Steps: any one-step solver, the bound on their length, and Taylor series as a solver and as a loop over the order."""

import math

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from rigs import SAMPLES, models, trajectory, values
from scipy.integrate import solve_ivp

from pdssjax import Accuracy, InputError, OneStep, Taylor, TaylorSolver, simulate
from pdssjax.integration import SETTLED, TIGHT, constant, cosine_and_sine, exp, power
from pdssjax.integration.one_step import longest_step
from pdssjax.integration.step_methods.base import KnownStep
from pdssjax.integration.taylor_series import taylor_coefficients
from pdssjax.integration.taylor_solver import taylor_of
from tests.reference.independent import Rig

TIMES = 0.00031 + np.arange(SAMPLES) * 0.0034
"""Two drops at 5 Hz."""
STIFF = Rig(mass=0.1, s0=(1.67e6, 1.67e6), s1=(6000.0, 6000.0), f_ss=(3.0, 3.0), voltage=30.0)
"""The contact of Liu's actuator as published: overdamped by a factor of 7."""
LONG = np.linspace(0.01, 0.6, SAMPLES)


def run_with(accuracy: Accuracy, rig: Rig, times: np.ndarray):
    return jax.jit(lambda numbers: simulate(*models(numbers, rig.reading, rig.feedback), times, accuracy))(values(rig))


@pytest.mark.parametrize(
    "solver",
    [
        diffrax.Tsit5(),
        pytest.param(diffrax.Dopri8(), marks=pytest.mark.slow),
        pytest.param(diffrax.Kvaerno5(), marks=pytest.mark.slow),
        pytest.param(diffrax.HalfSolver(diffrax.Midpoint()), marks=pytest.mark.slow),
    ],
    ids=lambda solver: type(solver).__name__,
)
def test_solvers_of_diffrax_agree_with_the_series(solver):
    second_order = isinstance(solver, diffrax.HalfSolver)  # of second order: small tolerances would take for ever
    run = run_with(Accuracy(3e-11 if second_order else 1e-12, method=OneStep(solver), max_steps=16384), Rig(), TIMES)
    exact = trajectory(Rig(), TIMES, TIGHT)
    assert int(run.failure) == 0
    np.testing.assert_allclose(run.effector * 1e6, exact.effector * 1e6, rtol=0.0, atol=1e-2 if second_order else 1e-3)


def test_a_solver_without_error_estimate_is_refused():
    with pytest.raises(ValueError, match="`solver` must estimate its error, but Euler does not"):
        OneStep(diffrax.Euler())


@pytest.mark.parametrize("order", [4, 8, 12])
def test_the_error_of_a_taylor_step_falls_with_its_order(order):
    def field(_, x):  # x' = x^2, so x = 1/(1 - t)
        return [x[0] * x[0]]

    coefficients = np.array(
        [float(c) for c in taylor_coefficients(field, jnp.zeros(()), [jnp.ones(())], order, 1.0)[0]]
    )
    errors = [abs(np.polyval(coefficients[::-1], h) - 1.0 / (1.0 - h)) for h in (0.2, 0.1)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order + 1, abs=0.6)


def test_a_stiff_contact_is_accurate_and_costs_no_more_than_five_times_the_steps():
    thesis, stiff = (trajectory(rig, LONG, Accuracy()) for rig in (Rig(), STIFF))
    exact = trajectory(STIFF, LONG, TIGHT)
    assert int(stiff.failure) == int(exact.failure) == 0
    np.testing.assert_allclose(stiff.effector * 1e6, exact.effector * 1e6, rtol=0.0, atol=1e-3)
    assert int(stiff.steps + stiff.rejected) <= 5 * int(thesis.steps + thesis.rejected)


def test_a_run_that_cannot_finish_says_so():
    run = trajectory(Rig(damping=1e-5, cycle=0.002), LONG, Accuracy())  # rings for ever
    assert int(run.failure) == 1
    assert "max_steps" in run.message
    for series in (run.platform, run.effector, run.platform_velocity, run.effector_velocity, run.friction):
        assert np.isnan(series).all()


def test_a_motion_that_is_not_finite_says_so_at_once():
    run = trajectory(Rig(damping=np.nan), LONG, Accuracy())
    assert (int(run.failure), int(run.rejected)) == (2, 0)
    assert "finite" in run.message
    assert np.isnan(run.effector).all()


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


SEEN_AT = np.linspace(0.0, 20.0, 41)
START = {"x": jnp.array(2.0), "v": jnp.array(0.0)}


def van_der_pol(t, y, mu):
    return {"x": y["v"], "v": mu * (1.0 - y["x"] ** 2) * y["v"] - y["x"]}


def solved(solver):
    control = diffrax.PIDController(rtol=1e-12, atol=1e-12)
    term, saved = diffrax.ODETerm(van_der_pol), diffrax.SaveAt(ts=jnp.asarray(SEEN_AT))
    return diffrax.diffeqsolve(term, solver, 0.0, 20.0, 1e-3, START, 5.0, stepsize_controller=control, saveat=saved)


def test_van_der_pol_takes_a_hundred_steps_and_agrees_with_scipy_between_them():
    found = solved(TaylorSolver())
    field = lambda t, y: [y[1], 5.0 * (1.0 - y[0] ** 2) * y[1] - y[0]]
    beside = solve_ivp(field, (0.0, 20.0), [2.0, 0.0], "DOP853", SEEN_AT, rtol=3e-14, atol=1e-14)
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
