"""What is left of a motion once a contact counts as settled."""

import jax.numpy as jnp
import pytest
from parts import Sawtooth, SecondOrder, SimplifiedLuGre

from pdssjax import Actuator, Effector
from pdssjax.simulation import StickSlip


@pytest.mark.parametrize("stiffness", [1e6, 2.5e5])
def test_a_ringing_platform_displaces_a_slower_contact_by_inertia_over_stiffness(stiffness):
    gain, rate, mass, slope = 1e-7, 2e4, 0.1, 300.0
    rig = Actuator(SecondOrder(gain, rate), SimplifiedLuGre(stiffness), Effector(mass))
    system = StickSlip(rig, Sawtooth(slope / 5.0, 5.0))
    advancing, start = jnp.ones(()), jnp.zeros(())
    settled = lambda tolerance: system.is_settled(
        system.segment(advancing), start, system.initial(), advancing, tolerance
    )
    # At the corner of the voltage it lacks the velocity of the ramp.
    ringing = gain * slope / rate
    displaced = mass * rate**2 * ringing / stiffness
    assert settled(1.01 * displaced) and not settled(0.99 * displaced)
