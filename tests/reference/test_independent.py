"""The package moves as an independent simulator does: feedback, load, fall time, sticking, both readings."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from marks import slow
from parts import Sawtooth, SecondOrder, SimplifiedLuGre
from rigs import SAMPLES, trajectory

from pdssjax import Accuracy, Actuator, Effector
from pdssjax.integration import TIGHT
from pdssjax.simulation import displacements
from tests.reference.independent import Rig, simulate

TIMES = 0.00031 + np.arange(SAMPLES) * 0.005
"""Off the corners of the drive, where the force of a stuck contact jumps."""
RIGS = {
    "fall time": Rig(fall=9e-4),
    "fall time, backward": Rig(fall=9e-4, forward=False),
    "downhill, sticks": Rig(load=-0.07),
    "downhill, backward, sticks": Rig(load=-0.07, forward=False),
    "each rest with another force": Rig(load=-0.3, mass=0.3, fall=9e-4),
    "cycles too short to rest": Rig(load=-0.07, cycle=0.025),
    "rings on while it sticks": Rig(load=-0.3, damping=0.02, cycle=0.05, fall=9e-4),
    "feedback": Rig(feedback=True),
    "feedback, light platform": Rig(feedback=True, stack=0.05, forward=False),
    "feedback, downhill, backward": Rig(feedback=True, load=-0.1, forward=False, fall=9e-4),
    "force": Rig(reading="force", fall=9e-4),
    "force, uphill": Rig(reading="force", load=0.1),
    "rests downhill": Rig(load=-0.3, mass=0.3, fall=9e-4, rests_under_load=True),
    "force, feedback, rests uphill": Rig(reading="force", feedback=True, load=0.1, rests_under_load=True),
    "force, feedback, downhill": Rig(reading="force", feedback=True, load=-0.1, forward=False),
}


def check(run, expected, micrometres, newtons):
    assert int(run.failure) == 0
    np.testing.assert_allclose(run.platform * 1e6, expected[:, 0] * 1e6, rtol=0.0, atol=micrometres)
    np.testing.assert_allclose(run.effector * 1e6, expected[:, 1] * 1e6, rtol=0.0, atol=micrometres)
    np.testing.assert_allclose(run.friction, expected[:, 2], rtol=0.0, atol=newtons)


QUICK = "fall time, backward", "downhill, sticks", "feedback, downhill, backward", "force", "force, feedback, downhill"
"""What the default tests look at: a rig or two of each structure; of those that rest `test_waits` has one."""


@pytest.mark.parametrize("name", [name if name in QUICK else slow(name) for name in RIGS])
def test_trajectories(name):
    expected = simulate(RIGS[name], TIMES)
    check(trajectory(RIGS[name], TIMES, Accuracy()), expected, 1e-3, 1e-3)
    check(trajectory(RIGS[name], TIMES, TIGHT), expected, 1e-6, 1e-6)


@pytest.mark.slow
def test_an_uphill_load_keeps_the_deflection_state_on_a_limit_cycle():
    rig = Rig(load=0.07)
    run = trajectory(rig, TIMES, Accuracy(1e-13, 1e-14))
    check(run, simulate(rig, TIMES), 1e-3, 1e-3)
    assert not bool(run.repeated)
    assert int(run.events) > 100 * 3  # per cycle; about 30 where it comes to rest


@pytest.mark.slow
def test_the_isotropic_law():
    same = replace(Rig(), s0=(1e6, 1e6), s1=(45.0, 45.0), f_ss=(0.65, 0.65))
    actuator = Actuator(SecondOrder(), SimplifiedLuGre(1e6, 45.0, 0.65), Effector())
    run = jax.jit(lambda times: displacements(actuator, Sawtooth(64.0), times, Accuracy()))
    np.testing.assert_allclose(run(TIMES), simulate(same, TIMES)[:, :2].T, rtol=0.0, atol=1e-9)
