"""The solver keeps bounds, shrugs off scales and trials that cannot be evaluated; `test_nist` has certified answers."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest
from jax import lax

from pdssjax import BoundedLevenbergMarquardt
from pdssjax.inference import SUCCESSES, Ending
from pdssjax.inference.solver import levenberg_marquardt
from pdssjax.inference.solver.trust_region import best_step

LINES = jnp.array([[1.0, 2.0], [3.0, -1.0], [0.5, 1.0], [2.0, 2.0]])
"""Rows of a small linear problem."""


def line(y):
    """Four equations in two unknowns with the exact answer (2, -3)."""
    return LINES @ (y - jnp.array([2.0, -3.0]))


def steep(y):
    """Rosenbrock's valley, its minimum at (1, 1)."""
    return _padded(10.0 * (y[1] - y[0] ** 2), 1.0 - y[0])


def narrow(y):
    """The same valley, ten times as steep."""
    return _padded(100.0 * (y[1] - y[0] ** 2), 1.0 - y[0])


def decays(y):
    """Two exponentials that can be fitted exactly."""
    times = jnp.array([0.5, 1.0, 2.0, 4.0])
    return jnp.exp(-y[0] * times) + jnp.exp(-y[1] * times) - jnp.exp(-0.3 * times) - jnp.exp(-times)


def logarithm(y):
    """Not a number up to 100 in the first."""
    return _padded(jnp.log(y[0] - 100.0) + 4.0, 0.1 * (y[1] - 1.0))


def root(y):
    """Not a number below zero."""
    return _padded(*jnp.sqrt(y))


def clipped(y):
    """A number everywhere, but its slope only above one in the first, and lowest at 5/4."""
    return _padded(jnp.sqrt(jnp.maximum(y[0] - 1.0, 0.0)) - 0.5, 0.1 * (y[1] - 1.0))


def lying(y):
    """The gradient is always wrong: no step ever lowers the sum of squares."""
    return _padded(1.0 + jnp.abs(jnp.sin(1e6 * y[0])) + 1e-3 * y[0], y[1])


def summed(y):
    """Knows both by their sum alone."""
    return _padded(*(jnp.exp(y[0] + y[1]) - jnp.array([2.0, 2.2])))


def traced(y):
    """The second leaves a trace that rounding would, where nothing can be explained whole."""
    return _padded(y[0] - 1.0, 2.0 * y[0] - 3.0) + 1e-31 * y[1]


def alone(y):
    """Knows the first alone, as a valley that bends."""
    return _padded(10.0 * (y[0] ** 2 - y[0]), 1.0 - y[0])


def _padded(first, second):
    return jnp.stack([first, second, 0.0 * first, 0.0 * first])


PROBLEMS = (line, steep, narrow, decays, logarithm, root, clipped, lying, summed, traced, alone)
"""Of two parameters and four residuals each, so that one compiled function solves them all."""


def residual(y, args):
    """Of problem number `which`, in parameters of `units`."""
    which, units = args
    return lax.switch(which, PROBLEMS, y * units), None


def posed(problem, units):
    return jnp.asarray(PROBLEMS.index(problem)), jnp.asarray(units, float)


def solve(problem, start, low=None, high=None, max_steps=300, rtol=1e-8, atol=1e-12):
    """Through optimistix; bounds default to none."""
    y = jnp.asarray(start, float)
    low = jnp.full(y.shape, -jnp.inf) if low is None else jnp.asarray(low, float)
    high = jnp.full(y.shape, jnp.inf) if high is None else jnp.asarray(high, float)
    options = {"lower": low, "upper": high}
    return _solved(y, posed(problem, (1.0, 1.0)), options, max_steps, jnp.asarray(rtol), jnp.asarray(atol))


@eqx.filter_jit
def _solved(y, args, options, max_steps, rtol, atol):
    solver = BoundedLevenbergMarquardt(rtol=rtol, atol=atol)
    return optx.least_squares(
        residual, solver, y, args, has_aux=True, options=options, max_steps=max_steps, throw=False
    )


def steps(problem, start, low, high, count, units=(1.0, 1.0)):
    """The points visited and the states, one step after the other."""
    y, options = jnp.asarray(start, float), {"lower": jnp.asarray(low, float), "upper": jnp.asarray(high, float)}
    args = posed(problem, units)
    state = _begun(y, args, options)
    visited = []
    for _ in range(count):
        y, state = _stepped(y, args, options, state)
        visited.append((np.asarray(y), state))
    return visited


@eqx.filter_jit
def _begun(y, args, options):
    out, aux = residual(y, args)
    return BoundedLevenbergMarquardt(rtol=1e-16).init(residual, y, args, options, out, aux, frozenset())


