"""Once a transient has died out, nothing but its rate limits the steps: derivatives must not grow with them.

Each derivative at the usual accuracy against central differences at the tightest one, in the parameter of the
transient: late in a slow record it is small, and what a step too long makes of it is not.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pdssjax import Accuracy, Actuator, Sensor, Stop
from pdssjax.drive.sawtooth import Sawtooth
from pdssjax.drive.triangle import Triangle
from pdssjax.friction.coulomb import Coulomb
from pdssjax.friction.simplified_lugre import SimplifiedLuGre
from pdssjax.integration import SETTLED, TIGHT, integrate_steps, step_end
from pdssjax.piezo.bouc_wen import BoucWen
from pdssjax.piezo.second_order import SecondOrder
from pdssjax.simulation import DISPLACEMENT, STOP_FORCE, PlatformOnly, StickSlip, sensor_samples

TIMES = np.concatenate([np.linspace(1e-4, 0.02, 50), np.linspace(0.03, 0.4, 50)])
WALK = Sawtooth(60.0, 2.0, 1e-3)


def walk(bandwidth):
    return StickSlip(Actuator(SecondOrder(), SimplifiedLuGre()), WALK, Sensor(bandwidth))


def push(bandwidth):
    return StickSlip(Actuator(SecondOrder(), SimplifiedLuGre(), stop=Stop()), WALK, Sensor(bandwidth))


def loop(frequency):
    return PlatformOnly(
        Actuator(BoucWen(natural_frequency=frequency), SimplifiedLuGre()).driven_platform, Triangle(60.0, 1.0)
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("system", "value", "output", "resolution"),
    [
        pytest.param(walk, 2e4, DISPLACEMENT, 1e-9, id="a quick sensor of a slow walk"),
        pytest.param(push, 2e3, STOP_FORCE, 1e-6, id="a force sensor that is leant on"),
        pytest.param(loop, 6736.0, DISPLACEMENT, 1e-9, id="a stack with hysteresis on a slow triangle"),
    ],
)
def test_derivatives_stay_right_after_the_transient(system, value, output, resolution):
    @jax.jit
    def shown(factor, tolerance, settle_tolerance):
        accuracy = Accuracy(tolerance, settle_tolerance, max_steps=40_000)
        motion = lambda factor: sensor_samples(system(value * factor), jnp.asarray(TIMES), accuracy, output)
        return jax.jvp(motion, (factor,), (jnp.ones(()),))

    usual, step = Accuracy(), 1e-4
    slope = np.asarray(shown(1.0, usual.tolerance, usual.settle_tolerance)[1])
    values = lambda factor: np.asarray(shown(factor, TIGHT.tolerance, TIGHT.settle_tolerance)[0])
    differences = (values(1.0 + step) - values(1.0 - step)) / (2.0 * step)
    assert np.isfinite(differences).all()
    assert np.abs(slope - differences).max() < 1e-3 * np.abs(differences).max() + 0.1 * resolution


def test_a_platform_that_rings_under_a_settled_contact_moves_at_its_own_rate():
    """The contact sticks for good while the platform rings: at the corner after it the derivatives need y''."""
    actuator = Actuator(SecondOrder(), Coulomb())
    system, mode = StickSlip(actuator, WALK), jnp.asarray(SETTLED, float)
    segment, begin, at, duration = (
        WALK.segment(jnp.asarray(2.0)),
        system.initial(),
        jnp.asarray(2e-4),
        jnp.asarray(3e-4),
    )
    end = system.exact(segment, at, begin, duration, begin)
    rates = step_end.rates_at_end(system, segment, at, begin, duration, end, mode)
    expected = system.field(segment, at + duration, end, jnp.ones(())).driven
    assert abs(expected.stack[1]) > 0.1, "it rings"
    np.testing.assert_allclose(rates.driven.stack, expected.stack, rtol=1e-9)
    assert float(rates.d) == 0.0 and float(rates.v) == 0.0


@pytest.mark.slow
def test_what_is_below_rounding_is_not_stepped():
    # Reversals that rounding makes have no derivative.
    steps = [
        int(integrate_steps(walk(2e4), jnp.asarray(1.0), Accuracy(settle_tolerance=tolerance)).count)
        for tolerance in (1e-15, 0.0)
    ]
    assert steps[0] == steps[1]
