"""A load or a tilt that acted before t = 0: the rig rests under it, and all motion is counted from there."""

import jax
import numpy as np
import pytest

from pdssjax import Actuator, Effector, simulate
from pdssjax.core import member
from pdssjax.drive.sampled import Sampled

PULL = 0.06
"""Uphill for none of the laws below, which come to rest under it either way [N]."""
DELAY, LATER = 0.004, 0.25
"""When the voltage begins to move; how much later so that what the load set off has died out [s]."""
INSTANTS = np.array([0.0, DELAY, 0.024, 0.0242, 0.03, 0.05, 0.0502])
VOLTS = np.array([0.0, 0.0, 64.0, 0.0, 0.0, 64.0, 0.0])
TIMES = np.linspace(1e-4, 0.06, 100)
RIGS = {
    "lugre": ("second-order", "lugre", False),
    "coulomb": ("second-order", "coulomb", True),
    "felt by the stack": ("second-order", "simplified-lugre", True),
    "felt by a stack with play and creep": ("composed:second-order+play-2+creep-1", "lugre", True),
}


def actuator(rig: str, effector: Effector, rests: bool = True) -> Actuator:
    piezo, law, feedback = RIGS[rig]
    models = member("piezo", piezo)(), member("friction", law)()
    return Actuator(*models, effector, feedback, rests_under_load=rests)


QUICK = ("coulomb",)
"""What the default tests look at."""


@pytest.mark.parametrize("rig", [pytest.param(rig, marks=() if rig in QUICK else pytest.mark.slow) for rig in RIGS])
def test_it_moves_as_one_whose_load_set_in_long_before(rig):
    run = jax.jit(lambda effector: simulate(actuator(rig, effector), Sampled(INSTANTS, VOLTS), TIMES))
    drive = Sampled(np.append(0.0, INSTANTS + LATER), np.append(0.0, VOLTS))
    times = np.append(LATER, TIMES + LATER)
    late = jax.jit(lambda effector: simulate(actuator(rig, effector, rests=False), drive, times))
    for effector in (Effector(load=PULL), Effector(load=-PULL)):
        found, expected = run(effector), late(effector)
        assert int(found.failure) == int(expected.failure) == 0
        np.testing.assert_allclose(found.effector, expected.effector[1:] - expected.effector[0], rtol=0.0, atol=1e-14)
        np.testing.assert_allclose(found.platform, expected.platform[1:] - expected.platform[0], rtol=0.0, atol=1e-14)
        np.testing.assert_allclose(found.friction, expected.friction[1:], rtol=0.0, atol=1e-8)
        waits = TIMES < DELAY
        np.testing.assert_allclose(found.effector[waits], 0.0, atol=1e-18)
        np.testing.assert_allclose(found.friction[waits], -effector.load, rtol=1e-9)
    if rig != "coulomb":  # which does not yield
        begun = jax.jit(
            lambda effector: simulate(actuator(rig, effector, rests=False), Sampled(INSTANTS, VOLTS), TIMES)
        )
        assert np.abs(begun(effector).effector - found.effector).max() > 1e-8


@pytest.mark.slow
@pytest.mark.parametrize("rig", ["lugre", "felt by the stack"])
def test_the_derivative_by_a_load_of_zero_is_whole_while_the_voltage_waits(rig):
    run = jax.jit(lambda load: simulate(actuator(rig, Effector(load=load)), Sampled(INSTANTS, VOLTS), TIMES).effector)
    column = np.asarray(jax.jacfwd(run)(0.0))
    differences = (run(1e-5) - run(-1e-5)) / 2e-5
    assert np.abs(column - differences).max() < 1e-6 * np.abs(differences).max()
