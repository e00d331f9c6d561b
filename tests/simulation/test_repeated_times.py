"""Times that repeat the last one have derivatives of their own, as all others have."""

import jax
import numpy as np

import pdssjax
from pdssjax import Actuator
from pdssjax.drive.sawtooth import Sawtooth
from pdssjax.friction.coulomb import Coulomb
from pdssjax.piezo.second_order import SecondOrder


def test_each_of_equal_times_moves_its_own_sample():
    actuator = Actuator(SecondOrder(), Coulomb())
    drive = Sawtooth(voltage=64.0)
    times = np.concatenate([[0.01, 0.05], np.full(131, 0.1002)])
    slopes = jax.jacfwd(lambda times: pdssjax.simulate(actuator, drive, times).effector)(times)
    of_last = slopes[2, 2]
    assert of_last != 0.0
    np.testing.assert_allclose(slopes, np.diag(np.diag(slopes)), atol=0.0)
    np.testing.assert_allclose(np.diag(slopes)[2:], of_last, rtol=1e-12)
