"""The fit of a platform alone, known in closed form and quick to compile: what is said, kept and written."""

import dataclasses
import json
import math

import numpy as np
import pytest
from platform_study import DAMPING, GAIN, NOISE_LINE, PLATFORM, RATE, ZERO, write_platform
from scipy import stats

import pdssjax
from pdssjax.cli.main import main
from pdssjax.inference import least_squares as fitting
from pdssjax.inference.search import races

pytestmark = pytest.mark.usefixtures("undrawn")


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


def test_residuals_far_above_the_scatter_of_neighbours_are_not_explained_although_no_noise_is_given(tmp_path):
    """A sensor that shows a new value at every second sample only: what is left of the ring alternates."""
    study = pdssjax.load_study(write_platform(tmp_path, PLATFORM.replace(NOISE_LINE, "")))
    (record,) = study.records
    held = dataclasses.replace(record, measured=np.repeat(record.measured[::2], 2))
    found = pdssjax.identify(dataclasses.replace(study, records=(held,)))
    assert any("larger than the noise seen between neighbouring samples" in note for note in found.notes)
    assert found.converged and not found.explained
    assert pdssjax.identify(study).explained


@pytest.mark.slow
def test_a_bound_at_which_a_parameter_ends_is_said_once_and_its_posterior_begins_there(tmp_path):
    """The gain may not exceed what is 3 standard errors below the truth."""
    usual = pdssjax.identify(pdssjax.load_study(write_platform(tmp_path))).parameters["piezo.gain"]
    most = usual.value - 3.0 * usual.standard_error
    text = PLATFORM.replace('"piezo.gain" = {}', f'"piezo.gain" = {{ max = {most} }}')
    study = pdssjax.load_study(write_platform(tmp_path, text))
    profiled = pdssjax.identify(study, intervals="profile")
    assert len([note for note in profiled.notes if "piezo.gain" in note]) == 1
    drawn = pdssjax.identify(study, intervals="posterior", drawing=pdssjax.Drawing(500))
    assert drawn.draws is not None and drawn.draws.failed < 0.3 * 4 * 500
    gains = drawn.draws.values[:, :, drawn.names.index("piezo.gain")]
    exact = stats.truncnorm(-np.inf, -3.0, usual.value, usual.standard_error)
    assert np.max(gains) <= most
    assert most - np.mean(gains) == pytest.approx(most - exact.mean(), rel=0.1)
    assert most - profiled.parameters["piezo.gain"].interval[0] == pytest.approx(
        (np.sqrt(3.0**2 + 1.96**2) - 3.0) * usual.standard_error, rel=0.05
    )


def test_the_command_says_by_its_status_whether_it_worked(tmp_path, monkeypatch, capsys):
    study = write_platform(tmp_path)
    assert main(["identify", str(study), "--out", str(tmp_path / "a")]) == 0
    assert json.loads((tmp_path / "a" / "estimate.json").read_text())["converged"]
    assert main(["identify", str(study), "--out", str(tmp_path / "a")]) == 2
    monkeypatch.setattr(fitting, "MAX_ITERATIONS", 1)
    monkeypatch.setattr(races.RaceContext, "is_poor", lambda *_: False)  # other starts, an iteration each, would do it
    capsys.readouterr()
    assert main(["identify", str(study), "--out", str(tmp_path / "b")]) == 3
    assert "did not converge" in capsys.readouterr().err
    written = json.loads((tmp_path / "b" / "estimate.json").read_text())
    assert not written["converged"]
    assert "no convergence within 1 iterations" in written["message"]


def test_profile_intervals_of_a_platform_are_the_linear_ones_and_an_open_end_is_said(tmp_path):
    study = pdssjax.load_study(write_platform(tmp_path))
    linear, profile = pdssjax.identify(study), pdssjax.identify(study, intervals="profile")
    for path in ("piezo.gain", "piezo.natural_frequency", "piezo.damping_ratio"):
        expected, found = linear.parameters[path], profile.parameters[path]
        np.testing.assert_allclose(found.interval, expected.interval, rtol=0.0, atol=0.05 * expected.standard_error)
        assert (expected.verdicts, found.verdicts) == (None, ("bounded", "bounded"))
    assert profile.parameters["friction.sigma0"].verdicts is None
    with pytest.raises(pdssjax.InputError, match='intervals: found "profil" with method "joint"'):
        pdssjax.identify(study, intervals="profil")  # pyright: ignore[reportArgumentType]
