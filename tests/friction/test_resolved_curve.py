"""A step of the integrator resolves the Stribeck curve that it crosses, not the motion alone."""

import jax
import jax.numpy as jnp
import pytest

from pdssjax import Accuracy, Actuator
from pdssjax.drive.sawtooth import Sawtooth
from pdssjax.friction.stribeck import Stribeck
from pdssjax.integration.one_step import attempt, until_event
from pdssjax.integration.polynomials import horner
from pdssjax.integration.step_table import initial_loop_state
from pdssjax.integration.taylor_series import polynomial
from pdssjax.piezo.second_order import SecondOrder
from pdssjax.simulation import StickSlip


@pytest.fixture(scope="module")
def left_over():
    """What a step that begins while sliding at `v` [m/s] leaves of exp(-|v/v_s|^delta), as a function."""

    def compared(v, delta):
        law = Stribeck(delta=delta)
        system = StickSlip(Actuator(SecondOrder(), law), Sawtooth(64.0, 20.0, 2e-4))
        loop = initial_loop_state(system)
        leaves = list(loop.x)
        leaves[1] = v
        loop = loop._replace(x=tuple(leaves), mode=jnp.ones(()))
        accuracy = Accuracy()
        piece = attempt(
            system, system.segment(0.0), loop, accuracy.method, accuracy.tolerance, jnp.asarray(0.01), jnp.ones(())
        )
        duration, *_ = until_event(system, system.segment(0.0), loop, piece, jnp.ones(()))
        time = 0.999 * duration  # where it ends at v = 0, just before
        coefficients = piece.polynomials[1]
        series = law._weakening(polynomial(coefficients))
        end = horner([series[k] * 1.0 for k in range(len(coefficients))], time)
        return end - law._weakening(horner(coefficients, time)), duration

    return jax.jit(compared)


# By default `tests/contracts/test_families.py` has every law that makes something of the velocity.
@pytest.mark.slow
@pytest.mark.parametrize("delta", [0.7, 1.0, 1.5, 2.0])
@pytest.mark.parametrize("v", [1e-5, 1e-4, 1e-3, 2e-3])
def test_a_step_resolves_the_stribeck_curve(left_over, v, delta):
    error, length = left_over(v, delta)
    assert length > 0.0
    assert abs(error) < 5e-4
