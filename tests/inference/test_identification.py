"""An identification finds the truth, says how well it knows it, and what it cannot know."""

import dataclasses
import json
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from platform_study import DAMPING, GAIN, PLATFORM, RATE, ZERO, write_platform

import pdssjax
from pdssjax import Accuracy
from pdssjax.cli.main import main
from pdssjax.files import EXAMPLE
from pdssjax.inference import least_squares as fitting
from pdssjax.inference.problem import pose

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
    moved = {
        path: dataclasses.replace(p, start=1.05 * estimate.parameters[path].value) if p.free else p
        for path, p in study.parameters.items()
    }
    return dataclasses.replace(study, parameters=moved)


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
    fit = fitting._least_squares(problem, at_truth, everything, np.zeros(9, bool), "truth", lambda message: None)
    assert fit.iterations == 1
    information = np.asarray(fit.state.jacobian).T @ np.asarray(fit.state.jacobian)
    size = np.sqrt(np.diag(information))
    errors = np.sqrt(np.diag(np.linalg.inv(information / np.outer(size, size)))) / size
    for path, error in zip(problem.residual.transform.paths, errors, strict=True):
        assert 100.0 * error == pytest.approx(REACHABLE[path], rel=0.02), path


def test_the_sequential_fit_agrees_and_its_errors_are_carried_on(joint, sequential):
    assert sequential.converged
    for path in REACHABLE:
        one, other = joint.parameters[path], sequential.parameters[path]
        assert abs(one.value - other.value) < 2.0 * other.standard_error
        assert other.naive_standard_error <= other.standard_error * (1.0 + 1e-9)
        assert other.standard_error > 0.95 * one.standard_error
    shift = [sequential.parameters[path] for path in REACHABLE if path.startswith("friction")]
    assert any(p.naive_standard_error < 0.999 * p.standard_error for p in shift)


def test_noise_left_out_is_estimated(example, joint):
    silent = tuple(dataclasses.replace(record, noise=None) for record in example.records)
    found = pdssjax.identify(starting(dataclasses.replace(example, records=silent), joint))
    assert found.converged
    for record in found.records:
        assert record.noise == pytest.approx(1.04e-8, rel=0.05)
    for path in REACHABLE:
        assert abs(found.parameters[path].value - TRUTH[path]) < 3.0 * found.parameters[path].standard_error


@pytest.mark.slow
def test_the_amplification_is_what_refits_at_a_moved_stack_find(example, sequential):
    """Judged within 2 % of each row's largest entry: central differences of the second step's own fits."""
    starts = {path: p.value for path, p in sequential.parameters.items()}
    problem = pose(example, starts, Accuracy())
    free = problem.encode(starts)
    piezo = fitting.of_piezo(problem.residual.transform)
    walks = ~fitting.of_platform_alone(problem.records)
    found = sequential.amplification
    assert found.earlier == tuple(path for path, is_piezo in zip(sequential.names, piezo, strict=True) if is_piezo)
    for column, path in enumerate(found.earlier):
        ends = []
        for way in (1e-4, -1e-4):
            moved = free + way * np.array([p == path for p in problem.residual.transform.paths])
            fit = fitting._least_squares(problem, moved, walks, ~piezo, "friction", lambda message: None)
            ends.append(fit.free[~piezo])
        refitted = (ends[0] - ends[1]) / 2e-4
        largest = np.max(np.abs(found.matrix), axis=1)
        assert np.all(np.abs(found.matrix[:, column] - refitted) < 0.02 * largest), (path, refitted)


# From here on a platform alone, known in closed form and quick to compile.


def test_a_parameter_without_data_is_named_and_the_others_stand(tmp_path):
    found = pdssjax.identify(pdssjax.load_study(write_platform(tmp_path)))
    assert found.converged
    assert not found.parameters["friction.sigma0"].identifiable
    assert math.isnan(found.parameters["friction.sigma0"].standard_error)
    assert any("say nothing about friction.sigma0" in note for note in found.notes)
    for path, truth in {
        "piezo.gain": GAIN,
        "piezo.natural_frequency": RATE,
        "piezo.damping_ratio": DAMPING,
    }.items():
        assert abs(found.parameters[path].value - truth) < 3.0 * found.parameters[path].standard_error


