"""Of samples that fill a record up to the longest of its group nothing is computed, and the others are as without."""

import jax
import jax.numpy as jnp
import numpy as np

from pdssjax import Accuracy, Actuator
from pdssjax.drive.sawtooth import Sawtooth
from pdssjax.friction.anisotropic_lugre import AnisotropicLuGre
from pdssjax.piezo.second_order import SecondOrder
from pdssjax.simulation import sensor_samples
from pdssjax.simulation.systems.stick_slip import StickSlip

ACTUATOR = Actuator(SecondOrder(), AnisotropicLuGre())


def test_wanted_samples_are_those_without_padding():
    own = jnp.linspace(0.0, 0.025, 300)

    def shown(voltage, times, wanted=None):
        return sensor_samples(StickSlip(ACTUATOR, Sawtooth(voltage=voltage)), times, Accuracy(), wanted=wanted)

    def weighted(voltage, times, weights, wanted=None):
        return jnp.sum(weights * shown(voltage, times, wanted))

    both = jax.jit(lambda *args: (shown(*args), jax.jacfwd(shown)(*args)))
    backwards = jax.jit(jax.grad(weighted))
    values, slopes = both(64.0, own)
    for wanted in (1, 127, 128, 129, 300):
        padded = jnp.where(jnp.arange(700) < wanted, jnp.pad(own, (0, 400)), own[-1])
        count = jnp.asarray(wanted)
        some, their_slopes = both(64.0, padded, count)
        np.testing.assert_allclose(some[:wanted], values[:wanted], rtol=1e-12, atol=1e-18)
        np.testing.assert_allclose(their_slopes[:wanted], slopes[:wanted], rtol=1e-12, atol=1e-18)
        weights = (jnp.arange(700) < wanted) * jnp.cos(jnp.arange(700.0))
        found = backwards(64.0, padded, weights, count)
        np.testing.assert_allclose(found, weights[:wanted] @ slopes[:wanted], rtol=1e-9, atol=1e-18)
