"""The solver finds certified answers, keeps bounds, shrugs off scales and trials that cannot be evaluated."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest

from pdssjax.inference import BoundedLevenbergMarquardt, least_squares_covariance

# Nonlinear regression of the Statistical Reference Datasets, NIST, public domain:
# https://www.itl.nist.gov/div898/strd/nls/nls_main.shtml
MISRA = (
    "77.6 114.9 141.1 190.8 239.9 289.0 332.8 378.4 434.8 477.3 536.8 593.1 689.1 760.0",
    "10.07 14.73 17.94 23.93 29.61 35.18 40.02 44.82 50.76 55.05 61.01 66.40 75.47 81.78",
)
THURBER = (
    "-3.067 -2.981 -2.921 -2.912 -2.840 -2.797 -2.702 -2.699 -2.633 -2.481 -2.363 -2.322 -1.501 -1.460 -1.274 -1.212 "
    "-1.100 -1.046 -0.915 -0.714 -0.566 -0.545 -0.400 -0.309 -0.109 -0.103 0.010 0.119 0.377 0.790 0.963 1.006 1.115 "
    "1.572 1.841 2.047 2.200",
    "80.574 84.248 87.264 87.195 89.076 89.608 89.868 90.101 92.405 95.854 100.696 101.060 401.672 390.724 567.534 "
    "635.316 733.054 759.087 894.206 990.785 1090.109 1080.914 1122.643 1178.351 1260.531 1273.514 1288.339 1327.543 "
    "1353.863 1414.509 1425.208 1421.384 1442.962 1464.350 1468.705 1447.894 1457.628",
)
MGH09 = (
    "4 2 1 0.5 0.25 0.167 0.125 0.1 0.0833 0.0714 0.0625",
    "0.1957 0.1947 0.1735 0.16 0.0844 0.0627 0.0456 0.0342 0.0323 0.0235 0.0246",
)


def misra(b, x):
    return b[0] * (1.0 - jnp.exp(-b[1] * x))


def thurber(b, x):
    return (b[0] + x * (b[1] + x * (b[2] + x * b[3]))) / (1.0 + x * (b[4] + x * (b[5] + x * b[6])))


def mgh09(b, x):
    return b[0] * (x**2 + x * b[1]) / (x**2 + x * b[2] + b[3])


CERTIFIED = {
    "Misra1a": (
        misra,
        MISRA,
        [[500, 1e-4], [250, 5e-4]],
        [2.3894212918e02, 5.5015643181e-04],
        [2.7070075241e00, 7.2668688436e-06],
        1.2455138894e-01,
    ),
    "Thurber": (
        thurber,
        THURBER,
        [[1000, 1000, 400, 40, 0.7, 0.3, 0.03], [1300, 1500, 500, 75, 1, 0.4, 0.05]],
        [
            1.2881396800e03,
            1.4910792535e03,
            5.8323836877e02,
            7.5416644291e01,
            9.6629502864e-01,
            3.9797285797e-01,
            4.9727297349e-02,
        ],
        [
            4.6647963344e00,
            3.9571156086e01,
            2.8698696102e01,
            5.5675370270e00,
            3.1333340687e-02,
            1.4984928198e-02,
            6.5842344623e-03,
        ],
        5.6427082397e03,
    ),
    "MGH09": (
        mgh09,
        MGH09,
        [[25, 39, 41.5, 39], [0.25, 0.39, 0.415, 0.39]],
        [1.9280693458e-01, 1.9128232873e-01, 1.2305650693e-01, 1.3606233068e-01],
        [1.1435312227e-02, 1.9633220911e-01, 8.0842031232e-02, 9.0025542308e-02],
        3.0750560385e-04,
    ),
}
LINES = jnp.array([[1.0, 2.0], [3.0, -1.0], [0.5, 1.0], [2.0, 2.0]])
"""Rows of a small linear problem."""


def line(y, args):
    """Four equations in two unknowns with the exact answer (2, -3)."""
    return LINES @ (y - jnp.array([2.0, -3.0])), None


def steep(y, args):
    """Rosenbrock's valley, its minimum at (1, 1)."""
    return jnp.stack([10.0 * (y[1] - y[0] ** 2), 1.0 - y[0]]), None


def solve(fn, start, low=None, high=None, max_steps=300, rtol=1e-8, atol=1e-12):
    """Through optimistix; bounds default to none."""
    y = jnp.asarray(start, float)
    low = jnp.full(y.shape, -jnp.inf) if low is None else jnp.asarray(low, float)
    high = jnp.full(y.shape, jnp.inf) if high is None else jnp.asarray(high, float)
    return _solved(fn, y, {"lower": low, "upper": high}, max_steps, jnp.asarray(rtol), jnp.asarray(atol))


@eqx.filter_jit
def _solved(fn, y, options, max_steps, rtol, atol):
    solver = BoundedLevenbergMarquardt(rtol=rtol, atol=atol)
    return optx.least_squares(fn, solver, y, has_aux=True, options=options, max_steps=max_steps, throw=False)


def steps(fn, start, low, high, count):
    """The points visited and the states, one step after the other."""
    y, options = jnp.asarray(start, float), {"lower": jnp.asarray(low, float), "upper": jnp.asarray(high, float)}
    out, aux = fn(y, None)
    state = BoundedLevenbergMarquardt(rtol=1e-16).init(fn, y, None, options, out, aux, frozenset())
    visited = []
    for _ in range(count):
        y, state = _stepped(fn, y, options, state)
        visited.append((np.asarray(y), state))
    return visited


