"""Posteriors of two parameters drawn by both samplers, of residuals given as a function."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pdssjax.inference.uncertainty.no_u_turn import sample_by_trajectories
from pdssjax.inference.uncertainty.posterior import posterior_model, sample_posterior
from pdssjax.inference.uncertainty.second_order import Linearisation

DESIGN = np.random.default_rng(0).normal(size=(7, 2)) * [1.0, 100.0] @ np.array([[1.0, 0.3], [0.2, 1.0]])
EVERYWHERE = np.full(2, -np.inf), np.full(2, np.inf)
LINEAR = np.zeros(2, bool)


def linear(x):
    return jnp.asarray(DESIGN) @ x


SAMPLERS = {"rto": sample_posterior, "nuts": sample_by_trajectories}
both = pytest.mark.parametrize("sampler", SAMPLERS)
slow_nuts = pytest.mark.parametrize("sampler", ["rto", pytest.param("nuts", marks=pytest.mark.slow)])


def drawn(residuals, centre, drawing, bounds=EVERYWHERE, factor=1.0, chains=4, logarithmic=LINEAR):
    """The chains of a posterior; its model is made once for the same arguments."""
    numbers = (centre, *bounds, logarithmic)
    model = _model(residuals, factor, *(tuple(np.asarray(number).tolist()) for number in numbers))
    return SAMPLERS[drawing.sampler](model, drawing, None, lambda message: None, chains)


@functools.cache
def _model(residuals, factor, centre, low, high, logarithmic):
    residuals = jax.jit(residuals)
    slope = jax.jit(jax.jacfwd(residuals))
    evaluate = lambda at: (residuals(jnp.asarray(at)), slope(jnp.asarray(at)))
    optimum = Linearisation(np.array(centre), *map(np.asarray, evaluate(centre)))
    bounds, seen_as = (np.array(low), np.array(high)), np.array(logarithmic)
    quiet = lambda message: None
    return posterior_model(evaluate, residuals, optimum, np.arange(2), bounds, seen_as, factor, None, quiet)
