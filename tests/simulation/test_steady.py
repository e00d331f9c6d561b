"""The steady motion of an actuator is that after very many cycles, with its derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from parts import AnisotropicLuGre, Bristle, Sawtooth, SecondOrder, Step

import pdssjax
from pdssjax import Accuracy, Actuator, steady_cycle
from pdssjax.integration import GRAZES

CHOSEN = jnp.array([100.0, 120.0, 0.1772, 54.4])
"""Voltage, frequency, damping ratio of the stack, damping of the bristles: it still rings at the next drop."""
FINE = Accuracy(max_steps=2048)


def rig(numbers):
    voltage, frequency, damping, sigma1 = numbers
    return Actuator(SecondOrder(damping_ratio=damping), AnisotropicLuGre(sigma1_a=sigma1)), Sawtooth(
        voltage, frequency, 5e-4
    )


def net_step(numbers):
    return -steady_cycle(*rig(numbers), FINE).gain[0]


def test_a_drive_that_never_repeats_has_no_steady_motion():
    with pytest.raises(ValueError, match="expected one that repeats"):
        pdssjax.steady_cycle(Actuator(SecondOrder(), AnisotropicLuGre()), Step())


@pytest.mark.slow
def test_derivatives_are_those_of_the_net_step_by_the_frequency_too():
    slopes = np.asarray(jax.jit(jax.jacfwd(net_step))(CHOSEN))
    step = jax.jit(net_step)
    for i, slope in enumerate(slopes):
        away = jnp.zeros(4).at[i].set(1e-4 * CHOSEN[i])
        wide, narrow = ((step(CHOSEN + k * away) - step(CHOSEN - k * away)) / (2 * k * away[i]) for k in (2, 1))
        assert slope == pytest.approx(float((4 * narrow - wide) / 3), rel=1e-5)


@pytest.mark.slow
def test_a_steady_motion_is_that_after_many_cycles():
    actuator, drive = rig(CHOSEN)
    times = jnp.linspace(0.0, 1.99, 150) / drive.frequency
    steady = pdssjax.simulate(actuator, drive, times, FINE, cycles="steady")
    late = pdssjax.simulate(
        actuator, drive, jnp.concatenate([jnp.array([39.9999999]) / drive.frequency, 40 / drive.frequency + times])
    )
    assert bool(steady.repeated) and int(steady.failure) == 0
    assert steady.grazing is not None and late.grazing is None and GRAZES < float(steady.grazing) <= 1.0
    np.testing.assert_allclose(steady.voltage[1:], late.voltage[2:], atol=1e-6)
    np.testing.assert_allclose(steady.effector[1:], late.effector[2:] - late.effector[0], rtol=0.0, atol=2e-10)
    np.testing.assert_allclose(steady.platform[1:], late.platform[2:], rtol=0.0, atol=1e-12)


@pytest.mark.slow
def test_bonds_that_snap_never_repeat_and_bonds_that_only_stretch_do():
    """The stretch of a new bond comes from a sequence that never returns: no cycle is like another."""

    @jax.jit
    def found(voltage, damping):
        actuator = Actuator(SecondOrder(), Bristle(sigma2=damping, bristles=2))
        return pdssjax.steady_cycle(actuator, Sawtooth(voltage, 150.0, 5e-4), FINE)

    snaps, rings, stretches = found(64.0, 0.0), found(2.0, 0.0), found(2.0, 20.0)
    assert int(snaps.period) == 0 and int(snaps.cycles) == 200 and int(snaps.failure) == 0
    assert np.isnan(snaps.multipliers).all() and float(snaps.x[-1]) > 5000
    # Without damping the end-effector rings on the bonds for ever.
    assert int(rings.period) == 0 and float(rings.x[-1]) == 0
    # The bonds remember how they were at the start: the motion repeats, but no orbit attracts it.
    assert int(stretches.period) == 1 and float(stretches.x[-1]) == 0 and abs(float(stretches.gain[0])) < 1e-12
    assert np.isnan(stretches.multipliers).all() and np.isnan(float(stretches.grazing))
