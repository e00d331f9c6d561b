"""A parameter that was measured apart is fitted with that as one more measurement of it."""

import dataclasses
import json

import numpy as np
import platform_study
import pytest
from marks import slow
from scipy.optimize import least_squares

import pdssjax
from pdssjax import Drawing, InputError, load_study
from pdssjax.files import estimate_text
from pdssjax.report.text import format_report

APART = '"piezo.gain" = { value = "0.11015 um/V", standard_error = "0.00001 um/V" }'


@pytest.fixture(scope="module")
def studies(tmp_path_factory):
    """The platform's study, and the same with a gain measured apart."""
    folders = [tmp_path_factory.mktemp(name) for name in ("alone", "apart")]
    text = platform_study.PLATFORM.replace('"friction.sigma0" = {}', '"friction.sigma0" = { value = 1e6 }')
    texts = text, text.replace('"piezo.gain" = {}', APART)
    return [load_study(platform_study.write_platform(*pair)) for pair in zip(folders, texts, strict=True)]


@pytest.fixture(scope="module")
def estimates(studies):
    return [pdssjax.identify(study) for study in studies]


def by_hand(alone, number, error, factor):
    """The least-squares combination of an estimate with one more measurement of its first parameter.

    Weighed by the noise given; the variance of the samples is larger by a `factor`.
    """
    values = np.array([alone.parameters[path].value for path in alone.names])
    covariance = np.asarray(alone.covariance) / max(1.0, alone.statistics.reduced_chi2)
    gain = covariance[:, 0] / (covariance[0, 0] + error**2)
    kept = np.eye(values.size)
    kept[:, 0] -= gain
    return values + gain * (number - values[0]), factor * kept @ covariance @ kept.T + error**2 * np.outer(gain, gain)


def test_it_is_weighed_with_the_records_as_its_error_says(estimates):
    alone, both = estimates
    assert both.converged and both.names == alone.names == ("piezo.gain", *alone.names[1:])
    values, covariance = by_hand(alone, 1.1015e-7, 1e-11, max(1.0, both.records[0].reduced_chi2))
    errors = np.sqrt(np.diag(covariance))
    found = np.array([both.parameters[path].value for path in both.names])
    np.testing.assert_allclose((found - values) / errors, 0.0, atol=0.01)
    np.testing.assert_allclose(np.sqrt(np.diag(both.covariance)), errors, rtol=2e-3)
    # Neither the records' nor what was measured apart alone.
    assert 0.2 < (found[0] - alone.parameters["piezo.gain"].value) / (1.1015e-7 - found[0]) < 5.0
    assert (alone.statistics.measured_apart, both.statistics.measured_apart) == (0, 1)
    assert both.statistics.samples == alone.statistics.samples == 800
    assert "samples fitted     = 800, and 1 measured apart\n" in format_report(both)
    assert "samples fitted     = 800\n" in format_report(alone)


def test_all_error_models_count_it(estimates):
    alone, both = estimates
    for model in ("white", "coloured", "with-misfit"):
        before, after = (e.parameters["piezo.gain"].errors[model].standard_error for e in (alone, both))
        assert after == pytest.approx(1.0 / np.hypot(1.0 / before, 1.0 / 1e-11), rel=0.05)


@pytest.mark.parametrize("loss", ["huber", slow("cauchy")])
def test_under_a_robust_loss_it_has_the_error_given_too(studies, estimates, loss):
    gain = dataclasses.replace(studies[1].parameters["piezo.gain"], standard_error=1e-12)
    study = dataclasses.replace(studies[1], parameters=studies[1].parameters | {"piezo.gain": gain})
    alone = estimates[0].parameters["piezo.gain"].standard_error
    found = pdssjax.identify(study, loss=loss).parameters["piezo.gain"]
    assert found.standard_error == pytest.approx(1.0 / np.hypot(1.0 / alone, 1.0 / 1e-12), rel=0.01)


