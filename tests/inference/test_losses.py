"""Robust losses against their closed forms, SciPy's and what a Monte Carlo scatters by."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize

from pdssjax.core import member, members
from pdssjax.inference import least_squares_covariance
from pdssjax.inference.uncertainty.parameter_errors import robust_effect

NAMES = members("inference.losses")
LOSSES = {name: member("inference.losses", name)() for name in NAMES}
R = jnp.asarray(np.concatenate([np.linspace(-30.0, 30.0, 241) + 0.01, [0.0, 1e-9, -1e-9, 1e-4, 1.3449, 1.3451]]))


def test_the_family_has_the_losses_that_people_know():
    assert set(NAMES) == {"squares", "huber", "cauchy"}
    assert [name for name in NAMES if not LOSSES[name].is_robust] == ["squares"]


@pytest.mark.parametrize("name", NAMES)
def test_a_loss_is_what_scipy_calls_by_its_name(name):
    scale = {"squares": 1.0, "huber": 1.345, "cauchy": 2.3849}[name]
    z = (np.asarray(R) / scale) ** 2
    rho = {"squares": z, "huber": np.where(z <= 1, z, 2 * np.sqrt(z) - 1), "cauchy": np.log1p(z)}[name]
    np.testing.assert_allclose(LOSSES[name].root(R) ** 2, scale**2 * rho, rtol=1e-12, atol=1e-300)
    assert np.all(np.sign(LOSSES[name].root(R)) == np.sign(R))


@pytest.mark.parametrize("name", NAMES)
def test_influence_and_curvature_are_the_derivatives_and_the_root_leads_back(name):
    loss = LOSSES[name]
    half = lambda r: 0.5 * loss.root(r) ** 2
    slopes, bends = (jax.jit(jax.vmap(derivative)) for derivative in (jax.grad(half), jax.grad(jax.grad(half))))
    np.testing.assert_allclose(slopes(R), loss.influence(R), rtol=1e-9, atol=1e-12)
    away = R[jnp.abs(jnp.abs(R) - 1.345) > 0.01]
    np.testing.assert_allclose(bends(away), loss.curvature(away), rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(loss.original(loss.root(R)), R, rtol=1e-9)
    assert float(jax.jit(jax.grad(loss.root))(0.0)) == 1.0


@pytest.mark.parametrize("name", NAMES)
def test_the_scatter_of_normal_residuals_is_their_standard_deviation(name):
    loss, random = LOSSES[name], np.random.default_rng(4)
    roots = np.asarray(loss.root(jnp.asarray(random.normal(0.0, 1.7, 4000))))
    assert loss.scatter(roots, 4000.0) == pytest.approx(1.7, rel=0.03)
    assert loss.scatter(roots, 1000.0) == pytest.approx(3.4 if name == "squares" else 1.7, rel=0.03)


@pytest.mark.parametrize("name", NAMES)
def test_the_location_is_that_of_least_loss_with_the_derivative_of_differences(name):
    loss, random = LOSSES[name], np.random.default_rng(1)
    data = jnp.asarray(np.concatenate([random.normal(3.0, 0.1, 60), random.normal(40.0, 5.0, 6)]))
    weight = jnp.asarray(10.0)
    cost = lambda z: float(jnp.sum(loss.root((data - z) * weight) ** 2))
    location, slope = jax.jit(loss.location), jax.jit(jax.grad(loss.location))
    best = scipy.optimize.minimize_scalar(cost, bounds=(2.5, 3.5 if loss.is_robust else 9.0), options={"xatol": 1e-10})
    assert float(location(data, weight)) == pytest.approx(best.x, abs=1e-6)
    slopes = np.asarray(slope(data, weight))
    assert np.sum(slopes) == pytest.approx(1.0, rel=1e-9)
    for i in (0, 7, 62):
        step = 1e-5 * np.eye(data.size)[i]
        difference = (float(location(data + step, weight)) - float(location(data - step, weight))) / 2e-5
        assert slopes[i] == pytest.approx(difference, abs=2e-4 if name == "huber" else 1e-6)
    assert np.isfinite(float(location(data, jnp.zeros(()))))


def line(random, glitches):
    """A straight line's design, and data with glitches."""
    x = np.stack([np.ones(80), np.linspace(-1.0, 1.0, 80)], axis=1)
    noise = random.normal(size=80)
    noise[random.choice(80, glitches, replace=False)] += random.normal(0.0, 30.0, glitches)
    return x, x @ [1.0, 2.0] + noise


def fitted(loss, x, y):
    """The line of least loss, by SciPy on the roots, with root and Jacobian there."""
    start = np.median(y) * np.eye(2)[0]
    root, jacobian = (lambda b, f=f: np.asarray(f(loss, b, x, y)) for f in (_root, _jacobian))
    found = scipy.optimize.least_squares(root, start, jacobian, xtol=1e-12).x
    return found, root(found), jacobian(found)


_root = eqx.filter_jit(lambda loss, b, x, y: loss.root(x @ b - y))
_jacobian = eqx.filter_jit(lambda loss, b, x, y: jax.jacfwd(lambda b: loss.root(x @ b - y))(b))


@pytest.mark.parametrize("name", ["huber", "cauchy"])
def test_the_fit_of_the_roots_is_scipy_s_robust_fit(name):
    x, y = line(np.random.default_rng(2), 6)
    found, _, _ = fitted(LOSSES[name], x, y)
    scale = {"huber": 1.345, "cauchy": 2.3849}[name]
    theirs = scipy.optimize.least_squares(lambda b: x @ b - y, found, lambda b: x, loss=name, f_scale=scale, xtol=1e-13)
    np.testing.assert_allclose(found, theirs.x, atol=2e-5)


@pytest.mark.parametrize("name", [pytest.param("huber", marks=pytest.mark.slow), "cauchy"])
def test_the_errors_are_what_estimates_scatter_by_with_and_without_glitches(name):
    random = np.random.default_rng(3)
    for glitches in (0, 8):
        found, errors = [], []
        for _ in range(200):
            x, y = line(random, glitches)
            b, root, jacobian = fitted(LOSSES[name], x, y)
            effect = robust_effect(root, jacobian, np.ones(2, bool), LOSSES[name], root.size)
            found.append(b)
            errors.append(np.linalg.norm(effect, axis=0))
        # 200 draws tell a standard deviation to 5 %.
        np.testing.assert_allclose(np.std(found, axis=0), np.mean(errors, axis=0), rtol=0.15)
        np.testing.assert_allclose(np.mean(found, axis=0), [1.0, 2.0], atol=0.08)
        assert np.std(found, axis=0)[1] < 0.26  # least squares: 0.2 without glitches, and 2 with them


def test_for_squares_the_sandwich_takes_the_scatter_from_the_residuals_and_an_unknown_parameter_has_no_effect():
    random = np.random.default_rng(4)
    x = np.concatenate([random.normal(size=(300, 2)), np.zeros((300, 1))], axis=1)
    r = 3.0 * random.normal(size=300)
    r -= x @ np.linalg.lstsq(x, r, rcond=None)[0]
    known = np.array([True, True, False])
    effect = robust_effect(r, x, known, LOSSES["squares"], r.size)
    plain = least_squares_covariance(x, ~known)
    np.testing.assert_allclose(np.sum(effect[:, :2] ** 2, axis=0), 9.0 * np.diag(plain.matrix)[:2], rtol=0.25)
    assert not effect[:, 2].any()
