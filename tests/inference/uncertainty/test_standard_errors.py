"""Standard errors of every method against the law of propagation, on a model that is linear."""

from types import SimpleNamespace

import numpy as np
import pytest

from pdssjax.inference import Evidence
from pdssjax.inference.losses.squares import Squares
from pdssjax.inference.parameter_transform import ParameterTransform
from pdssjax.inference.prior import Prior
from pdssjax.inference.stack_first.peak_picking import PATHS as PEAKS
from pdssjax.inference.summary import measurement_with_pull
from pdssjax.inference.uncertainty.parameter_errors import standard_errors_of

PATHS = ("piezo.gain", "friction.sigma0", "friction.f_ss")
STEP, WALK, OTHER = slice(0, 40), slice(40, 300), slice(300, 400)
NOISE_GIVEN = np.array([True, True, False])


def design():
    """Derivatives of the samples of a step and of two walks by the gain and two numbers of friction."""
    random = np.random.default_rng(5)
    columns = np.concatenate([random.normal(size=(40, 1)) * [1, 0, 0], random.normal(size=(360, 3))])
    columns[40:, 1] += 0.7 * columns[40:, 0]
    return columns


def record(rows, platform_alone, given):
    measurement, size = SimpleNamespace(platform_alone=platform_alone), rows.stop - rows.start
    noise = 1.0 if given else None
    return SimpleNamespace(time=np.arange(size), offset=0.0, noise=noise, conditions=(), measurement=measurement)


def fitted(apart, effect, scatter=1.0):
    """A fit whose estimate is `effect` times the numbers measured: its problem, and where it ended."""
    jacobian = -np.concatenate([design(), *(-np.eye(3)[[PATHS.index(path)]] / told[1] for path, told in apart.items())])
    prior = Prior.of_covariance(tuple(apart), np.zeros(len(apart)), np.diag([told[1] ** 2 for told in apart.values()]))
    off = np.random.default_rng(6).normal(size=len(jacobian))
    off[:300] *= scatter
    rows = (STEP, WALK, OTHER)
    free = effect @ off
    ends = np.full(3, np.inf)
    at = SimpleNamespace(
        transform=ParameterTransform(PATHS, np.zeros(3, bool), np.ones(3), -ends, ends), prior=prior, loss=Squares()
    )
    records = tuple(record(r, r == STEP, given) for r, given in zip(rows, NOISE_GIVEN, strict=True))
    problem = SimpleNamespace(records=records, residual=at, rows=rows, rows_apart=slice(400, len(jacobian)))
    return problem, SimpleNamespace(free=free, state=SimpleNamespace(jacobian=jacobian, residual=off + jacobian @ free))


def effect_of(method, apart):
    """The estimate as a matrix times what was measured, what a stack held exactly would leave of it: (whole, naive).

    Of what peaks tell the last row is their reading, with a standard error of 0.2.
    """
    rows = [*design(), *(np.eye(3)[PATHS.index(path)] / told[1] for path, told in apart.items())]
    if method == "peaks":
        rows.append([1.0 / 0.2, 0.0, 0.0])
    columns = np.array(rows)
    if method == "joint":
        return np.linalg.pinv(columns), None
    stack = np.zeros(len(columns), bool)
    stack[STEP] = method == "sequential"
    stack[400 : 400 + len(apart)] = [path.startswith("piezo") for path in apart]
    if method == "peaks":
        stack[400:-1], stack[-1] = False, True
    first, second = np.zeros((1, len(columns))), np.zeros((2, len(columns)))
    first[:, stack] = np.linalg.pinv(columns[stack][:, :1])
    used = ~stack if method == "sequential" else ~stack & (np.arange(len(columns)) >= 40)
    second[:, used] = np.linalg.pinv(columns[used][:, 1:])
    carried = second - second @ np.outer(columns[:, 0] * used, first)
    return np.concatenate([first, carried]), np.concatenate([first, second])


@pytest.mark.parametrize("method", ["joint", "sequential", "peaks"])
@pytest.mark.parametrize("apart", [{}, {"friction.sigma0": np.array([0.1, 0.06])}])
def test_errors_are_enlarged_by_records_whose_noise_is_given_and_for_these(method, apart):
    whole, naive = effect_of(method, apart)
    problem, fit = fitted(apart, whole[:, : 400 + len(apart)], scatter=3.0)
    picked = np.diag([0.04, 0.01, 0.01])
    stack = SimpleNamespace(prior=Prior.of_covariance(PEAKS, np.zeros(3), picked)) if method == "peaks" else None
    found = standard_errors_of(method, Evidence(problem, fit), stack)
    assert found.factor == pytest.approx(9.0, rel=0.2)
    factors = np.ones(whole.shape[1])
    factors[:300] = found.factor
    np.testing.assert_allclose(found.covariance.matrix, whole * factors @ whole.T, rtol=1e-8, atol=1e-15)
    if method == "joint":
        assert found.naive is None
    else:
        np.testing.assert_allclose(found.naive, naive * factors @ naive.T, rtol=1e-8, atol=1e-15)
    if apart:
        error = apart["friction.sigma0"][1]
        # The row of what was told is that divided by its error.
        assert found.cov_with_prior[1] == pytest.approx(whole[1, 400] / error * error**2, rel=1e-8)


@pytest.mark.parametrize("method", ["sequential", "peaks"])
def test_the_pull_after_a_step_taken_before_is_in_standard_deviations_of_chance(method):
    """A friction parameter told with less than the error that the stack leaves of it."""
    apart, random = {"friction.sigma0": np.array([0.0, 0.06])}, np.random.default_rng(7)
    whole, _ = effect_of(method, apart)
    problem, fit = fitted(apart, whole[:, :401])
    picked = Prior.of_covariance(PEAKS, np.zeros(3), np.diag([0.04, 0.01, 0.01]))
    stack = SimpleNamespace(prior=picked) if method == "peaks" else None
    found = standard_errors_of(method, Evidence(problem, fit), stack)
    assert found.covariance.matrix[1, 1] > 0.06**2
    noise = random.normal(size=(4000, whole.shape[1]))
    noise[:, :300] *= np.sqrt(found.factor)
    values, numbers = noise @ whole[1], 0.06 * noise[:, 400]
    pulls = [
        measurement_with_pull((number, 0.06), value, found.covariance.matrix[1, 1], found.cov_with_prior[1]).pull
        for number, value in zip(numbers, values, strict=True)
    ]
    assert np.std(pulls) == pytest.approx(1.0, abs=0.04)
