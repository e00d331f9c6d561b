"""A static stack moves at once as the voltage changes: its velocity jumps, and the end-effector's does not."""

import jax
import numpy as np
import pytest
from marks import slow

import pdssjax
from pdssjax import Actuator
from pdssjax.core import member, quantities
from pdssjax.drive.sawtooth import Sawtooth
from pdssjax.drive.triangle import Triangle
from pdssjax.friction.dahl import Dahl
from pdssjax.friction.reset_integrator import ResetIntegrator
from pdssjax.friction.simplified_lugre import SimplifiedLuGre
from pdssjax.piezo.static import Static
from tests.reference.combinations.motion import simulate
from tests.reference.combinations.rig import rig_of

MASS = 0.086
TIME = np.linspace(1.3e-6, 3e-3, 31)


@pytest.mark.parametrize(
    ("name", "law"),
    [("reset-integrator", ResetIntegrator()), slow("dahl", Dahl(exponent=0.4))],
    ids=["reset-integrator", "dahl"],
)
def test_a_law_that_knows_reversals_learns_of_one_that_a_corner_makes(name, law):
    found = pdssjax.simulate(Actuator(Static(), law), Triangle(60.0, 1000.0, 0.3), TIME)
    numbers = {"piezo.gain": float(Static().gain), "effector.mass": MASS}
    numbers |= {f"friction.{field}": float(getattr(law, field)) for field in quantities(type(law))}
    drive = "Triangle", dict(voltage=60.0, frequency=1000.0, symmetry=0.3)
    expected = simulate(rig_of("static", name, drive, numbers), TIME)
    np.testing.assert_allclose(found.effector, expected, rtol=0.0, atol=1e-6 * np.ptp(expected))


@pytest.mark.slow
def test_a_velocity_that_does_not_jump_is_not_made_to_by_rounding():
    """A stack behind a lag goes on as fast as before where an element of play lets go, or the contact reverses.

    With numbers that a fit traces compiled code rounded the speed before and after differently, 5e-22 m/s were left
    where the contact reversed, and it reversed there again and again, until no steps were left.
    """
    stack, drive, time = (
        member("piezo", "composed:first-order+play-3"),
        Sawtooth(64.0, 20.0, 2e-4),
        np.linspace(0, 0.1, 101),
    )
    numbers = {name: float(declared.nominal) for name, declared in quantities(stack).items()}
    traced = jax.jit(lambda numbers: pdssjax.simulate(Actuator(stack(**numbers), SimplifiedLuGre()), drive, time))(
        numbers
    )
    held = pdssjax.simulate(Actuator(stack(), SimplifiedLuGre()), drive, time)
    assert int(traced.failure) == 0 and int(traced.events) == int(held.events)
    np.testing.assert_allclose(traced.effector, held.effector, atol=1e-13)
