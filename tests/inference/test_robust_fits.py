"""A record with glitches: least squares is pulled away, a robust loss is not, and its errors are right."""

import dataclasses
import json

import fabricated
import numpy as np
import pytest
from record_tables import SHORT, STEP_HEAD, step_table, write_columns

import pdssjax
from pdssjax import InputError
from pdssjax.cli.main import main
from pdssjax.files import write_estimate
from pdssjax.inference import evidence
from pdssjax.inference.uncertainty.error_models.coloured import Coloured
from pdssjax.report.figures import residual_split_figure

TRUTH = {"piezo.gain": 1.1e-7, "piezo.natural_frequency": 6000.0, "piezo.damping_ratio": 0.2}
ZERO, NOISE = 0.3e-6, 1e-8
TIME = np.arange(-0.005, 0.035, 5e-5)
STUDY = STEP_HEAD + step_table(columns=SHORT)


def write(folder, glitches, seed=3):
    """The study of a step whose samples are off by up to 2 um at some places; its path."""
    random = np.random.default_rng(seed)
    motion = ZERO + fabricated.step_motion(TIME, 50.0 * 1.1e-7, 6000.0, 0.2) + random.normal(0.0, NOISE, TIME.size)
    where = random.choice(np.arange(110, TIME.size), glitches, replace=False)
    motion[where] += random.uniform(0.5e-6, 2e-6, glitches)
    write_columns(folder / "step.csv", "time_s,y_um", TIME, 1e6 * motion)
    (folder / "study.toml").write_text(STUDY)
    return folder / "study.toml"


@pytest.fixture(scope="module")
def studies(tmp_path_factory):
    """Of a record with 40 glitches among 800 samples, and of one without."""
    folders = [tmp_path_factory.mktemp(name) for name in ("glitches", "clean")]
    return [pdssjax.load_study(write(folder, n)) for folder, n in zip(folders, (40, 0), strict=True)]


@pytest.mark.parametrize("loss", ["huber", pytest.param("cauchy", marks=pytest.mark.slow)])
def test_glitches_do_not_move_a_robust_fit(studies, loss):
    estimate = pdssjax.identify(studies[0], loss=loss)
    assert estimate.converged and estimate.loss == loss
    (record,) = estimate.records
    assert record.noise == pytest.approx(NOISE, rel=0.25)
    # The glitches go one way: Huber's loss gives in a little, Cauchy's hardly.
    within = {"huber": 0.3, "cauchy": 0.1}[loss] * NOISE
    assert record.offset == pytest.approx(ZERO, abs=within + 3.0 * NOISE / np.sqrt(TIME.size))
    for path, truth in TRUTH.items():
        found = estimate.parameters[path]
        assert abs(found.value - truth) < 4.0 * found.standard_error, path


def test_least_squares_is_pulled_away_by_them(studies):
    plain, robust = (pdssjax.identify(studies[0], loss=loss) for loss in ("squares", "cauchy"))
    (note,) = [note for note in plain.notes if "stand out" in note]
    assert "--loss huber" in note and f"{plain.records[0].outliers.size} in" in note
    assert plain.records[0].outliers.size >= 30
    (note,) = [note for note in robust.notes if "stand out" in note]
    assert "--loss huber" not in note and "Under this loss they pull little" in note
    for path in TRUTH:
        assert robust.parameters[path].standard_error < 0.15 * plain.parameters[path].standard_error
    assert abs(plain.records[0].offset - ZERO) > 5.0 * abs(robust.records[0].offset - ZERO)


@pytest.mark.parametrize("noise", [NOISE, None], ids=["given", "estimated"])
def test_glitches_are_named_where_they_alone_are_what_the_model_does_not_explain(studies, noise):
    """In records that are only predicted, too; other optima are not looked for."""
    record = dataclasses.replace(studies[0].records[0], noise=noise)
    other = dataclasses.replace(record, name="other", role="validate")
    estimate = pdssjax.identify(dataclasses.replace(studies[0], records=(record, other)))
    assert estimate.success and estimate.statistics.evaluations < 30
    assert estimate.records[0].rmse > 10.0 * NOISE
    for found in estimate.records:
        assert found.rest_rmse == pytest.approx(NOISE, rel=0.1)
    (note,) = estimate.notes
    assert "They are most likely glitches" in note and ' in "other" by up to ' in note
    assert ("Standard errors from records with given noise are multiplied by" in note) is (noise is not None)
    # Not a misfit, and errors by every model hold what they do.
    assert estimate.error_advice.model != "with-misfit"
    for path in TRUTH:
        found = estimate.parameters[path]
        assert found.errors["with-misfit"].standard_error > 0.8 * found.standard_error


