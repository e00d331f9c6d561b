"""Draws from a posterior: of Gaussian and banana-shaped densities that are known, in parts and in one go."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pdssjax import InputError
from pdssjax.inference.draws import Drawing, InMemory
from pdssjax.inference.uncertainty.preconditioner import Preconditioner, precondition
from pdssjax.inference.uncertainty.profile_likelihood import learn_curvature
from pdssjax.inference.uncertainty.second_order import Point
from pdssjax.metrics import effective_size, rhat

posterior = pytest.importorskip("pdssjax.inference.uncertainty.posterior")
pytest.importorskip("numpyro")

DESIGN = np.random.default_rng(0).normal(size=(7, 2)) * [1.0, 100.0] @ np.array([[1.0, 0.3], [0.2, 1.0]])
EVERYWHERE = np.full(2, -np.inf), np.full(2, np.inf)


class Residual(eqx.Module):
    """Linear, or a valley that is bent and narrow: `bend` 0 or more."""

    design: np.ndarray
    bend: np.ndarray

    def __call__(self, x):
        def of(x):
            bent = jnp.stack([100.0 * (x[1] - x[0] ** 2), x[0] - 1.0])
            return jnp.where(self.bend > 0.0, jnp.concatenate([bent, jnp.zeros(5)]), self.design @ x)

        return of(x), jax.jacfwd(of)(x)


LINEAR, BENT = (Residual(DESIGN, np.array(bend)) for bend in (0.0, 1.0))


def drawn(residual, centre, drawing, bounds=EVERYWHERE, factor=1.0, chains=4):
    evaluate = lambda at: residual(jnp.asarray(at))
    optimum = Point(np.array(centre), *map(np.asarray, evaluate(centre)))
    curvature = learn_curvature(evaluate, optimum, 1.0, bounds)
    preconditioner = precondition(optimum, np.arange(2), curvature, np.array(factor), bounds)
    density = posterior.Density(residual, preconditioner, np.array(factor))
    return posterior.sample_posterior(density, drawing, None, lambda message: None, chains)


def test_of_a_gaussian_they_have_its_moments_to_the_monte_carlo_error():
    for factor in (1.0, 4.0):
        chains = drawn(LINEAR, [0.0, 0.0], Drawing(1000), factor=factor)
        covariance = factor * np.linalg.inv(DESIGN.T @ DESIGN)
        assert not chains.diverging.any()
        for i in range(2):
            draws = chains.free[:, :, i]
            size, deviation = effective_size(draws), np.sqrt(covariance[i, i])
            assert rhat(draws) < 1.01 and size > 1000
            assert abs(np.mean(draws)) < 4.0 * deviation / np.sqrt(size)
            assert np.std(draws) == pytest.approx(deviation, rel=4.0 * np.sqrt(0.5 / effective_size(draws**2)))


def test_of_a_banana_too_and_the_shear_makes_it_easy():
    """x0 is normal around 1, x1 around its square: means 1 and 2, variances 1 and 6 + 1e-4."""
    chains = drawn(BENT, [1.0, 1.0], Drawing(1000, seed=1))
    for i, (mean, variance) in enumerate([(1.0, 1.0), (2.0, 6.0001)]):
        draws = chains.free[:, :, i]
        size = effective_size(draws)
        assert rhat(draws) < 1.01 and size > 1000
        assert np.mean(draws) == pytest.approx(mean, abs=4.0 * np.sqrt(variance / size))
    assert np.mean(chains.steps) < 10.0
    straight = chains.free[:, :, 1] - chains.free[:, :, 0] ** 2
    assert np.std(straight) == pytest.approx(0.01, rel=0.1)


def test_a_bound_reflects():
    """A half of a normal distribution: its mean is sqrt(2 / pi) of a standard deviation."""
    low = np.array([0.0, -np.inf])
    chains = drawn(LINEAR, [0.0, 0.0], Drawing(1000), (low, EVERYWHERE[1]))
    draws = chains.free[:, :, 0]
    assert np.min(draws) >= 0.0
    deviation = np.sqrt(np.linalg.inv(DESIGN.T @ DESIGN)[0, 0])
    error = deviation / np.sqrt(effective_size(draws))
    assert np.mean(draws) == pytest.approx(np.sqrt(2.0 / np.pi) * deviation, abs=4.0 * error)


def test_folding_is_continuous_and_stays_inside():
    straight = Preconditioner(
        np.zeros(2), np.eye(2), np.zeros((2, 2, 2)), np.array([-1.0, -np.inf]), np.array([2.0, 1.0])
    )
    at = jnp.linspace(-9.0, 9.0, 2000)
    first, second = jax.vmap(straight)(jnp.stack([at, at], axis=1)).T
    assert float(first.min()) >= -1.0 and float(first.max()) <= 2.0 and float(second.max()) <= 1.0
    assert float(jnp.abs(jnp.diff(first)).max()) < 0.0091
    inside = (at > -1.0) & (at < 1.0)
    np.testing.assert_allclose(first[inside], at[inside])
    np.testing.assert_allclose(second[inside], at[inside])


class Broken(InMemory):
    """Is broken off after five blocks."""

    def keep(self, entry):
        if len(self.kept()) == 5:
            raise KeyboardInterrupt
        super().keep(entry)


def test_a_run_that_was_broken_off_ends_as_if_it_had_not_been():
    whole = drawn(BENT, [1.0, 1.0], Drawing(100, seed=4), chains=2)
    store = Broken()
    with pytest.raises(KeyboardInterrupt):
        drawn(BENT, [1.0, 1.0], Drawing(100, seed=4, store=store), chains=2)
    rest = InMemory()
    for entry in store.kept():
        rest.keep(entry)
    resumed = drawn(BENT, [1.0, 1.0], Drawing(100, seed=4, store=rest), chains=2)
    for one, other in zip(whole, resumed, strict=True):
        np.testing.assert_array_equal(one, other)
    more = drawn(BENT, [1.0, 1.0], Drawing(120, seed=4, store=rest), chains=2)
    np.testing.assert_array_equal(more.free[:, :100], whole.free)


def test_what_cannot_be_simulated_anywhere_is_said():
    nowhere = Residual(np.full((7, 2), np.nan), np.array(0.0))
    straight = Preconditioner(np.zeros(2), np.eye(2), np.zeros((2, 2, 2)), *EVERYWHERE)
    with pytest.raises(InputError, match="found none of 20 starts of chain 1 that can be simulated"):
        density = posterior.Density(nowhere, straight, np.array(1.0))
        posterior.sample_posterior(density, Drawing(10), None, print)
