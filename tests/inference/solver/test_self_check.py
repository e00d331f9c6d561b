"""A fit checks itself: a wrong Jacobian and a cliff are told apart, said, and are not success."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest
import scipy.optimize

from pdssjax import BoundedLevenbergMarquardt
from pdssjax.inference import Ending
from pdssjax.inference.solver.derivative_check import CHECKS
from pdssjax.inference.solver.iterations import FunctionEvaluations, Run, iterate
from pdssjax.inference.solver.kink import along_kink, beside_kink, least_promising

X = jnp.linspace(0.0, 3.0, 60)
NOISE = jnp.asarray(np.random.default_rng(7).normal(0.0, 1.0, 60))


def decay(y):
    """Whitened residuals of a decay with noise; parameters near (3, 0.5, -1)."""
    return 50.0 * (y[0] * jnp.exp(-y[1] * X) + y[2] - (3.0 * jnp.exp(-0.5 * X) - 1.0)) + NOISE


@jax.custom_jvp
def skewed(y, columns):
    """As `decay`, each column of its Jacobian multiplied by one of `columns`."""
    del columns
    return decay(y)


@skewed.defjvp
def _(primals, tangents):
    y, columns = primals
    return decay(y), jax.jvp(decay, (y,), (columns * tangents[0],))[1]


NOTHING = {"step": 0.0, "jump": 0.0, "wall": 0.0, "height": 0.0, "base": 0.0, "kinks": jnp.zeros(3), "within": 10.0}
NOTHING |= {"fold": 0.0, "slope": 0.0, "tied": 0.0, "recoil": 0.0}
"""Numbers with which `shaped` is `decay`."""


def shaped(y, args):
    """`decay` with what stands in the way of a search, all in one to be compiled once; each derivative is right.

    Across the parameters' sum: at `step` the residual jumps by `jump`; at `wall` the sum of squares by `height`, in a
    residual that jumps by less where it is not 0 before: by `base`; at `fold` slopes change by `slope`, by `tied` those
    of every other sample the other way round, so that exactly on the fold each takes the slope of its side, and one
    parameter jumps by `recoil`, so that the sum of squares rises from there on.
    Slopes change, too, where a parameter is `within` so much of `kinks`.
    """
    total = jnp.sum(y)
    off = total - args["fold"]
    left = decay(y + jnp.where(off > 0.0, args["recoil"], 0.0) * jnp.array([1.0, 0.0, 0.0]))
    left += jnp.where(total > args["step"], args["jump"], 0.0) * jnp.cos(5.0 * X)
    beside = y - args["kinks"]
    beyond = jnp.sign(beside) * jnp.maximum(jnp.abs(beside) - args["within"], 0.0)
    left += 50.0 * jnp.sum(beyond) * jnp.sin(7.0 * X)
    rising = jnp.where(jnp.arange(60) % 2 == 0, off > 0.0, off >= 0.0)
    left += (args["slope"] * jnp.abs(off) + args["tied"] * jnp.where(rising, off, -off)) * NOISE
    wall = jnp.sqrt(args["base"] ** 2 + jnp.where(total > args["wall"], args["height"], 0.0))
    return jnp.append(left, wall), None


def numbers(**given):
    """Arguments of `shaped`, as arrays."""
    return {name: jnp.asarray(number, float) for name, number in (NOTHING | given).items()}


SOLVER = BoundedLevenbergMarquardt(rtol=1e-6, atol=1e-4, slow=1e-3, invisible=1e-4, small_jump=0.1 / 60)
"""With thresholds as for a chi-square."""


BOUNDS = {"lower": np.full(3, -10.0), "upper": np.full(3, 10.0)}


@eqx.filter_jit
def _solve(fn, args, start):
    return optx.least_squares(fn, SOLVER, start, args, has_aux=True, options=BOUNDS, max_steps=300, throw=False)


def solve(fn, args, start=(2.0, 1.0, 0.0)):
    return _solve(fn, args, jnp.asarray(start))


@functools.cache
def smooth():
    """The fit where nothing stands in the way: where it ended, and the covariance of the parameters."""
    found = solve(shaped, numbers())
    assert ending(found) == Ending.CONVERGED
    jacobian = jax.jacfwd(decay)(found.value)
    return np.asarray(found.value), np.asarray(jnp.linalg.inv(jacobian.T @ jacobian))


def ending(solution):
    return Ending(int(solution.stats["state"].ending))


def distorted(y, args):
    """`skewed` by the columns in `args`, less a part of its noise."""
    return skewed(y, args["columns"]) - args["quiet"] * NOISE, None


def skewed_by(columns, quiet=0.0):
    return {"columns": jnp.asarray(columns), "quiet": jnp.asarray(quiet)}


def test_a_right_jacobian_is_let_pass():
    solution = solve(distorted, skewed_by([1.0, 1.0, 1.0]))
    assert ending(solution) == Ending.CONVERGED
    assert solution.result == optx.RESULTS.successful
    state = solution.stats["state"]
    assert float(state.cosine) ** 2 * float(jnp.sum(state.residual**2)) < 1e-4
    assert 0.0 <= float(state.predicted_reduction) < 1e-4
    assert int(state.checked) == CHECKS


@pytest.mark.parametrize("columns", [[1.0, 1.0, 0.0], [1.0, 0.5, 1.0], [1.0, 1.0, -1.0], [1e9, 1.0, 1.0]], ids=str)
def test_a_wrong_jacobian_is_said_and_is_not_success(columns):
    solution = solve(distorted, skewed_by(columns), (2.9, 0.52, -0.95))
    assert ending(solution) == Ending.WRONG_DERIVATIVE
    assert solution.result != optx.RESULTS.successful


def test_a_discontinuity_is_told_from_a_wrong_jacobian():
    end, _ = smooth()
    discontinuous = solve(shaped, numbers(step=np.sum(end) - 3e-9, jump=3.0))
    assert ending(discontinuous) == Ending.DISCONTINUITY
    assert discontinuous.result != optx.RESULTS.successful


def test_a_jump_that_the_data_cannot_show_is_let_pass():
    ripple = solve(shaped, numbers(step=np.sum(smooth()[0]) - 3e-9, jump=1e-4))
    assert ending(ripple) in (Ending.CONVERGED, Ending.WITHIN_ROUNDING)


def at_wall(short, height, before, base=0.0):
    """A run that begins `before` a wall, which stands `short` of the minimum, in standard errors of the sum.

    **Returns:** where it ended, how, and how far from the minimum without the wall, in standard errors.
    """
    end, covariance = smooth()
    error = np.sqrt(np.sum(covariance))
    # Along it the other parameters make the best of the sum.
    step = np.sum(covariance, axis=1) / error
    args = numbers(wall=np.sum(end) - short * error, base=base, height=height)
    found = solve(shaped, args, end - (short + before) * step)
    return found, ending(found), (np.asarray(found.value) - end) / np.sqrt(np.diag(covariance))


@pytest.mark.parametrize("base", [0.0, 1.0], ids=["seen in a large difference", "seen in small ones only"])
@pytest.mark.parametrize("short", [0.12, 0.2])
def test_a_search_that_a_small_jump_stops_beside_its_minimum_has_converged(short, base):
    found, how, off = at_wall(short, 0.05, 0.01, base)
    state = found.stats["state"]
    assert how == Ending.SMALL_JUMP and found.result == optx.RESULTS.successful
    assert float(state.jump) == pytest.approx(0.05, rel=1e-3)
    assert float(state.predicted_reduction) == pytest.approx(short**2, rel=0.1)
    assert np.max(np.abs(off)) < 1.1 * short


@pytest.mark.parametrize("base", [0.0, 1.0])
@pytest.mark.parametrize("short", [0.4, 3.0, 20.0])
def test_a_search_goes_on_over_a_small_jump_that_is_worth_it(short, base):
    _, how, off = at_wall(short, 0.05, 0.01, base)
    assert how in (Ending.CONVERGED, Ending.WITHIN_ROUNDING)
    assert np.max(np.abs(off)) < 0.02


@pytest.mark.parametrize(("short", "height"), [(0.01, 0.5), (0.2, 0.5), (0.5, 0.5), (0.2, 50.0), (2.0, 50.0)])
def test_a_search_that_a_large_jump_stops_has_not_converged(short, height):
    found, how, _ = at_wall(short, height, 0.01)
    assert how in (Ending.DISCONTINUITY, Ending.REJECTED, Ending.SLOW_STEPS)
    assert found.result != optx.RESULTS.successful


def test_slopes_that_change_beside_the_minimum_are_not_a_wrong_jacobian():
    # Both larger differences reach beyond the kinks, and the discrepancy grows with their size as that of a wrong
    # derivative does; only the small ones tell.
    end, _ = smooth()
    solution = solve(shaped, numbers(kinks=end, within=2e-4), end)
    assert ending(solution) == Ending.CONVERGED
    assert np.isfinite(np.asarray(solution.stats["state"].discrepancies)[:, 2]).any()


def fold_beside(short):
    """Where the sum of the parameters is so many of its standard errors below that of the minimum without a fold.

    **Returns:** that sum, and the parameters there that leave the least, by Lagrange's rule.
    """
    end, covariance = smooth()
    at = np.sum(end) - short * np.sqrt(np.sum(covariance))
    within = lambda two: np.array([two[0], two[1], at - two[0] - two[1]])
    left = lambda two: np.asarray(shaped_values(within(two), numbers())[0])
    found = scipy.optimize.least_squares(
        left, end[:2], x_scale=np.sqrt(np.diag(covariance))[:2], xtol=1e-14, gtol=1e-14
    )
    return at, within(found.x)


shaped_values = jax.jit(shaped)


def blank():
    """The state that a run begins with."""
    return SOLVER.init(None, jnp.zeros(3), None, BOUNDS, jax.ShapeDtypeStruct((61,), float), None, frozenset())


@pytest.mark.parametrize("short", [0.1, 0.3, 1.0, 3.0, -1.0])
def test_a_minimum_on_a_fold_is_reached_and_told_from_a_wrong_jacobian(short):
    at, least = fold_beside(short)
    args = numbers(fold=at, slope=5.0)
    found = solve(shaped, args, least + np.array([0.05, -0.02, 0.01]))
    assert ending(found) == Ending.KINK and found.result != optx.RESULTS.successful
    y, state, predicted = along_kink(run_of(args), found.value, found.stats["state"])
    assert predicted < float(SOLVER.invisible) * float(jnp.sum(state.residual**2))
    np.testing.assert_allclose(y, least, atol=1e-3)
    assert float(jnp.sum(state.residual**2)) == pytest.approx(
        float(jnp.sum(shaped_values(least, args)[0] ** 2)), rel=1e-4
    )


def run_of(args):
    return Run(SOLVER, FunctionEvaluations(eqx.Partial(shaped), args), BOUNDS)


def stopped_beside(least, run, off=1e-4):
    """A run that has ended in slow steps a hundredth of a standard error beside the point `least`."""
    y = jnp.asarray(least + off * np.array([1.0, -0.1, 0.5]))
    return y, iterate(run, y, blank())[1]._replace(ending=jnp.asarray(int(Ending.SLOW_STEPS)))


@pytest.mark.parametrize(("short", "slope"), [(0.1, 0.3), (0.1, 5.0), (1.0, 5.0)])
def test_slow_steps_beside_a_fold_are_led_on_to_the_minimum_on_it(short, slope):
    at, least = fold_beside(short)
    run = run_of(numbers(fold=at, slope=slope))
    y, state = beside_kink(run, *stopped_beside(least, run))
    assert int(state.ending) == Ending.KINK
    ahead, behind = (float(jnp.sum(point) - at) for point in state.across)
    assert ahead * behind < 0.0 and abs(ahead - behind) < 1e-5
    y, state, predicted = along_kink(run, y, state)
    assert predicted < float(SOLVER.invisible) * float(jnp.sum(state.residual**2))
    np.testing.assert_allclose(y, least, atol=1e-3)


@pytest.mark.parametrize("jump", [0.0, 0.05])
def test_slow_steps_beside_a_smooth_minimum_or_a_jump_are_no_kink(jump):
    at, least = fold_beside(0.1)
    run = run_of(numbers(fold=at, recoil=jump))
    ended, state = stopped_beside(least, run, -1e-4)
    y, after = beside_kink(run, ended, state)
    assert y is ended and after is state


def test_a_fold_that_is_a_ridge_is_no_minimum():
    at, least = fold_beside(0.0)
    args = numbers(fold=at, slope=-5.0)
    top = blank()._replace(across=jnp.stack([least + 1e-6, least - 1e-6]))
    sides = [iterate(run_of(args), y, top)[1] for y in top.across]
    assert least_promising(top, sides, least, BOUNDS)[0] == np.inf


def test_a_jacobian_that_takes_the_slope_of_either_side_sample_by_sample_is_a_fold_s_too():
    least = fold_beside(0.3)[1]
    assert ending(solve(shaped, numbers(fold=np.sum(least), tied=5.0), least)) == Ending.KINK


def noise_free(y, columns):
    """As `decay` without noise, of size one: what is left at the minimum is rounding.

    Two of the parameters, on a scale on which they hardly show, move it by as little as rounding does.
    """
    y0, y1, y2 = y
    motion = y0 * jnp.exp(-(0.5 + columns["scale"] * y1) * X) + columns["scale"] * y2
    return motion - 3.0 * jnp.exp(-0.5 * X), None


@pytest.mark.parametrize("scale", [1.0, 1e-6, 1e-9, 1e-12])
def test_rounding_is_no_discontinuity_where_a_fit_explains_its_data_perfectly(scale):
    solution = solve(noise_free, {"scale": jnp.asarray(scale)}, (2.9, 0.0, 0.0))
    assert float(jnp.sum(solution.stats["state"].residual ** 2)) < 1e-26
    assert ending(solution) in (Ending.CONVERGED, Ending.WITHIN_ROUNDING)


@pytest.mark.parametrize("columns", [[1.0, 0.5, 1.0], [1.0, 1.0, -1.0]], ids=str)
def test_a_wrong_jacobian_is_said_where_nothing_is_left_too(columns):
    solution = solve(distorted, skewed_by(columns, quiet=1.0), (2.9, 0.52, -0.95))
    assert ending(solution) == Ending.WRONG_DERIVATIVE
