"""A law without a Stribeck curve in the actuator moves the end-effector as SciPy moves a mass on the same contact."""

import jax
import numpy as np
import pytest
from sliding import push

from pdssjax import Accuracy, Actuator, Effector, simulate
from pdssjax.core import member
from pdssjax.drive.step import Step
from pdssjax.piezo.second_order import SecondOrder

MASS, VOLTAGE = 0.086, 64.2
TIMES = np.linspace(0.0, 4e-3, 41)
LAWS = ["bliman-sorine", "dahl", "reset-integrator", "simplified-lugre"]
RUN = jax.jit(
    lambda actuator, drive: simulate(actuator, drive, TIMES, Accuracy(tolerance=1e-13, settle_tolerance=1e-14))
)


def acceleration(time: float) -> float:
    """y'' [m/s2] of the platform after a step of the voltage, in closed form."""
    piezo = SecondOrder()
    w, xi = piezo.natural_frequency, piezo.damping_ratio
    ring, decay = w * np.sqrt(1.0 - xi**2), xi * w
    angle = ring * time
    return piezo.gain * VOLTAGE * w**2 * np.exp(-decay * time) * (np.cos(angle) - decay / ring * np.sin(angle))


@pytest.mark.slow
@pytest.mark.parametrize("name", LAWS)
def test_a_step_of_the_platform_throws_the_effector_as_a_pushed_mass(name):
    law = member("friction", name)()
    run = RUN(Actuator(SecondOrder(), law, Effector(mass=MASS)), Step(voltage=VOLTAGE))
    assert int(run.failure) == 0
    relative = push(law, lambda t: MASS * acceleration(t), TIMES, MASS, 0.0)
    assert int(run.events) > 0
    np.testing.assert_allclose(np.asarray(run.platform - run.effector), relative, atol=2e-11)


@pytest.mark.slow
@pytest.mark.parametrize("force", [0.2, 0.65, 1.1])
def test_coulomb_friction_lets_the_effector_slip_by_the_difference_of_the_accelerations(force):
    """From the closed form: it slides at F/m until the velocities meet, first right after the step."""
    law = member("friction", "coulomb")(f_c=force)
    run = RUN(Actuator(SecondOrder(), law, Effector(mass=MASS)), Step(voltage=VOLTAGE))
    fine = np.linspace(0.0, 1e-3, 40001)
    speed = np.cumsum([acceleration(t) for t in fine]) * (fine[1] - fine[0])
    meets = fine[np.argmax((speed < force / MASS * fine) & (fine > 1e-4))]
    early = (TIMES > 0.0) & (meets > TIMES)
    assert early.sum() >= 2
    np.testing.assert_allclose(run.effector[early], 0.5 * force / MASS * TIMES[early] ** 2, atol=1e-12)
