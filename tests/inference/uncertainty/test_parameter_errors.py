"""The errors of a fit by all error models: held, unknown and hardly known parameters, both methods, failed fits."""

import dataclasses
from types import SimpleNamespace

import fabricated
import numpy as np
import pytest
from scipy.stats import t

from pdssjax.inference import Evidence, all_error_models, least_squares_covariance, with_error_models
from pdssjax.inference.losses.squares import Squares
from pdssjax.inference.parameter_transform import ParameterTransform
from pdssjax.inference.prior import Prior
from pdssjax.inference.uncertainty import influence
from pdssjax.inference.uncertainty.influence import FittedPoint

RANDOM = np.random.default_rng(9)
PATHS = ("piezo.gain", "piezo.damping_ratio", "friction.sigma0", "friction.sigma1", "friction.f_ss")
VALUES = np.array([2.0, 0.2, 3.0, 4.0, 5.0])


def transform(high=np.inf) -> ParameterTransform:
    """Logarithms of five parameters, the second of which may be at its upper bound."""
    ends = np.full(5, np.inf)
    ends[1] = high
    return ParameterTransform(PATHS, np.ones(5, bool), np.ones(5), np.full(5, -np.inf), ends)


def record(name, time, platform_alone, frequency):
    drive = SimpleNamespace(cycle_frequency=lambda: frequency)
    measurement = SimpleNamespace(platform_alone=platform_alone)
    told = {"offset": None, "noise": None, "conditions": (), "measured": np.zeros(time.size)}
    return SimpleNamespace(name=name, time=time, drive=drive, measurement=measurement, **told)


def linear(noise=1.0, misfit=0.0, high=np.inf):
    """A fit of a step and of four cycles by a model that is linear: its problem, and where it ended."""
    step, cycles = np.arange(60) * 1e-3, np.arange(160) / 40.0 / 5.0
    phase = np.mod(5.0 * cycles, 1.0)
    jacobian = np.zeros((220, 5))
    jacobian[:60, :2] = 30.0 * np.stack([np.exp(-step / 0.01), np.cos(300 * step)], axis=1)
    jacobian[60:, 0] = 20.0 * phase
    jacobian[60:, 2:4] = 10.0 * np.stack([np.cos(9 * phase), np.exp(-5 * phase)], axis=1)
    off = noise * RANDOM.normal(size=220)
    off[60:] += misfit * np.sin(25.0 * phase)
    for rows in (slice(0, 60), slice(60, 220)):
        jacobian[rows] -= jacobian[rows].mean(axis=0)
        off[rows] -= off[rows].mean()
    used = jacobian[:, [0, 1, 2, 3]]
    residual = off - used @ np.linalg.lstsq(used, off, rcond=None)[0]
    records = (record("step", step, True, None), record("5 Hz", cycles, False, 5.0))
    at = SimpleNamespace(transform=transform(high), prior=Prior(), loss=Squares())
    bounds, rows = (at.transform.low, at.transform.high), [slice(0, 60), slice(60, 220)]
    problem = SimpleNamespace(
        records=records,
        noise=np.ones(2),
        residual=at,
        jacobian=jacobian,
        bounds=bounds,
        rows=rows,
        rows_apart=slice(220, 220),
    )
    state = SimpleNamespace(jacobian=jacobian, residual=residual)
    return problem, SimpleNamespace(free=np.log(VALUES), state=state)


def estimated(problem, fit, method="joint"):
    """A made-up estimate of that fit, its errors those of the covariance."""
    free = problem.residual.transform
    known = least_squares_covariance(fit.state.jacobian, fit.free >= free.high)
    errors = np.sqrt(np.diag(known.matrix)) * VALUES
    parameters = {
        path: fabricated.parameter(path, value, error, "", identifiable=bool(np.isfinite(error)))
        for path, value, error in zip(PATHS, VALUES, errors, strict=True)
    }
    plain = fabricated.estimate(method)
    statistics = dataclasses.replace(plain.statistics, reduced_chi2=1.0)
    return dataclasses.replace(plain, parameters=parameters, names=PATHS, statistics=statistics)


@pytest.fixture(autouse=True)
def asked(monkeypatch):
    """Points at which the Jacobian was asked for; it is the same everywhere."""
    asked = []

    def evaluated(problem, free, report):
        asked.append(free)
        return SimpleNamespace(state=SimpleNamespace(jacobian=problem.jacobian))

    monkeypatch.setattr(influence, "evaluated", evaluated)
    return asked


def found(problem, fit, method="joint"):
    return with_error_models(estimated(problem, fit, method), Evidence(problem, fit), lambda message: None)


def test_models_come_from_the_strictest_assumption_to_the_weakest():
    assert [model.name for model in all_error_models()] == ["white", "coloured", "with-misfit"]