@pytest.fixture(scope="module")
def too_little_noise(studies):
    """Samples that scatter by three times the noise given: a factor of nine of the records' variances."""
    record = dataclasses.replace(studies[1].records[0], noise=platform_study.NOISE / 3.0)
    gain = dataclasses.replace(studies[1].parameters["piezo.gain"], start=1.1e-7, standard_error=5e-12)
    return dataclasses.replace(studies[1], records=(record,), parameters=studies[1].parameters | {"piezo.gain": gain})


def test_noise_given_too_small_does_not_enlarge_it(too_little_noise):
    """Errors are what the estimate scatters by, by the law of propagation."""
    study, estimate = too_little_noise, pdssjax.identify(too_little_noise)
    assert estimate.statistics.reduced_chi2 == pytest.approx(9.0, rel=0.1)
    problem, _ = pdssjax.pose_problem(study)
    values = {path: estimate.parameters[path].value for path in estimate.names}
    jacobian = np.asarray(problem.jacobian(problem.encode(values)))
    inverse = np.linalg.inv(jacobian.T @ jacobian)
    samples, apart = jacobian[:800], jacobian[800:]
    factor = float(np.sum(np.asarray(problem.whitened(problem.encode(values)))[:800] ** 2)) / 800.0
    moment = factor * samples.T @ samples + apart.T @ apart
    deviation = np.sqrt(np.diag(inverse @ moment @ inverse))
    for i, path in enumerate(estimate.names):
        found = estimate.parameters[path]
        assert found.standard_error / found.value == pytest.approx(deviation[i], rel=0.01)
        assert found.errors["white"].standard_error == pytest.approx(found.standard_error)


def test_profiles_end_where_the_errors_do_where_the_noise_given_is_too_small(too_little_noise):
    estimate = pdssjax.identify(too_little_noise, intervals="profile")
    for path in estimate.names:
        found = estimate.parameters[path]
        assert np.diff(found.interval)[0] == pytest.approx(2.0 * 1.96 * found.standard_error, rel=0.02), path
    thresholds = {profile.path: profile.threshold / 1.96**2 for profile in estimate.profiles}
    assert thresholds["piezo.gain"] < 8.0 and thresholds["piezo.damping_ratio"] == pytest.approx(9.0, rel=0.1)


def test_scipy_finds_the_same_with_the_problem_posed(studies, estimates):
    problem, start = pdssjax.pose_problem(studies[1])
    assert problem.rows_apart == slice(800, 801) and problem.whitened(start).shape == (801,)
    found = least_squares(problem.whitened, start, problem.jacobian, problem.bounds, x_scale="jac")
    values = problem.decode(found.x)
    for path in estimates[1].names:
        assert float(values[path]) == pytest.approx(estimates[1].parameters[path].value, rel=1e-6)


def test_records_that_contradict_it_are_named(studies):
    study = studies[1]
    gain = dataclasses.replace(study.parameters["piezo.gain"], start=1.105e-7, standard_error=5e-12)
    off = dataclasses.replace(study, parameters=study.parameters | {"piezo.gain": gain})
    estimate = pdssjax.identify(off)
    ended = f"{1e6 * estimate.parameters['piezo.gain'].value:.7f}"
    told = f"contradict piezo.gain as it was measured apart, 0.1105000 +/- 0.0000050 um/V: it ended at {ended} um/V, a"
    assert any(told in note for note in estimate.notes)
    gain = dataclasses.replace(gain, start=1.1005e-7, standard_error=1e-11)
    near = dataclasses.replace(study, parameters=study.parameters | {"piezo.gain": gain})
    assert not any("measured apart" in note for note in pdssjax.identify(near).notes)


def test_what_ends_many_errors_from_where_it_was_measured_apart_is_not_far_from_its_start(tmp_path):
    """A voltage is fitted in units of its error: 1000 of them are 2 V of 50."""
    text = platform_study.PLATFORM.replace('"friction.sigma0" = {}', '"friction.sigma0" = { value = 1e6 }')
    text = text.replace('"piezo.gain" = {}', '"piezo.gain" = { value = "0.11 um/V" }').replace(', voltage = "50 V"', "")
    told = '"friction.f_ss" = { value = 0.65 }\n"drive.voltage" = { value = "48 V", standard_error = "2 mV" }'
    text = text.replace('"friction.f_ss" = { value = 0.65 }', told)
    notes = pdssjax.identify(load_study(platform_study.write_platform(tmp_path, text))).notes
    assert any("contradict drive.voltage as it was measured apart, 48.0000 +/- 0.0020 V: it ended" in n for n in notes)
    assert not any("Far from" in note for note in notes)