def test_a_zero_that_is_given_is_kept(tmp_path):
    text = PLATFORM.replace('noise = "0.01 um"', 'noise = "0.01 um"\noffset = "0.3 um"')
    found = pdssjax.identify(pdssjax.load_study(write_platform(tmp_path, text)))
    (record,) = found.records
    assert record.offset == pytest.approx(ZERO)
    assert math.isnan(record.offset_standard_error)
    assert found.statistics.free == 4
    assert 0.8 < found.statistics.reduced_chi2 < 1.2


def test_the_command_says_by_its_status_whether_it_worked(tmp_path, monkeypatch, capsys):
    study = write_platform(tmp_path)
    assert main(["identify", str(study), "--out", str(tmp_path / "a")]) == 0
    assert json.loads((tmp_path / "a" / "estimate.json").read_text())["converged"]
    assert main(["identify", str(study), "--out", str(tmp_path / "a")]) == 2
    monkeypatch.setattr(fitting, "MAX_ITERATIONS", 1)
    capsys.readouterr()
    assert main(["identify", str(study), "--out", str(tmp_path / "b")]) == 3
    assert "did not converge" in capsys.readouterr().err
    written = json.loads((tmp_path / "b" / "estimate.json").read_text())
    assert not written["converged"]
    assert "no convergence within 1 iterations" in written["message"]


def test_predictions_can_be_differentiated_mapped_and_compiled(tmp_path):
    study = pdssjax.load_study(write_platform(tmp_path))
    at = {"piezo.gain": jnp.asarray(GAIN), "piezo.natural_frequency": jnp.asarray(RATE)}
    whole = study.with_values({"piezo.damping_ratio": DAMPING, "friction.sigma0": 1e6})
    predict = lambda values: whole.predict(values)[0]
    plain = predict(at)
    np.testing.assert_allclose(jax.jit(predict)(at), plain, rtol=1e-12, atol=1e-18)
    jacobian = jax.jacfwd(predict)(at)
    np.testing.assert_allclose(GAIN * jacobian["piezo.gain"], plain, rtol=1e-9, atol=1e-16)
    h = 1e-3
    higher, lower = (predict(at | {"piezo.natural_frequency": jnp.asarray(RATE + s * h)}) for s in (1.0, -1.0))
    np.testing.assert_allclose(jacobian["piezo.natural_frequency"], (higher - lower) / (2 * h), atol=1e-14)
    along = {"piezo.gain": jnp.asarray(0.0), "piezo.natural_frequency": jnp.asarray(1.0)}
    np.testing.assert_allclose(jax.jvp(predict, (at,), (along,))[1], jacobian["piezo.natural_frequency"], rtol=1e-9)
    slope = jax.grad(lambda values: jnp.sum(predict(values) * plain))(at)
    for path in at:
        assert float(slope[path]) == pytest.approx(float(jnp.sum(jacobian[path] * plain)), rel=1e-9)
    many = eqx.filter_vmap(lambda gain: predict(at | {"piezo.gain": gain}))(GAIN * jnp.array([1.0, 2.0]))
    np.testing.assert_allclose(many, jnp.stack([plain, 2.0 * plain]), rtol=1e-9, atol=1e-18)


def test_profile_intervals_of_a_platform_are_the_linear_ones_and_an_open_end_is_said(tmp_path):
    study = pdssjax.load_study(write_platform(tmp_path))
    linear, profile = pdssjax.identify(study), pdssjax.identify(study, intervals="profile")
    for path in ("piezo.gain", "piezo.natural_frequency", "piezo.damping_ratio"):
        one, other = linear.parameters[path], profile.parameters[path]
        np.testing.assert_allclose(other.interval, one.interval, rtol=0.0, atol=0.05 * one.standard_error)
        assert (one.verdicts, other.verdicts) == (None, ("bounded", "bounded"))
    assert profile.parameters["friction.sigma0"].verdicts is None
    with pytest.raises(pdssjax.InputError, match='intervals: found "profil" with method "joint"'):
        pdssjax.identify(study, intervals="profil")  # pyright: ignore[reportArgumentType]
