"""An end-effector that sticks to a ringing platform meets the stop in front of it when the platform has come so far."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pdssjax import Accuracy, Actuator, Effector, Sensor, Stop
from pdssjax.drive.sawtooth import Sawtooth
from pdssjax.friction.coulomb import Coulomb
from pdssjax.integration import SETTLED
from pdssjax.piezo.second_order import SecondOrder
from pdssjax.simulation import STOP_FORCE, StickSlip, sensor_samples

C, W, XI, SLOPE = 1.007e-7, 6736.0, 0.1772, 320.0
STIFFNESS, DISSIPATION = 1e5, 10.0
TIMES = np.concatenate([np.linspace(2e-5, 2e-3, 40), np.linspace(3e-3, 0.19, 40)])


def stopped(gap):
    stop = Stop(STIFFNESS, DISSIPATION, gap)
    return Actuator(SecondOrder(C, W, XI), Coulomb(0.65), Effector(), stop=stop)


@jax.jit
def push(gap):
    """Force on the stop [N] and its derivative by the gap, of one run."""
    shown = lambda gap: sensor_samples(
        StickSlip(stopped(gap), Sawtooth(SLOPE / 5.0, 5.0)), jnp.asarray(TIMES), Accuracy(), STOP_FORCE
    )
    return jax.jvp(shown, (gap,), (1.0,))


@pytest.mark.parametrize("gap", [2e-8, 3e-7, 2e-6])
def test_a_contact_that_sticks_meets_the_stop_as_the_ringing_platform_has_it(gap):
    """Once it counted as settled the platform had been taken for one that goes straight on: 20 ms off, 0.06 N."""
    slow, ringing = XI * W, W * np.sqrt(1.0 - XI**2)
    fades, turn = np.exp(-slow * TIMES), ringing * TIMES
    # Second order under a ramp, from rest.
    y = TIMES - 2.0 * XI / W + fades * (2.0 * XI / W * np.cos(turn) + (2.0 * XI**2 - 1.0) / ringing * np.sin(turn))
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