def test_report_plot_predictions_and_error_models_have_the_same_residuals(studies, tmp_path, monkeypatch):
    taken, share = [], Coloured.share
    monkeypatch.setattr(Coloured, "share", lambda self, record: taken.append(record) or share(self, record))
    estimate = pdssjax.identify(studies[0])
    (record,) = estimate.records
    assert record.outliers.size >= 30 and np.max(np.abs(record.undisturbed - record.predicted)) > 3.0 * NOISE
    np.testing.assert_allclose(record.noise * taken[0].residual, record.residual, atol=1e-5 * NOISE)
    np.testing.assert_array_equal(np.flatnonzero(taken[0].outlying), record.outliers)
    write_estimate(estimate, tmp_path)
    (written,) = (tmp_path / "predictions").iterdir()
    assert record.largest_error == np.max(np.abs(record.residual))
    np.testing.assert_allclose(
        np.genfromtxt(written, delimiter=",", skip_header=1)[:, 3], 1e6 * record.residual, atol=1e-6
    )
    drawn = residual_split_figure(record).axes[0].lines[0].get_ydata()
    np.testing.assert_allclose(drawn, 1e6 * record.residual)


def test_a_linear_step_that_leads_astray_changes_no_prediction(studies, monkeypatch):
    """Without the samples that stand out the step is that of the linear model, which may hold no longer there."""

    def far(problem, fit):
        found = nearby(problem, fit)
        return found._replace(step=-30.0 * found.step)

    nearby = evidence.fit_without_outliers
    monkeypatch.setattr(evidence, "fit_without_outliers", far)
    (record,) = pdssjax.identify(studies[0]).records
    assert record.outliers.size >= 30
    # The zero alone is that of the other samples.
    assert np.nanstd(record.rest - record.residual_without_outliers) < 1e-9 * NOISE


def test_glitches_beside_a_misfit_do_not_hide_it(studies):
    record = studies[0].records[0]
    wrong = record.measured + 5.0 * NOISE * np.sin(2e3 * record.time)
    study = dataclasses.replace(studies[0], records=(dataclasses.replace(record, measured=wrong, noise=NOISE),))
    estimate = pdssjax.identify(study)
    assert estimate.converged and not estimate.explained
    (note,) = [note for note in estimate.notes if "does not explain all" in note]
    assert f"({estimate.records[0].rest_chi2:.3g}; by chance" in note and estimate.records[0].rest_chi2 < 40.0
    assert estimate.error_advice.model == "with-misfit"


def test_without_glitches_a_robust_fit_costs_a_fortieth_of_the_error(studies):
    plain, robust = (pdssjax.identify(studies[1], loss=loss) for loss in ("squares", "huber"))
    for path in TRUTH:
        errors = [e.parameters[path].standard_error for e in (plain, robust)]
        # The sandwich takes its scatter from the hundred samples that ring: 7 % of chance.
        assert errors[1] == pytest.approx(errors[0] / np.sqrt(0.95), rel=0.2)
        assert abs(robust.parameters[path].value - plain.parameters[path].value) < 0.8 * errors[0]


def test_the_command_says_the_loss_and_refuses_what_does_not_go_with_it(undrawn, tmp_path, capsys, studies):
    study = write(tmp_path, 40)
    assert main(["identify", str(study), "--loss", "huber", "--out", str(tmp_path / "out")]) == 0
    assert "joint fit with Huber's loss converged" in capsys.readouterr().out
    assert json.loads((tmp_path / "out" / "estimate.json").read_text())["loss"] == "huber"
    with pytest.raises(InputError, match='loss: found "hubert"'):
        pdssjax.identify(studies[0], loss="hubert")
    with pytest.raises(InputError, match='intervals "profile"'):
        pdssjax.identify(studies[0], loss="huber", intervals="profile")


def test_noise_given_wrongly_moves_no_error_under_a_robust_loss_and_no_note_says_so(studies):
    """It scales the loss, and that hardly: a zero has the error by the scatter of its residuals, as parameters do."""
    given = lambda noise: dataclasses.replace(
        studies[1], records=(dataclasses.replace(studies[1].records[0], noise=noise),)
    )
    right, small, large = (pdssjax.identify(given(noise), loss="huber") for noise in (NOISE, NOISE / 4, 4 * NOISE))
    for found in (small, large):
        ratio = found.records[0].offset_standard_error / right.records[0].offset_standard_error
        assert ratio == pytest.approx(1.0, abs=0.1)
        ratio = found.parameters["piezo.gain"].standard_error / right.parameters["piezo.gain"].standard_error
        assert ratio == pytest.approx(1.0, abs=0.1)
        assert not any("errors are enlarged" in note or "larger than they need be" in note for note in found.notes)
    (note,) = [note for note in small.notes if "too small" in note]
    assert "Standard errors do not depend on the noise given" in note