@eqx.filter_jit
def _stepped(y, args, options, state):
    y, state, _ = BoundedLevenbergMarquardt(rtol=1e-16).step(residual, y, args, options, state, frozenset())
    return y, state


def test_a_linear_problem_takes_one_step_and_one_damping():
    (_, start), (_, first), (y, second) = steps(line, [40.0, 7.0], [-jnp.inf] * 2, [jnp.inf] * 2, 3)
    assert int(start.iterations) == 0
    assert int(second.iterations) == 2
    # The first step is shortened by the damping of 1e-4 alone, the second by a tenth of it.
    assert np.linalg.norm(first.residual) < 3e-3 * np.linalg.norm(start.residual)
    np.testing.assert_allclose(y, [2.0, -3.0], atol=1e-3)
    assert solve(line, [40.0, 7.0], atol=1e-24).value == pytest.approx([2.0, -3.0], abs=1e-9)


def test_the_jacobian_left_behind_is_that_at_the_answer():
    state = solve(steep, [-1.2, 1.0], atol=1e-24).stats["state"]
    np.testing.assert_allclose(state.jacobian[:2], [[-20.0, 10.0], [-1.0, 0.0]], atol=1e-6)


def test_a_valley_that_leads_into_a_bound_ends_there():
    # On the bound, 100 (0.5 - x^2)^2 + (1 - x)^2 has its minimum on the side of the start near -0.7.
    solution = solve(steep, [-1.2, 1.0], low=[-2.0, 0.5], high=[2.0, 2.0])
    assert solution.result == optx.RESULTS.successful
    assert float(solution.value[1]) == 0.5
    candidates = np.roots([400.0, 0.0, 2.0 - 400.0 * 0.5, -2.0]).real
    assert min(abs(candidates - float(solution.value[0]))) < 1e-4


def test_a_bound_met_on_the_way_is_left_again():
    (first, _), *_, (last, _) = steps(steep, [1.5, 0.3], [-2.0, 0.3], [2.0, 2.0], 30)
    np.testing.assert_array_equal(first, [1.5, 0.3])
    np.testing.assert_allclose(last, [1.0, 1.0], rtol=1e-6)
    released = solve(line, [0.0, 5.0], low=[-5.0, -5.0], high=[5.0, 5.0], rtol=1e-16)
    np.testing.assert_allclose(released.value, [2.0, -3.0], rtol=1e-6)


def test_a_bound_in_one_parameter_does_not_slow_the_others():
    # Both at once lead out of the bound; the first alone is exactly where its best is.
    visited = steps(line, [0.0, 0.0], [-5.0, -1.0], [5.0, 5.0], 5)
    assert float(visited[-1][0][1]) == -1.0
    a, b = np.asarray(LINES).T
    assert visited[-1][0][0] == pytest.approx((2.0 * a - 2.0 * b) @ a / (a @ a), rel=1e-6)


def test_every_point_visited_lies_within_the_bounds():
    low, high = np.array([-2.0, 0.5]), np.array([0.9, 2.0])
    for y, state in steps(steep, [-1.2, 1.0], low, high, 25):
        assert (low <= y).all()
        assert (y <= high).all()
        assert np.isfinite(state.residual).all()


def test_equal_bounds_hold_a_parameter():
    solution = solve(steep, [-1.2, 0.49], low=[-9.0, 0.49], high=[9.0, 0.49])
    assert solution.result == optx.RESULTS.successful
    assert float(solution.value[1]) == 0.49
    # The optimum of 100 (0.49 - x^2)^2 + (1 - x)^2 on the side of the start.
    candidates = np.roots([400.0, 0.0, 2.0 - 400.0 * 0.49, -2.0]).real
    assert min(abs(candidates - float(solution.value[0]))) < 1e-4


def test_all_parameters_held_end_at_once():
    solution = solve(steep, [-1.2, 1.0], low=[-1.2, 1.0], high=[-1.2, 1.0])
    assert solution.result == optx.RESULTS.successful
    np.testing.assert_array_equal(solution.value, [-1.2, 1.0])


@pytest.mark.parametrize("start", [(-1.2, 1.0), (-3.0, -4.0), (6.0, -30.0)])
def test_the_scale_of_the_columns_changes_nothing(start):
    units, free = jnp.array([1e-8, 1e8]), ([-jnp.inf] * 2, [jnp.inf] * 2)
    plain = steps(steep, start, *free, 20)
    scaled = steps(steep, jnp.array(start) / units, *free, 20, units)
    for (y, state), (other, same) in zip(plain, scaled, strict=True):
        np.testing.assert_allclose(other * np.asarray(units), y, rtol=1e-5, atol=1e-7)
        if np.linalg.norm(state.residual) > 1e-11:  # the valley ends in an exact zero, where rounding decides
            assert int(state.iterations) == int(same.iterations)
    assert int(plain[-1][1].iterations) >= 3 and np.linalg.norm(plain[-1][1].residual) < 1e-11


