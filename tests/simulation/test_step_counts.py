"""Steps at the published parameters: what the bound for the sake of derivatives costs."""

import numpy as np
import pytest
from marks import slow

from pdssjax import Actuator, simulate
from pdssjax.core import member
from pdssjax.drive.sawtooth import Sawtooth

WITHOUT_BOUND = {
    ("deflection", "forward"): 164,
    ("deflection", "backward"): 228,
    ("force", "forward"): 167,
    ("force", "backward"): 234,
}
"""Of order 12 at 1e-11 m, which let derivatives grow (docs/decisions/17-order-and-tolerance.md)."""


@pytest.mark.parametrize("state, direction", [slow(*case) if "force" in case else case for case in WITHOUT_BOUND])
def test_derivatives_that_are_right_take_a_tenth_more_steps_at_most(state, direction):
    actuator = Actuator(member("piezo", "second-order")(), member("friction", "anisotropic-lugre")(state=state))
    found = simulate(actuator, Sawtooth(64.0, 5.0, 0.0, direction=direction), np.linspace(0.0, 0.6, 300))
    assert not found.message and found.events > 100
    assert found.steps <= 1.1 * WITHOUT_BOUND[state, direction]
