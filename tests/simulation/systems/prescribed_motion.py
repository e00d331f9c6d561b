"""An elastoplastic contact that is moved to and fro."""

import jax.numpy as jnp

from pdssjax.friction.elastoplastic import Elastoplastic
from pdssjax.simulation import PrescribedMotion

HORIZON = 1.0


def system(factor):
    times = jnp.linspace(0.0, HORIZON, 41)
    return PrescribedMotion(Elastoplastic(), times, 4e-6 * factor * jnp.sin(9.0 * times))
