"""Corners, equal times and reversals: velocities that jump, samples at one time, steps, and events carried back."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from marks import slow
from parts import Coulomb, Dahl, MaxwellSlip, ResetIntegrator, Sawtooth, SecondOrder, SimplifiedLuGre, Static, Triangle

import pdssjax
from pdssjax import Accuracy, Actuator, Taylor
from pdssjax.core import member, quantities
from pdssjax.simulation import StickSlip
from tests.reference.combinations.motion import simulate
from tests.reference.combinations.rig import rig_of

QUICK = Accuracy(method=Taylor(8))
MASS = 0.086
JUMPED = np.linspace(1.3e-6, 3e-3, 31)


@pytest.mark.parametrize(
    ("name", "law", "accuracy"),
    [("reset-integrator", ResetIntegrator(), QUICK), slow("dahl", Dahl(exponent=0.4), Accuracy())],
    ids=["reset-integrator", "dahl"],
)
def test_a_law_that_knows_reversals_learns_of_one_that_a_corner_makes(name, law, accuracy):
    found = pdssjax.simulate(Actuator(Static(), law), Triangle(60.0, 1000.0, 0.3), JUMPED, accuracy)
    numbers = {"piezo.gain": float(Static().gain), "effector.mass": MASS}
    numbers |= {f"friction.{field}": float(getattr(law, field)) for field in quantities(type(law))}
    drive = "Triangle", dict(voltage=60.0, frequency=1000.0, symmetry=0.3)
    expected = simulate(rig_of("static", name, drive, numbers), JUMPED)
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


def test_each_of_equal_times_moves_its_own_sample():
    actuator = Actuator(SecondOrder(), Coulomb())
    drive = Sawtooth(voltage=64.0)
    times = np.concatenate([[0.01, 0.05], np.full(131, 0.1002)])
    moved = np.random.default_rng(1).normal(size=times.size)
    shown = lambda times: pdssjax.simulate(actuator, drive, times, QUICK).effector
    _, slopes = jax.jvp(shown, (times,), (moved,))
    assert slopes[2] != 0.0
    np.testing.assert_allclose(slopes[2:] / moved[2:], slopes[2] / moved[2], rtol=1e-12)


WITHOUT_BOUND = {
    ("deflection", "forward"): 164,
    ("deflection", "backward"): 228,
    ("force", "forward"): 167,
    ("force", "backward"): 234,
}
"""Of order 12 at 1e-11 m, which let derivatives grow (docs/decisions/17-order-and-tolerance.md)."""


@pytest.mark.slow
@pytest.mark.parametrize("state, direction", WITHOUT_BOUND)
def test_derivatives_that_are_right_take_a_tenth_more_steps_at_most(state, direction):
    actuator = Actuator(member("piezo", "second-order")(), member("friction", "anisotropic-lugre")(state=state))
    found = pdssjax.simulate(actuator, Sawtooth(64.0, 5.0, 0.0, direction=direction), np.linspace(0.0, 0.6, 300))
    assert not found.message and found.events > 100
    assert found.steps <= 1.1 * WITHOUT_BOUND[state, direction]


AMPLITUDE = 1e-11
FAST, SLOW = 1.0, 1e-6
"""Slopes of a guard: of v, so accelerations [m/s2]; the ringing of a platform of 6736 rad/s by 1e-11 m has 5e-4."""


@pytest.mark.parametrize(
    ("which", "slope", "mode", "expected"),
    [
        (0, FAST, 1.0, False),
        (1, FAST, -1.0, False),
        (0, SLOW, 1.0, True),
        (1, SLOW, -1.0, True),
        (0, SLOW, 0.0, False),
        (2, FAST, 1.0, True),
        (2, FAST, -1.0, True),
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
