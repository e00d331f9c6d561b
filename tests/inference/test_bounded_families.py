"""Bounded least squares drawn at random, ill-conditioned, linear and curved, beside SciPy."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest
from beside_scipy import best_of_scipy
from scipy.optimize import lsq_linear

from pdssjax import BoundedLevenbergMarquardt
from pdssjax.inference import SUCCESSES, Ending
from pdssjax.inference.solver.box_least_squares import solve_in_ball_and_box, solve_in_box, triangle

P, N = 7, 60


def drawn(seed, curved):
    """Matrix of condition up to 1e6, aim, curvature, start and bounds; a third of the bounds bind."""
    random = np.random.default_rng(seed)
    left, _ = np.linalg.qr(random.normal(size=(N, P)))
    right, _ = np.linalg.qr(random.normal(size=(P, P)))
    matrix = left @ np.diag(10.0 ** -np.sort(random.uniform(0.0, 6.0, P))) @ right * 1e3
    matrix = matrix * 10.0 ** random.uniform(-4.0, 4.0, P)
    size = 1.0 / np.linalg.norm(matrix, axis=0) * 30.0
    aim = matrix @ (size * random.normal(size=P)) + random.normal(size=N)
    low, high = -size * random.uniform(0.0, 3.0, P), size * random.uniform(0.0, 3.0, P)
    start = random.uniform(low, high)
    start = np.where(random.random(P) < 0.2, np.where(random.random(P) < 0.5, low, high), start)
    return start, low, high, {"matrix": matrix, "aim": aim, "curved": np.asarray(curved), "size": size}


def residual(y, args):
    """Linear where `curved` is 0, mildly curved along every column else."""
    u = y / args["size"]
    return args["matrix"] @ (args["size"] * (u + args["curved"] * (u**2 - jnp.roll(u, 1) ** 2))) - args["aim"]


@eqx.filter_jit
def _solved(y, args, options):
    solver = BoundedLevenbergMarquardt(rtol=1e-10, atol=1e-8)
    fn = lambda y, args: (residual(y, args), None)
    return optx.least_squares(fn, solver, y, args, has_aux=True, options=options, max_steps=2000, throw=False)


@pytest.mark.parametrize("curved", [0.0, 0.03, 0.2])
@pytest.mark.parametrize("seed", range(6))
def test_nobody_gets_lower(seed, curved):
    start, low, high, args = drawn(seed, curved)
    solution = _solved(jnp.asarray(start), args, {"lower": low, "upper": high})
    y, state = np.asarray(solution.value), solution.stats["state"]
    assert (low <= y).all()
    assert (y <= high).all()
    assert Ending(int(state.ending)) in SUCCESSES, Ending(int(state.ending)).name
    of_scipy = best_of_scipy(lambda x: _RESIDUAL(x, args), lambda x: _JACOBIAN(x, args), y, low, high)
    assert float(np.sum(state.residual**2)) <= of_scipy * (1.0 + 1e-6) + 1e-6


_RESIDUAL = jax.jit(residual)
_JACOBIAN = jax.jit(jax.jacfwd(residual))


@pytest.mark.parametrize("seed", range(20, 25))
def test_the_step_within_a_box_is_the_exact_minimum(seed):
    _, low, high, args = drawn(seed, 0.0)
    size = np.linalg.norm(args["matrix"], axis=0)
    upper, projected = triangle(jnp.asarray(args["matrix"] / size), jnp.asarray(-args["aim"]))
    found = solve_in_box(upper, projected, jnp.asarray(1e-16), low * size, high * size)
    known = lsq_linear(args["matrix"] / size, args["aim"], (low * size, high * size), method="bvls", tol=1e-14)
    cost = 0.5 * np.sum((args["matrix"] / size @ np.asarray(found.x) - args["aim"]) ** 2)
    assert cost == pytest.approx(known.cost, rel=1e-9)
    assert (np.asarray(found.x)[np.asarray(found.at_low)] == (low * size)[np.asarray(found.at_low)]).all()


def test_the_step_keeps_to_its_radius():
    _, low, high, args = drawn(3, 0.0)
    size = np.linalg.norm(args["matrix"], axis=0)
    upper, projected = triangle(jnp.asarray(args["matrix"] / size), jnp.asarray(-args["aim"]))
    whole = solve_in_ball_and_box(upper, projected, jnp.asarray(np.inf), low * size, high * size)
    longest = float(np.linalg.norm(whole.x))
    for share in (0.5, 1e-2, 1e-6):
        found = solve_in_ball_and_box(upper, projected, jnp.asarray(share * longest), low * size, high * size)
        assert np.linalg.norm(found.x) == pytest.approx(share * longest, rel=0.1 + 1e-9)
