"""An identification finds the truth, says how well it knows it, and what it cannot know."""

import json
import math

import numpy as np
import pytest

import pdssjax
from pdssjax import Accuracy
from pdssjax.files import EXAMPLE
from pdssjax.inference import least_squares as fitting, pose

TRUTH = {
    path: entry["value"]
    for path, entry in json.loads((EXAMPLE / "truth.json").read_text())["parameters"].items()
    if path != "piezo.mass"
}
REACHABLE = {
    "piezo.natural_frequency": 0.0114,
    "piezo.damping_ratio": 0.060,
    "piezo.gain": 0.0070,
    "friction.sigma0_a": 4.5,
    "friction.sigma0_b": 2.7,
    "friction.sigma1_a": 11.5,
    "friction.sigma1_b": 7.9,
    "friction.f_ss_a": 1.39,
    "friction.f_ss_b": 1.55,
}
"""Standard errors at the truth in percent, from the Fisher information by an independent simulator."""


@pytest.fixture(scope="module")
def example():
    return pdssjax.load_study(EXAMPLE / "study.toml")


@pytest.fixture(scope="module")
def joint(example):
    return pdssjax.identify(example)


@pytest.fixture(scope="module")
def sequential(example, joint):
    return pdssjax.identify(starting(example, joint), "sequential")


def starting(study, estimate):
    """`study` with its free parameters starting a little off an earlier estimate."""
    return study.with_starts({path: 1.05 * found.value for path, found in estimate.parameters.items()})


def test_the_example_is_found_without_starts(joint):
    assert joint.converged
    for path, error in REACHABLE.items():
        found = joint.parameters[path]
        assert abs(found.value - TRUTH[path]) < 3.0 * found.standard_error, path
        assert found.interval[0] < found.value < found.interval[1]
        assert 100.0 * found.standard_error / found.value == pytest.approx(error, rel=0.15), path


def test_the_example_is_explained_down_to_its_noise(joint):
    assert 0.9 < joint.statistics.reduced_chi2 < 1.1
    assert joint.notes == ()
    for record in joint.records:
        assert record.r2 > 0.9999
        assert record.rmse == pytest.approx(1.04e-8, rel=0.1)


def test_the_example_s_residuals_are_white_and_all_errors_agree(joint):
    assert joint.error_advice.model == "white"
    for path in REACHABLE:
        found = joint.parameters[path]
        errors = {name: error.standard_error for name, error in found.errors.items()}
        assert list(errors) == ["white", "coloured", "with-misfit"]
        assert errors["white"] == pytest.approx(found.standard_error, rel=1e-6)
        assert found.errors["white"].interval == pytest.approx(found.interval, rel=1e-9)
        assert errors["coloured"] == pytest.approx(errors["white"], rel=0.15)
        assert 0.99 * errors["coloured"] < errors["with-misfit"] < 1.6 * errors["coloured"]
    i = joint.names.index("friction.sigma0_a")
    size = np.sqrt(np.diag(joint.covariance))
    for name in ("white", "coloured", "with-misfit"):
        assert joint.covariances[name][i, i] == pytest.approx(
            joint.parameters["friction.sigma0_a"].errors[name][0] ** 2
        )
    np.testing.assert_allclose(
        joint.covariances["white"][i] / size, joint.covariance[i] / size, rtol=0, atol=1e-6 * size[i]
    )


def test_the_zeros_of_the_records_fitted_are_found_too(joint):
    truth = [1e-6 * zero for zero in json.loads((EXAMPLE / "truth.json").read_text())["offsets_um"].values()]
    for record, zero in zip(joint.records, truth, strict=True):
        if record.role == "fit":
            assert abs(record.offset - zero) < 4.0 * record.offset_standard_error, record.name
        else:
            assert abs(record.offset - zero) < 1e-8
            assert math.isnan(record.offset_standard_error)


def test_the_fisher_information_at_the_truth_is_the_known_one(example):
    problem = pose(example, TRUTH, Accuracy())
    at_truth = problem.residual.transform.encode(TRUTH)
    everything = np.ones(len(problem.records), bool)
    fit = fitting.fit_phase(problem, at_truth, everything, np.zeros(9, bool), "truth", lambda message: None)
    assert fit.iterations == 1
    information = np.asarray(fit.state.jacobian).T @ np.asarray(fit.state.jacobian)
    size = np.sqrt(np.diag(information))
    errors = np.sqrt(np.diag(np.linalg.inv(information / np.outer(size, size)))) / size
    for path, error in zip(problem.residual.transform.paths, errors, strict=True):
        assert 100.0 * error == pytest.approx(REACHABLE[path], rel=0.02), path


def test_records_agree_as_well_in_two_steps_as_jointly(joint, sequential):
    of_joint, of_sequential = ([group.sigmas for group in found.diagnosis.agreement] for found in (joint, sequential))
    assert len(of_joint) == 7 and max(of_joint) < 4.0
    np.testing.assert_allclose(of_sequential, of_joint, atol=0.1)
    assert joint.success and sequential.success


def test_the_sequential_fit_agrees_and_its_errors_are_carried_on(joint, sequential):
    assert sequential.converged
    for path in REACHABLE:
        from_joint, from_sequential = joint.parameters[path], sequential.parameters[path]
        assert abs(from_joint.value - from_sequential.value) < 2.0 * from_sequential.standard_error
        assert from_sequential.naive_standard_error <= from_sequential.standard_error * (1.0 + 1e-9)
        assert from_sequential.standard_error > 0.95 * from_joint.standard_error
    shift = [sequential.parameters[path] for path in REACHABLE if path.startswith("friction")]
    assert any(p.naive_standard_error < 0.999 * p.standard_error for p in shift)