@pytest.mark.parametrize("too_small", [1.0, 3.0])
def test_the_pull_is_how_far_the_records_alone_are_from_what_was_told(studies, too_small):
    """In standard deviations of both: told 2.8 of its own errors off, it ends nearer where records weigh as much."""
    record = dataclasses.replace(studies[0].records[0], noise=platform_study.NOISE / too_small)
    alone = pdssjax.identify(dataclasses.replace(studies[0], records=(record,))).parameters["piezo.gain"]
    error = 2.0 * alone.standard_error
    number = alone.value + 3.3 * np.hypot(error, alone.standard_error)
    gain = dataclasses.replace(studies[1].parameters["piezo.gain"], start=number, standard_error=error)
    told = dataclasses.replace(studies[1], records=(record,), parameters=studies[1].parameters | {"piezo.gain": gain})
    estimate = pdssjax.identify(told)
    found = estimate.parameters["piezo.gain"]
    assert found.measured_apart[:2] == (number, error)
    assert found.measured_apart.pull == pytest.approx(-3.3, abs=0.02)
    (note,) = [note for note in estimate.notes if "contradict piezo.gain" in note]
    assert "a pull of -3.3" in note
    assert "pull -3.3" in format_report(estimate)
    kept = json.loads(estimate_text(estimate))["parameters"]
    assert kept["piezo.gain"]["measured_apart"] == found.measured_apart._asdict()
    assert "measured_apart" not in kept["piezo.damping_ratio"]


def test_what_records_do_not_show_has_no_pull_and_each_has_the_row_of_its_own(studies):
    """Rows are in another order than parameters in the study."""
    sigma0 = dataclasses.replace(studies[1].parameters["friction.sigma0"], value=None, start=1e6, standard_error=1e4)
    study = dataclasses.replace(studies[1], parameters=studies[1].parameters | {"friction.sigma0": sigma0})
    found = pdssjax.identify(study).parameters["friction.sigma0"]
    assert np.isnan(found.measured_apart.pull)
    assert found.remark == "measured apart: 1.000 +/- 0.010"
    problem, start = pdssjax.pose_problem(study)
    jacobian = np.asarray(problem.jacobian(start))[problem.rows_apart]
    paths = problem.residual.transform.paths
    assert [paths[int(np.flatnonzero(row)[0])] for row in jacobian] == list(problem.residual.prior.paths)


def test_replicates_of_a_bootstrap_draw_it_anew(studies, estimates):
    found = pdssjax.identify(studies[1], intervals="bootstrap", drawing=Drawing(60, 3))
    low, high = found.parameters["piezo.gain"].interval
    half = 1.96 * estimates[1].parameters["piezo.gain"].standard_error
    assert high - low == pytest.approx(2.0 * half, rel=0.35)


@pytest.mark.parametrize(
    ("entry", "told"),
    [
        ('{ standard_error = "1 um/V" }', 'found "standard_error", expected it beside the "value"'),
        ('{ start = "0.1 um/V", standard_error = "1 um/V" }', 'found "standard_error", expected it beside the "value"'),
        ('{ value = "0.1 um/V", standard_error = "-1 um/V" }', "found -1e-06 m/V, expected a number above 0"),
        ('{ value = "0.1 um/V", standard_error = "1 um" }', "standard_error"),
        (
            '{ value = "0.1 um/V", standard_error = 1e-9, min = "0.2 um/V" }',
            "found 0.1 um/V, expected at least the min, 0.2 um/V",
        ),
    ],
)
def test_entries_at_fault_are_refused(tmp_path, entry, told):
    text = platform_study.PLATFORM.replace('"piezo.gain" = {}', f'"piezo.gain" = {entry}')
    with pytest.raises(InputError, match=told.replace("+", r"\+")):
        load_study(platform_study.write_platform(tmp_path, text))
