"""A static stack moves at once as the voltage changes: its velocity jumps, and the end-effector's does not.

The referee steps the equations of a contact explicitly, with the platform's motion as given.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import pdssjax
from pdssjax import Actuator, Amplifier, Effector
from pdssjax.core import member, quantities
from pdssjax.drive.sawtooth import Sawtooth
from pdssjax.drive.step import Step
from pdssjax.drive.triangle import Triangle
from pdssjax.friction.coulomb import Coulomb
from pdssjax.friction.dahl import Dahl
from pdssjax.friction.reset_integrator import ResetIntegrator
from pdssjax.friction.simplified_lugre import SimplifiedLuGre
from pdssjax.friction.stribeck import Stribeck
from pdssjax.piezo.static import Static

MASS = 0.086
TIME = np.linspace(1.3e-6, 3e-3, 31)
STEP = 2e-7


def stepped(platform, force, state):
    """Displacement of an end-effector on a `platform` that goes through these places, by explicit steps.

    **Arguments:** `force(state, v)` gives the friction [N] and the state after a step.
    """
    speeds, v_effector, places, at = np.diff(platform) / STEP, 0.0, [0.0], 0.0
    for speed in speeds:
        pull, state = force(state, speed - v_effector)
        v_effector += pull / MASS * STEP
        at += v_effector * STEP
        places.append(at)
    return np.interp(TIME, STEP * np.arange(len(places)), places)


def reset_integrator(law):
    limit = law.f_c / law.sigma0

    def force(p, v):
        if abs(p) >= limit * (1.0 - 1e-9) and p * v > 0:
            return law.f_c * np.sign(v), p
        return (1.0 + law.a) * law.sigma0 * p + law.beta * v, np.clip(p + v * STEP, -limit, limit)

    return force


def dahl(law):
    def force(z, v):
        left = 1.0 - law.sigma0 / law.f_c * z * np.sign(v)
        return law.sigma0 * z, z + STEP * v * np.sign(left) * abs(left) ** law.exponent

    return force


@pytest.mark.parametrize(
    ("law", "referee"),
    [
        pytest.param(ResetIntegrator(), reset_integrator, id="reset-integrator"),
        pytest.param(Dahl(exponent=0.4), dahl, id="dahl", marks=pytest.mark.slow),
    ],
)
def test_a_law_that_knows_reversals_learns_of_one_that_a_corner_makes(law, referee):
    drive = Triangle(60.0, 1000.0, 0.3)
    found = pdssjax.simulate(Actuator(Static(), law), drive, TIME)
    platform = Static().gain * np.asarray(drive.at(jnp.asarray(STEP * np.arange(round(TIME[-1] / STEP) + 2))))
    expected = stepped(platform, referee(law), 0.0)
    np.testing.assert_allclose(found.effector, expected, atol=2e-3 * np.ptp(expected))


@pytest.mark.slow
def test_friction_alone_moves_the_end_effector_where_elements_of_a_stack_let_go():
    """An element of play that begins to move lets the platform jump in velocity, not what rides on it."""
    stack, law = member("piezo", "composed:static+play-3")(), Coulomb(f_c=0.15)
    time = np.linspace(0.0, 0.02, 40_001)
    run = pdssjax.simulate(Actuator(stack, law), Triangle(60.0, 150.0, 0.4), time)
    pull = MASS * np.diff(run.effector_velocity) / time[1]
    assert 0.99 * law.f_c < np.max(np.abs(pull)) < (1.0 + 1e-6) * law.f_c
    walked = np.cumsum(np.asarray(run.effector_velocity)) * time[1]
    assert np.ptp(run.effector) > 5e-6
    np.testing.assert_allclose(run.effector, walked, atol=0.01 * np.ptp(walked))


@pytest.mark.slow
def test_feedback_on_a_stack_that_no_force_moves_changes_nothing():
    """It was a force of infinity over infinity: 19 mm of motion."""
    time = np.linspace(5e-4, 0.09, 40)
    drive = Sawtooth(20.0, 20.0, 1e-3)
    with_it, without = (
        pdssjax.simulate(Actuator(Static(), Coulomb(), feedback=feedback), drive, time).effector
        for feedback in (True, False)
    )
    np.testing.assert_allclose(with_it, without, atol=1e-18)


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


@pytest.mark.slow
def test_a_jump_into_fast_sliding_is_fast_sliding():
    """Its flags stayed those of a slow beginning: steps ran past the Stribeck curve on the way back, 3 nm of 34.

    The referee integrates each direction of sliding up to its end, on a platform known in closed form.
    """
    law, stack, mass = Stribeck(f_c=0.4627, f_s=0.7067, v_s=1.2524e-3, delta=2.383), Static(1.36e-7), 0.1204
    amplifier, volts = Amplifier(6697.0, 68120.0), 3.168
    pole = float(amplifier.pole())
    slews = volts / amplifier.slew - 1.0 / pole

    def slide(sign, begin, end, v):
        """Until v reverses, or the `end`: when that is, v, and by how much the end-effector has fallen behind."""

        def rates(t, y):
            square = (y[0] / law.v_s) ** 2
            weakening = np.exp(-square * (square + 1e-6) ** (0.5 * law.delta - 1.0))
            pull = -stack.gain * amplifier.slew * pole * np.exp(-pole * (t - slews)) if t >= slews else 0.0
            return pull - sign * (law.f_c + (law.f_s - law.f_c) * weakening) / mass, y[0]

        over = lambda t, y: sign * y[0] if t > begin else 1.0
        over.terminal = True
        run = solve_ivp(rates, (begin, end), [v, 0.0], "DOP853", events=over, rtol=1e-13, atol=1e-18)
        return run.t[-1], *run.y[:, -1]

    turn, v, first = slide(1.0, 0.0, slews, stack.gain * amplifier.slew)
    turn, _, second = slide(1.0, turn, 1.0, v)
    _, _, third = slide(-1.0, turn, 1.0, 0.0)
    actuator = Actuator(stack, law, Effector(mass), amplifier=amplifier)
    run = pdssjax.simulate(actuator, Step(volts), np.array([0.0, 1.5e-3]))
    np.testing.assert_allclose(run.effector[-1], stack.gain * volts - first - second - third, rtol=1e-8)
