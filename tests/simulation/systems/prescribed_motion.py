"""A contact of elastoplastic elements that is moved to and fro."""

import jax.numpy as jnp

from pdssjax.friction.generalized_maxwell_slip import GeneralizedMaxwellSlip
from pdssjax.simulation import PrescribedMotion

HORIZON = 1.0


def system(factor):
    times = jnp.linspace(0.0, HORIZON, 41)
    return PrescribedMotion(GeneralizedMaxwellSlip(), times, 4e-6 * factor * jnp.sin(9.0 * times))
