"""The scale of a fit: there and back, its bounds, its derivative."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pdssjax.core import Quantity
from pdssjax.inference import transform_of
from pdssjax.study import REACH, Constraint, Parameter

POSITIVE = Quantity(1.0e6, "N/m", True, 0.0, np.inf, False)
BELOW_ONE = Quantity(0.18, "", True, 0.0, 1.0, False)
SIGNED = Quantity(0.0, "N", False, -np.inf, np.inf, True)
FROM_ZERO = Quantity(0.0, "s", False, 0.0, np.inf, True)

PARAMETERS = {
    "friction.sigma0": Parameter("friction.sigma0", "N/m", POSITIVE),
    "effector.mass": Parameter("effector.mass", "kg", POSITIVE, value=0.086),
    "piezo.damping_ratio": Parameter("piezo.damping_ratio", "", BELOW_ONE),
    "effector.load": Parameter("effector.load", "N", SIGNED),
    "drive.fall_time": Parameter("drive.fall_time", "s", FROM_ZERO, high=2e-3),
    "friction.f_c": Parameter("friction.f_c", "N", POSITIVE, low=0.2, high=0.9),
}
STARTS = {
    "friction.sigma0": 9e5,
    "effector.mass": 0.086,
    "piezo.damping_ratio": 0.2,
    "effector.load": -0.3,
    "drive.fall_time": 0.0,
    "friction.f_c": 0.5,
}
FREE = tuple(path for path in PARAMETERS if path != "effector.mass")
TRANSFORM = transform_of(PARAMETERS, STARTS)


def test_only_what_is_free_is_fitted_in_the_order_of_the_study():
    assert TRANSFORM.paths == FREE
    np.testing.assert_array_equal(TRANSFORM.logarithmic, [True, True, False, False, True])


def test_there_and_back_gives_the_same_numbers():
    random = np.random.default_rng(0)
    values = {path: STARTS[path] * random.uniform(0.5, 2.0) + 1e-4 * random.random() for path in FREE}
    decoded = TRANSFORM.decode(TRANSFORM.encode(values))
    assert {path: float(number) for path, number in decoded.items()} == pytest.approx(values, rel=1e-14)
    free = random.normal(size=len(FREE))
    found = {path: float(number) for path, number in TRANSFORM.decode(free).items()}
    np.testing.assert_allclose(TRANSFORM.encode(found), free, rtol=0.0, atol=1e-14)


def test_a_start_is_of_order_one_and_zero_stays_zero():
    at = dict(zip(FREE, TRANSFORM.encode(STARTS), strict=True))
    assert at["effector.load"] == -1.0  # in units of its own size
    assert at["drive.fall_time"] == 0.0
    assert at["friction.sigma0"] == pytest.approx(np.log(9e5))
    # A parameter that starts from zero is measured by its bound.
    assert float(TRANSFORM.decode(np.ones(len(FREE)))["drive.fall_time"]) == 2e-3


@pytest.mark.parametrize(
    ("path", "low", "high"),
    [
        ("friction.sigma0", 9e5 / REACH, 9e5 * REACH),  # nothing given, nothing legal: within reach of the start
        ("piezo.damping_ratio", 0.2 / REACH, 1.0 - 1e-6),  # just inside the legal range, which does not end in 1
        ("effector.load", -np.inf, np.inf),
        ("drive.fall_time", 0.0, 2e-3),  # the legal end below, the study's above
        ("friction.f_c", 0.2, 0.9),
    ],
)
def test_bounds_are_the_study_s_else_the_legal_ones_else_within_reach(path, low, high):
    i = FREE.index(path)
    for ends, expected in ((TRANSFORM.low, low), (TRANSFORM.high, high)):
        free = np.where(np.arange(len(FREE)) == i, ends, 0.0)
        assert float(TRANSFORM.decode(free)[path]) == pytest.approx(expected, rel=1e-12)


def test_a_start_lies_within_the_bounds():
    at = TRANSFORM.encode(STARTS)
    assert (TRANSFORM.low <= at).all()
    assert (at <= TRANSFORM.high).all()


def test_the_derivative_is_that_of_differences_and_of_jax():
    free, step = TRANSFORM.encode(STARTS) + 0.1, 1e-5
    decoded = lambda free: jnp.stack([TRANSFORM.decode(free)[path] for path in FREE])
    differences = (np.asarray(decoded(free + step)) - np.asarray(decoded(free - step))) / (2.0 * step)
    np.testing.assert_allclose(TRANSFORM.slope(free), differences, rtol=1e-9)
    jacobian = np.asarray(jax.jacfwd(decoded)(jnp.asarray(free)))
    np.testing.assert_allclose(jacobian, np.diag(TRANSFORM.slope(free)), rtol=1e-14, atol=0.0)


def test_what_is_not_fitted_is_held_where_it_is():
    fitted = TRANSFORM.among(["friction.f_c", "effector.mass"])
    np.testing.assert_array_equal(fitted, [False, False, False, False, True])
    free = TRANSFORM.encode(STARTS)
    bounds = TRANSFORM.bounds_where(fitted, free)
    np.testing.assert_array_equal(bounds["lower"][:-1], free[:-1])
    np.testing.assert_array_equal(bounds["upper"][:-1], free[:-1])
    np.testing.assert_allclose(np.exp([bounds["lower"][-1], bounds["upper"][-1]]), [0.2, 0.9])


TIED = transform_of(
    PARAMETERS | {name: Parameter(name, "N", POSITIVE) for name in ("a", "b")},
    STARTS | {"a": 2.0, "b": 1.0},
    [Constraint("one", "a", "friction.f_c", 2.0), Constraint("two", "a", "b", 1.5)],
)
"""f_c has bounds: a is fitted by its distance from twice f_c, and b by that from a."""


def test_a_tied_parameter_is_the_distance_from_its_constraint():
    values = STARTS | {"a": 2.0, "b": 1.0}
    at = dict(zip(TIED.paths, TIED.encode(values), strict=True))
    assert (at["a"], at["b"]) == pytest.approx((np.log(2.0), np.log(0.75)))
    decoded = {path: float(number) for path, number in TIED.decode(TIED.encode(values)).items()}
    assert decoded == pytest.approx({path: values[path] for path in TIED.paths}, rel=1e-14)
    bounds = {path: ends for path, *ends in zip(TIED.paths, TIED.low, TIED.high, strict=True)}
    assert bounds["a"][0] == 0.0 and bounds["b"][1] == 0.0
    np.testing.assert_allclose(TIED.from_own(TIED.own(np.arange(7.0))), np.arange(7.0), atol=1e-13)


@pytest.mark.parametrize("path", ["a", "b"])
def test_along_a_tied_parameter_it_is_a_number_of_its_own_and_the_bounds_of_the_constraints_stay(path):
    along, values = TIED.along(path), STARTS | {"a": 2.0, "b": 1.0}
    at = dict(zip(TIED.paths, along.encode(values), strict=True))
    assert at[path] == pytest.approx(np.log(values[path]))
    follows = along.own_effect(np.eye(7)).T[TIED.paths.index(path)]
    np.testing.assert_allclose(follows, np.eye(7)[TIED.paths.index(path)], atol=1e-12)
    distances = [end for end in (*along.low, *along.high) if end == 0.0]
    assert len(distances) == [*TIED.low, *TIED.high].count(0.0)


def test_the_covariance_of_tied_parameters_is_that_of_their_own_scales():
    root = np.random.default_rng(1).normal(size=(7, 7))
    expected = TIED.ties.mixing @ root @ root.T @ TIED.ties.mixing.T
    np.testing.assert_allclose(TIED.own_covariance(root @ root.T), expected, rtol=1e-12)
    unknown = root @ root.T
    i = TIED.paths.index("friction.f_c")
    unknown[i] = np.nan
    unknown[:, i] = np.nan
    lost = np.isnan(np.diag(TIED.own_covariance(unknown)))
    assert [path for path, gone in zip(TIED.paths, lost, strict=True) if gone] == ["friction.f_c", "a", "b"]
