"""From which events of an actuator derivatives are carried back to a fixed time."""

import jax.numpy as jnp
import pytest

from pdssjax import Actuator
from pdssjax.drive.sawtooth import Sawtooth
from pdssjax.friction.dahl import Dahl
from pdssjax.piezo.maxwell_slip import MaxwellSlip
from pdssjax.piezo.second_order import SecondOrder
from pdssjax.simulation import StickSlip

AMPLITUDE = 1e-11
QUICK, SLOW = 1.0, 1e-6
"""Slopes of a guard: of v, so accelerations [m/s2]; the ringing of a platform of 6736 rad/s by 1e-11 m has 5e-4."""


@pytest.mark.parametrize(
    ("which", "slope", "mode", "expected"),
    [
        (0, QUICK, 1.0, False),
        (1, QUICK, -1.0, False),
        (0, SLOW, 1.0, True),
        (1, SLOW, -1.0, True),
        (0, SLOW, 0.0, False),
        (2, QUICK, 1.0, True),
        (2, QUICK, -1.0, True),
    ],
    ids=[
        "reversal",
        "reversal backward",
        "small reversal",
        "small reversal backward",
        "a stuck contact breaks away",
        "saturation",
        "saturation backward",
    ],
)
@pytest.mark.parametrize("piezo", [SecondOrder(), MaxwellSlip()], ids=["second-order", "maxwell-slip"])
def test_small_reversals_and_the_law_s_events_are(piezo, which, slope, mode, expected):
    system = StickSlip(Actuator(piezo, Dahl()), Sawtooth(64.0, 20.0, 2e-4))
    found = system.is_carried_back(jnp.asarray(slope), jnp.asarray(mode), jnp.asarray(which), AMPLITUDE)
    assert bool(found) == expected
