"""Draws of a polynomial are solved further on the model, of which the solutions are known."""

import jax
import jax.numpy as jnp
import numpy as np

from pdssjax.inference.uncertainty.at_bounds import at_bounds
from pdssjax.inference.uncertainty.posterior import Model, newton_linearisations, principal_axes
from pdssjax.inference.uncertainty.randomize_then_optimize import Proposals, tangents
from pdssjax.inference.uncertainty.residual_polynomial import of_second_order
from pdssjax.inference.uncertainty.second_order import Curvature, Linearisation


def valley(x0):
    return x0**2 + 0.3 * x0**4


@jax.jit
def residuals(x):
    """Zero along a valley a five-hundredth wide; not defined where x0 is above 3."""
    along = jnp.where(x[0] > 3.0, jnp.nan, x[0])
    return jnp.stack([along, 500.0 * (x[1] - valley(along)), jnp.zeros(()), jnp.zeros(())])


def evaluate(at):
    return residuals(jnp.asarray(at)), SLOPES(jnp.asarray(at))


SLOPES = jax.jit(jax.jacfwd(residuals))


def point(at):
    return Linearisation(np.asarray(at), *map(np.asarray, evaluate(at)))


def model(low=-np.inf):
    optimum = point(np.zeros(2))
    axes = principal_axes(optimum, np.arange(2), 1.0)
    straight = of_second_order(optimum, Curvature(np.zeros((4, 2, 2)), np.eye(2)), axes)
    bounds = np.array([low, -np.inf]), np.full(2, np.inf)
    held = at_bounds(optimum, axes, np.arange(2), bounds, 1.0, np.zeros(2))
    return Model(evaluate, residuals, optimum, axes, held, bounds, np.zeros(2, bool), 1.0, straight, {})


def proposed(free, first_two=None):
    """By the linear model, or for other first two residuals than it has there."""
    free, of = np.array(free), model()
    basis = np.asarray(tangents(of.optimum.jacobian @ of.axes))
    randomized = (free * [1.0, 500.0] if first_two is None else np.array(first_two)) @ basis[:2]
    return Proposals(free, randomized, np.zeros(len(free)), np.zeros(len(free)), np.ones(len(free), bool))


def found(of, draws):
    there = [point(at) for at in draws.free]
    return there, newton_linearisations(of, draws, there, None)


def test_to_where_the_model_has_the_randomized_residuals():
    """The linear model leaves out the valley's bend, and misses it by up to 10^8 in chi-square."""
    draws = proposed(np.random.default_rng(0).normal(size=(20, 2)) * [1.5, 1.0 / 500.0])
    there, further = found(model(), draws)
    assert max(start.chi2 for start in there) > 1e6
    exact = draws.free + np.stack([np.zeros(20), valley(draws.free[:, 0])], axis=1)
    for solution in exact:
        nearest = min(further, key=lambda end: np.linalg.norm((end.at - solution) * [1.0, 500.0]))
        assert np.linalg.norm((nearest.at - solution) * [1.0, 500.0]) < 0.3
    assert len(further) <= 3 * 20


def test_what_is_solved_or_cannot_be_simulated_is_left_alone():
    _, further = found(model(), proposed([[0.0, 0.0], [4.0, 0.0]], first_two=[[0.0, 0.0], [1.0, 1.0]]))
    assert further == []


def test_no_step_leaves_the_bounds():
    _, further = found(model(low=-1.0), proposed([[0.0, 0.0]], first_two=[[-3.0, 0.0]]))
    assert further and all(end.at[0] >= -1.0 for end in further)
