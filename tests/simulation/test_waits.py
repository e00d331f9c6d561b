"""Rest: before the first motion and between two, under a load that acted before, and against a stop."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from marks import slow
from parts import Coulomb, Sampled, Sawtooth, SecondOrder

from pdssjax import Accuracy, Actuator, Amplifier, Effector, Sensor, Stop, Taylor, simulate
from pdssjax.core import member
from pdssjax.integration import SETTLED
from pdssjax.simulation import STOP_FORCE, StickSlip, sensor_samples

VOLTS = np.array([0.0, 0.0, 60.0, 60.0, 0.0, 0.0])
"""Rest, a pulse with steep flanks, rest."""
INSTANTS = np.array([0.0, 0.0, 1e-4, 2e-3, 2.1e-3, 1.0])
TIMES = np.append(-1e-3, np.linspace(0.0, 8e-3, 20))
"""From the end of the wait on."""
RIGS = {
    "lugre": ("lugre", {}, False, False, 0.0, False),
    "dahl": ("dahl", {}, False, False, 0.0, False),
    "amplified": ("simplified-lugre", {}, False, True, 0.0, False),
    "felt by the stack": ("elastoplastic", {}, True, False, 0.0, False),
    "a load that sets in": ("simplified-lugre", {}, True, False, 0.05, False),
    "a load that was carried": ("generalized-maxwell-slip", {}, True, False, 0.05, True),
    "deflection": ("anisotropic-lugre", {"state": "deflection"}, False, False, 0.0, False),
    "force": ("anisotropic-lugre", {"state": "force"}, False, True, 0.0, False),
    "sticking": ("coulomb", {}, False, False, 0.0, False),
}
QUICK = ("a load that sets in",)
"""What the default tests look at, to a low order: the others are compiled in slow ones."""
QUICKLY = Accuracy(method=Taylor(8))


def compiled(rig):
    """Effector at `TIMES`, steps and failure as a function of (load, wait), and the derivative by the load."""
    law, words, feedback, amplified, load, rests = RIGS[rig]
    friction, amplifier = member("friction", law)(**words), Amplifier() if amplified else None
    accuracy = QUICKLY if rig in QUICK else Accuracy()

    def run(load, wait):
        actuator = Actuator(
            member("piezo", "second-order")(),
            friction,
            Effector(load=load),
            feedback,
            amplifier,
            rests_under_load=rests,
        )
        drive = Sampled(jnp.asarray(INSTANTS).at[1:].add(wait), jnp.asarray(VOLTS))
        found = simulate(actuator, drive, jnp.asarray(TIMES) + wait, accuracy)
        return found.effector, (found.steps, found.failure)

    return load, jax.jit(lambda load, wait: jax.jvp(lambda load: run(load, wait), (load,), (1.0,), has_aux=True))


@pytest.mark.parametrize("rig", [rig if rig in QUICK else slow(rig) for rig in RIGS])
def test_a_wait_takes_no_steps_and_changes_nothing(rig):
    load, run = compiled(rig)
    shown, _, (steps, failure) = run(load, 0.3)
    for wait in (20.0, 3600.0):
        later, _, (more, failed) = run(load, wait)
        assert int(failure) == int(failed) == 0
        assert int(more) <= int(steps) + 1
        np.testing.assert_allclose(later, shown, rtol=0.0, atol=1e-12)
    # Under Dahl's law nothing damps what a load sets off, so it rings through the whole wait.  The contact of the
    # anisotropic law rests otherwise under a load of either sign, so that at zero there is no derivative.
    if rig in ("dahl", "deflection", "force"):
        return
    # A load is an elastic displacement at once: its derivative at zero is whole, too.
    step = 1e-6
    differences = (run(load + step, 20.0)[0] - run(load - step, 20.0)[0]) / (2.0 * step)
    assert np.abs(run(load, 20.0)[1] - differences).max() < 1e-5 * np.abs(differences).max()


PULL = 0.06
"""Uphill for none of the laws below, which come to rest under it either way [N]."""
DELAY, LATER = 0.004, 0.25
"""When the voltage begins to move; how much later so that what the load set off has died out [s]."""
CORNERS = np.array([0.0, DELAY, 0.024, 0.0242, 0.03, 0.05, 0.0502])
LEVELS = np.array([0.0, 0.0, 64.0, 0.0, 0.0, 64.0, 0.0])
SEEN_AT = np.linspace(1e-4, 0.06, 100)
LOADED = {
    "lugre": ("second-order", "lugre", False),
    "coulomb": ("second-order", "coulomb", True),
    "felt by the stack": ("second-order", "simplified-lugre", True),
    "felt by a stack with play and creep": ("composed:second-order+play-2+creep-1", "lugre", True),
}


def actuator(rig: str, effector: Effector, rests: bool = True) -> Actuator:
    piezo, law, feedback = LOADED[rig]
    models = member("piezo", piezo)(), member("friction", law)()
    return Actuator(*models, effector, feedback, rests_under_load=rests)


QUICK_LAWS = ("coulomb",)
"""What the default tests look at."""


@pytest.mark.parametrize("rig", [rig if rig in QUICK_LAWS else slow(rig) for rig in LOADED])
def test_it_moves_as_one_whose_load_set_in_long_before(rig):
    accuracy = QUICKLY if rig in QUICK_LAWS else Accuracy()
    run = jax.jit(lambda effector: simulate(actuator(rig, effector), Sampled(CORNERS, LEVELS), SEEN_AT, accuracy))
    drive = Sampled(np.append(0.0, CORNERS + LATER), np.append(0.0, LEVELS))
    times = np.append(LATER, SEEN_AT + LATER)
    late = jax.jit(lambda effector: simulate(actuator(rig, effector, rests=False), drive, times, accuracy))
    for effector in (Effector(load=PULL), Effector(load=-PULL)):
        found, expected = run(effector), late(effector)
        assert int(found.failure) == int(expected.failure) == 0
        np.testing.assert_allclose(found.effector, expected.effector[1:] - expected.effector[0], rtol=0.0, atol=1e-14)
        np.testing.assert_allclose(found.platform, expected.platform[1:] - expected.platform[0], rtol=0.0, atol=1e-14)
        np.testing.assert_allclose(found.friction, expected.friction[1:], rtol=0.0, atol=1e-8)
        waits = SEEN_AT < DELAY
        np.testing.assert_allclose(found.effector[waits], 0.0, atol=1e-18)
        np.testing.assert_allclose(found.friction[waits], -effector.load, rtol=1e-9)
    if rig != "coulomb":  # which does not yield
        begun = jax.jit(
            lambda effector: simulate(actuator(rig, effector, rests=False), Sampled(CORNERS, LEVELS), SEEN_AT)
        )
        assert np.abs(begun(effector).effector - found.effector).max() > 1e-8


@pytest.mark.slow
@pytest.mark.parametrize("rig", ["lugre", "felt by the stack"])
def test_the_derivative_by_a_load_of_zero_is_whole_while_the_voltage_waits(rig):
    run = jax.jit(lambda load: simulate(actuator(rig, Effector(load=load)), Sampled(CORNERS, LEVELS), SEEN_AT).effector)
    column = np.asarray(jax.jacfwd(run)(0.0))
    differences = (run(1e-5) - run(-1e-5)) / 2e-5
    assert np.abs(column - differences).max() < 1e-6 * np.abs(differences).max()


C, W, XI, SLOPE = 1.007e-7, 6736.0, 0.1772, 320.0
STIFFNESS, DISSIPATION = 1e5, 10.0
MET_AT = np.concatenate([np.linspace(2e-5, 2e-3, 40), np.linspace(3e-3, 0.19, 40)])


def stopped(gap):
    stop = Stop(STIFFNESS, DISSIPATION, gap)
    return Actuator(SecondOrder(C, W, XI), Coulomb(0.65), Effector(), stop=stop)


@jax.jit
def push(gap):
    """Force on the stop [N] and its derivative by the gap, of one run."""
    shown = lambda gap: sensor_samples(
        StickSlip(stopped(gap), Sawtooth(SLOPE / 5.0, 5.0)), jnp.asarray(MET_AT), Accuracy(method=Taylor(8)), STOP_FORCE
    )
    return jax.jvp(shown, (gap,), (1.0,))


@pytest.mark.parametrize("gap", [2e-8, 3e-7, 2e-6])
def test_a_contact_that_sticks_meets_the_stop_as_the_ringing_platform_has_it(gap):
    """Once it counted as settled the platform had been taken for one that goes straight on: 20 ms off, 0.06 N."""
    slow, ringing = XI * W, W * np.sqrt(1.0 - XI**2)
    fades, turn = np.exp(-slow * MET_AT), ringing * MET_AT
    # Second order under a ramp, from rest.
    y = MET_AT - 2.0 * XI / W + fades * (2.0 * XI / W * np.cos(turn) + (2.0 * XI**2 - 1.0) / ringing * np.sin(turn))
    w = 1.0 - fades * (np.cos(turn) + XI * W / ringing * np.sin(turn))
    y, w = C * SLOPE * y, C * SLOPE * w
    expected = np.where(y > gap, STIFFNESS * (y - gap) * (1.0 + DISSIPATION * w), 0.0)
    slope = np.where(y > gap, -STIFFNESS * (1.0 + DISSIPATION * w), 0.0)
    sticks = expected < 0.5
    assert (expected[sticks] > 0.0).sum() > 3
    found, by_gap = push(gap)
    np.testing.assert_allclose(np.asarray(found)[sticks], expected[sticks], rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(np.asarray(by_gap)[sticks], slope[sticks], rtol=1e-6)


def test_the_force_that_a_sensor_shows_does_not_move_either_once_all_has_settled():
    system = StickSlip(stopped(1e-6), Sawtooth(64.0, 5.0), Sensor(1e3))
    shown = system.initial()._replace(sensor_lag=(jnp.asarray(0.3),))
    segment, start = system.segment(jnp.ones(())), jnp.zeros(())
    assert not system.is_settled(segment, start, shown, jnp.zeros(()), jnp.asarray(1e-7))
    assert float(system.project_to_steady(segment, start, shown, jnp.zeros(())).sensor_lag[0]) == 0.0
    assert float(system.field(segment, start, shown, jnp.asarray(SETTLED)).sensor_lag[0]) == 0.0