def test_steps_along_a_curved_valley_are_bent_before_one_is_rejected():
    solution = solve(narrow, [-5.0, 25.0])
    np.testing.assert_allclose(solution.value, [1.0, 1.0], rtol=1e-8)
    assert int(solution.stats["state"].iterations) <= 20  # bent after rejections alone: 87


def test_an_exact_fit_ends_where_rounding_is_all_that_is_left():
    solution = solve(decays, [0.1, 5.0], rtol=1e-12, atol=0.0)
    assert solution.result == optx.RESULTS.successful
    np.testing.assert_allclose(solution.value, [0.3, 1.0], rtol=1e-12)


def test_trials_that_cannot_be_evaluated_are_rejected():
    solution = solve(logarithm, [105.0, 0.0], rtol=1e-16)
    assert solution.result == optx.RESULTS.successful
    np.testing.assert_allclose(solution.value, [100.0 + np.exp(-4.0), 1.0], rtol=1e-8)
    visited = steps(logarithm, [105.0, 0.0], [-jnp.inf] * 2, [jnp.inf] * 2, 3)
    assert int(visited[1][1].rejected) == 1
    np.testing.assert_array_equal(visited[1][0], [105.0, 0.0])


def test_trials_whose_slopes_are_not_known_are_rejected_although_lower():
    visited = steps(clipped, [5.0, 0.0], [-jnp.inf] * 2, [jnp.inf] * 2, 3)
    assert int(visited[1][1].rejected) == 1
    assert visited[1][1].radius <= 0.1 * visited[0][1].radius
    np.testing.assert_array_equal(visited[1][0], [5.0, 0.0])
    solution = solve(clipped, [5.0, 0.0], rtol=1e-16, atol=0.0)
    assert solution.result == optx.RESULTS.successful
    np.testing.assert_allclose(solution.value, [1.25, 1.0], rtol=1e-8)


@pytest.mark.parametrize("function", [root, clipped])
def test_a_start_that_cannot_be_evaluated_is_said_to_be_one(function):
    solution = solve(function, [-1.0, 2.0])
    assert solution.result == optx.RESULTS.nonlinear_divergence
    np.testing.assert_array_equal(solution.value, [-1.0, 2.0])


def test_running_out_of_steps_is_not_success():
    assert solve(steep, [-1.2, 1.0], max_steps=3).result == optx.RESULTS.nonlinear_max_steps_reached


def test_a_fall_without_a_floor_ends_as_a_stall_not_as_success():
    solution = solve(lying, [0.7, 0.0], rtol=1e-12)
    assert solution.result != optx.RESULTS.successful


def test_a_predicted_reduction_below_zero_is_not_a_small_one(monkeypatch):
    below = lambda *given: best_step(*given)._replace(predicted=jnp.asarray(-0.04))
    monkeypatch.setattr(levenberg_marquardt, "best_step", below)
    bounds = {"lower": jnp.full(2, -jnp.inf), "upper": jnp.full(2, jnp.inf)}
    found = optx.least_squares(
        lambda y, _: (line(y), None),
        BoundedLevenbergMarquardt(),
        jnp.array([2.0, -3.0]),
        None,
        has_aux=True,
        options=bounds,
        max_steps=100,
        throw=False,
    )
    assert Ending(int(found.stats["state"].ending)) not in SUCCESSES


def test_a_parameter_without_influence_stays_where_it_is():
    solution = solve(alone, [3.0, 7.0])
    assert solution.result == optx.RESULTS.successful
    assert solution.value[0] == pytest.approx(1.0, rel=1e-4) and float(solution.value[1]) == 7.0


def test_a_parameter_whose_influence_is_rounding_stays_where_it_is():
    found = solve(traced, [5.0, 0.3], [-1e3, -1e3], [1e3, 1e3])
    assert found.result == optx.RESULTS.successful
    np.testing.assert_allclose(found.value, [1.4, 0.3], rtol=1e-12)
    assert not np.asarray(found.stats["state"].jacobian)[:, 1].any()


def test_two_parameters_known_by_their_sum_alone_still_converge():
    solution = solve(summed, [0.0, 0.0])
    assert solution.result == optx.RESULTS.successful
    assert float(solution.value[0] + solution.value[1]) == pytest.approx(np.log(2.1), rel=1e-4)
