"""The package's own systems through the public `integrate`: what `simulate` gives, and the events besides."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import pdssjax
from pdssjax import Accuracy, Actuator, Effector, InputError, Taylor
from pdssjax.drive.sawtooth import Sawtooth
from pdssjax.friction.coulomb import Coulomb
from pdssjax.integration import integrate
from pdssjax.piezo.second_order import SecondOrder
from pdssjax.simulation import StickSlip

TIMES = np.linspace(0.0, 5e-3, 6)
"""[s]; two cycles, and as many as in `test_compiled_once`."""


def rig(mass=0.086):
    return Actuator(SecondOrder(), Coulomb(), Effector(mass)), Sawtooth(voltage=64.0, frequency=400.0)


def test_the_actuator_moves_as_simulate_has_it_and_its_events_move_with_the_mass():
    usual = pdssjax.simulate(*rig(), TIMES, Accuracy(tolerance=1e-14))

    def first_events(mass):
        run = integrate(StickSlip(*rig(mass)), 0.0, 5e-3, saveat=TIMES, method=Taylor(), atol=1e-14)
        return run.events.ts[:3], run

    mass, step = jnp.asarray(0.086), 1e-5
    moved = jax.jit(lambda mass: jax.jvp(first_events, (mass,), (jnp.ones(()),), has_aux=True))
    _, slopes, run = moved(mass)
    np.testing.assert_allclose(run.ys.v, usual.platform_velocity - usual.effector_velocity, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(run.ys.d, usual.platform - usual.effector, rtol=0.0, atol=1e-13)
    assert int(run.events.count) == int(usual.events) > 3
    assert int(run.result) == 0 and run.stats["steps"] > 0
    above, below = (moved(mass + way * step)[0] for way in (1.0, -1.0))
    np.testing.assert_allclose(slopes, (above - below) / (2.0 * step), rtol=1e-5, atol=1e-9)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"t0": 1.0, "t1": 2.0}, "found `t0` = 1.0, expected 0 for an AbstractHybridSystem"),
        ({"y0": (0.0, 0.0)}, "found `y0` of the structure .* expected that of the system"),
        ({"args": {}}, "found `args` for an AbstractHybridSystem"),
        ({"mode": 1}, "found `mode` for"),
        ({"atol": (1e-12, 1e-12)}, "found `atol` for .* a displacement"),
        ({"saveat": [6e-3]}, "in `saveat`, expected times from 0 to 0.005"),
    ],
)
def test_what_such_a_system_knows_itself_is_refused(change, says):
    with pytest.raises(InputError, match=says):
        integrate(**({"system": StickSlip(*rig()), "t0": 0.0, "t1": 5e-3} | change))
