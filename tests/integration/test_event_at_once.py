"""A contact at rest whose drive begins with slope zero: it moves at once, at a time that no parameter sets."""

import jax
import jax.numpy as jnp
import numpy as np

from pdssjax import Accuracy, Actuator, Effector, Taylor
from pdssjax.actuator import IDEAL
from pdssjax.drive.sine import Sine
from pdssjax.friction.simplified_lugre import SimplifiedLuGre
from pdssjax.integration import integrate_steps
from pdssjax.piezo.second_order import SecondOrder
from pdssjax.simulation import StickSlip


def test_an_event_at_the_first_instant_has_no_time_of_its_own():
    def second_step(rate):
        contact = SimplifiedLuGre(sigma0=5.2e6, sigma1=6.4, f_ss=0.51)
        actuator = Actuator(SecondOrder(gain=1.1e-7, natural_frequency=rate, damping_ratio=0.14), contact, Effector())
        system = StickSlip(actuator, Sine(64.0, 20.0), IDEAL, 0.0)
        run = integrate_steps(system, jnp.asarray(2e-4), Accuracy(method=Taylor(6), max_steps=32), (0,))
        return run.steps.t_local[1], run.steps.mode[:2]

    by_rate = jax.jit(lambda rate: jax.jvp(second_step, (rate,), (rate,), has_aux=True))
    begin, moved, modes = by_rate(jnp.asarray(4548.0))
    np.testing.assert_array_equal(modes, [0.0, 1.0])
    assert float(begin) == 0.0
    # Rounding in the gap over rounding in its slope was -7e-5 s here, and at random actuators columns were 1 % off.
    assert float(moved) == 0.0
