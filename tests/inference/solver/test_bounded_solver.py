"""The solver for anyone's residual: through `optimistix.least_squares`, between bounds, on any pytree."""

import re
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest
from nist_strd import DATA, regression, residual, starts
from scipy.optimize import least_squares

from pdssjax import BoundedLevenbergMarquardt, InputError
from pdssjax.inference.solver.trust_region import flat_bounds

PAGE = Path(__file__).parents[3] / "docs/python.md"


def test_bounds_are_those_of_scipy():
    problem, y0 = regression("Misra1a"), np.asarray(starts("Misra1a")[1])
    p = len(DATA["Misra1a"]["certified"])
    certified = np.asarray(DATA["Misra1a"]["certified"])
    fn = lambda b, problem: residual(jnp.concatenate([b, jnp.asarray(y0[p:])]), problem)
    # The optimum lies beyond the first one's upper bound.
    bounds = {"lower": 0.0, "upper": np.array([0.99 * certified[0], np.inf])}
    start = np.minimum(y0[:p], bounds["upper"])
    found = optx.least_squares(fn, BoundedLevenbergMarquardt(rtol=1e-14), start, problem, options=bounds)
    f = jax.jit(lambda b: fn(b, problem))
    beside = least_squares(
        f, start, jax.jit(jax.jacfwd(f)), (0.0, bounds["upper"]), "trf", 1e-15, 1e-15, 1e-15, x_scale="jac"
    )
    np.testing.assert_allclose(found.value, beside.x, rtol=1e-6)
    np.testing.assert_allclose(found.value[0], bounds["upper"][0], rtol=1e-12)
    assert 0.5 * float(jnp.sum(f(found.value) ** 2)) <= beside.cost * (1.0 + 1e-9)


def test_bounds_may_be_left_out_or_numbers_for_all():
    y = {"a": jnp.zeros(2), "b": jnp.zeros(())}
    bounds = flat_bounds(y, {"lower": {"a": np.array([1.0, 2.0]), "b": 3.0}})
    np.testing.assert_array_equal(bounds["lower"], [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(bounds["upper"], np.full(3, np.inf))
    np.testing.assert_array_equal(flat_bounds(jnp.zeros(2), {"upper": 4.0})["upper"], [4.0, 4.0])


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"low": 0.0}, 'the key \'low\', expected "lower" and "upper"'),
        ({"lower": np.zeros(3)}, r'options\["lower"\]: found shape \(3,\), expected \(2,\)'),
        ({"upper": {"a": 1.0, "b": 2.0}}, r'options\["upper"\]: found the structure'),
    ],
)
def test_bounds_that_fit_nothing_are_refused(options, says):
    with pytest.raises(InputError, match=says):
        optx.least_squares(lambda y, args: y, BoundedLevenbergMarquardt(), jnp.ones(2), options=options)


def test_the_page_fits_a_pytree_from_a_start_outside_its_bounds():
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.S)
    (lines,) = [block for block in blocks if "BoundedLevenbergMarquardt" in block and "identify" not in block]
    given = {}
    exec(lines, given)
    value, times = given["found"].value, np.asarray(given["times"])
    assert set(value) == {"height", "rate"}
    np.testing.assert_allclose(value["rate"], 0.5, rtol=1e-12)
    decay = np.exp(-0.5 * times)
    np.testing.assert_allclose(value["height"], decay @ np.asarray(given["measured"]) / (decay @ decay), rtol=1e-6)