@eqx.filter_jit
def _stepped(fn, y, options, state):
    y, state, _ = BoundedLevenbergMarquardt(rtol=1e-16).step(fn, y, None, options, state, frozenset())
    return y, state


@pytest.mark.parametrize("name", CERTIFIED)
def test_certified_problems_are_solved_to_seven_digits(name):
    model, data, starts, answer, deviations, squares = CERTIFIED[name]
    x, measured = (jnp.array([float(word) for word in words.split()]) for words in data)
    residual = lambda b, _: (model(b, x) - measured, None)
    for start in starts:
        solution = solve(residual, start, rtol=1e-15, atol=0.0)
        assert solution.result == optx.RESULTS.successful
        np.testing.assert_allclose(solution.value, answer, rtol=1e-7)
        state = solution.stats["state"]
        np.testing.assert_allclose(np.sum(state.residual**2), squares, rtol=1e-9)
        found = least_squares_covariance(np.asarray(state.jacobian), np.zeros(len(answer), bool))
        noise = squares / (x.size - len(answer))
        np.testing.assert_allclose(np.sqrt(np.diag(found.matrix) * noise), deviations, rtol=1e-6)


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
    np.testing.assert_allclose(state.jacobian, [[-20.0, 10.0], [-1.0, 0.0]], atol=1e-6)


def test_a_bound_that_keeps_the_answer_out_is_reached_exactly():
    solution = solve(line, [0.0, 0.0], low=[-5.0, -1.0], high=[5.0, 5.0])
    assert solution.result == optx.RESULTS.successful
    assert float(solution.value[1]) == -1.0
    # With the second held at -1, the first solves what is left: least squares by hand.
    a, b = np.asarray(LINES).T
    rest = 2.0 * a - 2.0 * b
    assert float(solution.value[0]) == pytest.approx(rest @ a / (a @ a), rel=1e-4)


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


def test_the_scale_of_the_columns_changes_nothing():
    # As far as rounding lets the two go alike: the valley ends in an exact zero.
    units = jnp.array([1e-8, 1e8])
    plain = steps(steep, [-1.2, 1.0], [-jnp.inf] * 2, [jnp.inf] * 2, 7)
    scaled = steps(
        lambda y, args: steep(y * units, args), jnp.array([-1.2, 1.0]) / units, [-jnp.inf] * 2, [jnp.inf] * 2, 7
    )
    for (y, state), (other, same) in zip(plain, scaled, strict=True):
        assert int(state.iterations) == int(same.iterations)
        np.testing.assert_allclose(other * np.asarray(units), y, rtol=1e-5, atol=1e-7)


def test_trials_that_cannot_be_evaluated_are_rejected():
    def logarithm(y, args):
        return jnp.stack([jnp.log(y[0] - 100.0) + 4.0, 0.1 * (y[1] - 1.0)]), None

    solution = solve(logarithm, [105.0, 0.0], rtol=1e-16)
    assert solution.result == optx.RESULTS.successful
    np.testing.assert_allclose(solution.value, [100.0 + np.exp(-4.0), 1.0], rtol=1e-8)
    visited = steps(logarithm, [105.0, 0.0], [-jnp.inf] * 2, [jnp.inf] * 2, 3)
    assert int(visited[1][1].rejected) == 1
    np.testing.assert_array_equal(visited[1][0], [105.0, 0.0])


def test_a_start_that_cannot_be_evaluated_is_said_to_be_one():
    solution = solve(lambda y, args: (jnp.sqrt(y), None), [-1.0, 2.0])
    assert solution.result == optx.RESULTS.nonlinear_divergence
    np.testing.assert_array_equal(solution.value, [-1.0, 2.0])


def test_running_out_of_steps_is_not_success():
    assert solve(steep, [-1.2, 1.0], max_steps=3).result == optx.RESULTS.nonlinear_max_steps_reached


def test_a_fall_without_a_floor_ends_as_a_stall_not_as_success():
    # The gradient is always wrong: no step ever lowers the sum of squares.
    def lying(y, args):
        return jnp.stack([1.0 + jnp.abs(jnp.sin(1e6 * y[0])) + 1e-3 * y[0], y[1]]), None

    solution = solve(lying, [0.7, 0.0], rtol=1e-12)
    assert solution.result != optx.RESULTS.successful


def test_a_parameter_without_influence_stays_where_it_is():
    solution = solve(lambda y, args: (steep(y[:2], args)[0], None), [-1.2, 1.0, 7.0])
    assert solution.result == optx.RESULTS.successful
    np.testing.assert_allclose(solution.value[:2], [1.0, 1.0], rtol=1e-4)
    assert float(solution.value[2]) == 7.0


def test_two_parameters_known_by_their_sum_alone_still_converge():
    def summed(y, args):
        return jnp.exp(y[0] + y[1]) - jnp.array([2.0, 2.2]), None

    solution = solve(summed, [0.0, 0.0])
    assert solution.result == optx.RESULTS.successful
    assert float(solution.value[0] + solution.value[1]) == pytest.approx(np.log(2.1), rel=1e-4)
