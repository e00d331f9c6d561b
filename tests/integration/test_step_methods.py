"""Any one-step solver will do for the smooth pieces, stiff contacts stay cheap, and what cannot finish says so."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from rigs import SAMPLES, models, trajectory, values

from pdssjax import Accuracy, OneStep, simulate
from pdssjax.integration import TIGHT
from pdssjax.integration.taylor_series import taylor_coefficients
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