def test_white_errors_are_the_standard_errors_and_a_parameter_without_information_has_none():
    problem, fit = linear()
    whole = found(problem, fit)
    for path in PATHS[:4]:
        told = whole.parameters[path]
        assert told.errors["white"].standard_error == pytest.approx(told.standard_error, rel=1e-8)
        low, high = told.errors["white"].interval
        white = told.errors["white"]
        assert 55.0 < white.degrees_of_freedom < 220.0  # those of two records whose noise was estimated
        half = t.ppf(0.975, white.degrees_of_freedom) * told.standard_error / told.value
        assert (low, high) == pytest.approx((told.value * np.exp(-half), told.value * np.exp(half)), rel=1e-8)
        assert list(told.errors) == ["white", "coloured", "with-misfit"]
    assert not whole.parameters["friction.f_ss"].errors
    for matrix in whole.covariances.values():
        assert np.isnan(matrix[4]).all() and np.isfinite(matrix[:4, :4]).all()


def test_a_parameter_at_its_bound_is_held_for_all_models():
    problem, fit = linear(high=np.log(0.2))
    whole = found(problem, fit)
    assert not whole.parameters["piezo.damping_ratio"].errors
    free = [0, 2, 3]
    exact = np.linalg.inv(fit.state.jacobian[:, free].T @ fit.state.jacobian[:, free])
    size = VALUES[free]
    np.testing.assert_allclose(whole.covariances["white"][np.ix_(free, free)] / np.outer(size, size), exact, rtol=1e-8)


def test_parameters_known_only_in_combination_leave_the_others_alone():
    problem, fit = linear()
    fit.state.jacobian[:, 4] = 2.0 * fit.state.jacobian[:, 3]
    point = FittedPoint("joint", Evidence(problem, fit))
    assert point.known.tolist() == [True, True, True, False, False]
    whole = found(problem, fit)
    used = fit.state.jacobian[:, :4]
    exact = np.linalg.inv(used.T @ used)[:3, :3]
    size = VALUES[:3]
    np.testing.assert_allclose(whole.covariances["white"][:3, :3] / np.outer(size, size), exact, rtol=1e-8)


def test_white_residuals_cost_no_second_derivatives_and_others_one_evaluation_a_parameter(asked):
    found(*linear())
    assert not asked
    whole = found(*linear(misfit=4.0))
    assert len(asked) == 4  # the fifth is without information
    assert whole.error_advice.model == "with-misfit"
    assert '"5 Hz"' in whole.error_advice.reason


def test_of_a_fit_that_did_not_converge_no_error_is_advised_without_a_word():
    problem, fit = linear()
    plain = dataclasses.replace(estimated(problem, fit), converged=False)
    whole = with_error_models(plain, Evidence(problem, fit), lambda message: None)
    assert whole.error_advice.reason.startswith("The fit did not converge")
    assert not found(problem, fit).error_advice.reason.startswith("The fit did not")


def test_a_linear_model_has_the_same_errors_with_second_derivatives():
    problem, fit = linear(misfit=4.0)
    point = FittedPoint("joint", Evidence(problem, fit))
    assert not np.any(point.curvatures(lambda message: None))


def test_a_sequential_fit_has_the_errors_of_its_two_steps():
    problem, fit = linear()
    whole = found(problem, fit, "sequential")
    first = fit.state.jacobian[:60, :2]
    exact = np.linalg.inv(first.T @ first)
    size = VALUES[:2]
    np.testing.assert_allclose(whole.covariances["white"][:2, :2] / np.outer(size, size), exact, rtol=1e-8)
    later = fit.state.jacobian[60:, 2:4]
    shift = -np.linalg.solve(later.T @ later, later.T @ fit.state.jacobian[60:, :2])
    corrected = np.linalg.inv(later.T @ later) + shift @ exact @ shift.T
    size = VALUES[2:4]
    np.testing.assert_allclose(whole.covariances["white"][2:4, 2:4] / np.outer(size, size), corrected, rtol=1e-8)
    assert (np.diag(whole.covariances["with-misfit"])[:4] > 0).all()


@pytest.mark.parametrize("broken", ["residual", "jacobian"])
def test_a_fit_that_could_not_start_stays_as_it_is(broken):
    problem, fit = linear()
    plain = estimated(problem, fit)
    setattr(fit.state, broken, np.full_like(getattr(fit.state, broken), np.nan))
    assert with_error_models(plain, Evidence(problem, fit), lambda message: None) is plain


def test_a_fit_in_which_nothing_is_known_stays_as_it_is():
    problem, fit = linear()
    plain = estimated(problem, fit)
    fit.state.jacobian = np.zeros_like(fit.state.jacobian)
    assert with_error_models(plain, Evidence(problem, fit), lambda message: None) is plain


@pytest.mark.parametrize("given", [True, False])
def test_after_the_stack_only_walks_whose_noise_is_given_tell_the_variance_factor(given):
    problem, fit = linear(noise=3.0)
    for record, noise in zip(problem.records, (1.0, 1.0 if given else None), strict=True):
        record.noise = noise
    # Three parameters are fitted to the walk, one of which it does not tell, and an offset; two to the step before.
    expected = np.sum(fit.state.residual[60:] ** 2) / (160 - 3 - 1) if given else 1.0
    assert Evidence(problem, fit, after_stack=True).variance_factor == pytest.approx(expected)
    assert Evidence(problem, fit).variance_factor > 1.0
