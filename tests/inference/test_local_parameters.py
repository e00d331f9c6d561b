"""Parameters that hold in some records only: a stack that two amplifiers drive, a fall time of each setting."""

import json

import fabricated
import numpy as np
import pytest
from record_tables import SHORT, STEP_HEAD, step_table, write_columns

import pdssjax
from pdssjax import InputError
from pdssjax.cli.main import main
from pdssjax.study import under_conditions

pytestmark = pytest.mark.usefixtures("undrawn")

GAIN, OTHER, RATE, DAMPING, NOISE = 1.1e-7, 1.3e-7, 6000.0, 0.2, 1e-8
TIME = np.arange(-0.005, 0.035, 5e-5)
STUDY = STEP_HEAD.replace('"piezo.gain" = {}\n', '"piezo.gain" = {}\n"piezo.gain@other" = {}\n')


def write(folder, text=STUDY, lines=("", 'conditions = ["other"]', 'conditions = ["other", "warm"]')):
    random = np.random.default_rng(3)
    for i, (line, gain) in enumerate(zip(lines, (GAIN, OTHER, OTHER), strict=False)):
        motion = fabricated.step_motion(TIME, 50.0 * gain, RATE, DAMPING) + random.normal(0.0, NOISE, TIME.size)
        write_columns(folder / f"r{i}.csv", "time_s,y_um", TIME, 1e6 * motion)
        text += "\n" + step_table('noise = "0.01 um"', line, name=f"r{i}", columns=SHORT)
    (folder / "study.toml").write_text(text)
    return folder / "study.toml"


def test_each_record_is_fitted_with_the_number_that_holds_in_it(tmp_path):
    study = pdssjax.load_study(write(tmp_path))
    estimate = pdssjax.identify(study)
    assert estimate.converged and not estimate.notes
    for path, truth in (("piezo.gain", GAIN), ("piezo.gain@other", OTHER), ("piezo.natural_frequency", RATE)):
        found = estimate.parameters[path]
        assert abs(found.value - truth) < 3.5 * found.standard_error, path
    # Two records tell the one, one the other; the rate that all share is known to the information of three.
    ratio = estimate.parameters["piezo.gain"].standard_error / estimate.parameters["piezo.gain@other"].standard_error
    assert ratio == pytest.approx(np.sqrt(2.0) * GAIN / GAIN, rel=0.05)
    i, j = (estimate.names.index(path) for path in ("piezo.gain", "piezo.gain@other"))
    assert abs(estimate.correlation[i, j]) < 0.2
    predicted = study.predict(estimate)
    assert np.ptp(predicted[1]) / np.ptp(predicted[0]) == pytest.approx(OTHER / GAIN, rel=1e-2)
    np.testing.assert_array_equal(predicted[1], predicted[2])


@pytest.mark.parametrize("is_local", [True, False])
def test_a_predicted_record_with_a_parameter_of_its_own_does_not_accuse_the_model(tmp_path, is_local):
    told = '"piezo.gain@other" = { value = "0.11 um/V", standard_error = "0.01 um/V" }\n' if is_local else ""
    path = write(
        tmp_path,
        STUDY.replace('"piezo.gain@other" = {}\n', told),
        ("", 'conditions = ["other"]\nrole = "validate"'),
    )
    (note,) = pdssjax.identify(pdssjax.load_study(path)).notes
    assert 'times the noise given in "r1"' in note
    assert ("knows, piezo.gain@other: these were not fitted" in note) == is_local
    assert ("does not carry over" in note) == (not is_local)


def test_an_estimate_is_read_again_with_its_conditions(tmp_path, capsys):
    study = write(tmp_path)
    assert main(["identify", str(study), "--out", str(tmp_path / "out")]) == 0
    assert "piezo.gain@other" in capsys.readouterr().out
    document = json.loads((tmp_path / "out" / "estimate.json").read_text())
    assert document["parameters"]["piezo.gain@other"]["value"] == pytest.approx(OTHER, rel=1e-2)
    again = pdssjax.load_study(study).with_values({p: e["value"] for p, e in document["parameters"].items()})
    assert np.ptp(again.predict()[1]) == pytest.approx(np.ptp(pdssjax.load_study(study).records[1].measured), rel=0.05)


def test_a_number_holds_where_its_condition_does_and_the_usual_one_elsewhere():
    values = {"a": 1.0, "a@wet": 2.0, "b": 3.0, "b@cold": 4.0}
    assert {k: float(v) for k, v in under_conditions(values, {}).items()} == {"a": 1.0, "b": 3.0}
    wet = under_conditions(values, {"wet": np.True_, "cold": np.False_})
    assert {k: float(v) for k, v in wet.items()} == {"a": 2.0, "b": 3.0}


@pytest.mark.parametrize(
    ("text", "lines", "message"),
    [
        (STUDY.replace("@other", "@othr"), ("", 'conditions = ["other"]'), '"othr" that no record has'),
        (STUDY, ("", ""), "no record has any"),
        (STUDY.replace('"piezo.gain" = {}\n', ""), ("", 'conditions = ["other"]'), '"piezo.gain" is missing'),
        (STUDY.replace("piezo.gain@", "piezo.gian@"), ("", 'conditions = ["other"]'), 'unknown parameter "piezo.gian"'),
        (STUDY, ("", "conditions = [3]"), "found 3, expected a list of names"),
        (STUDY, ("", 'conditions = "other"'), "expected a list of names"),
        (STUDY, ("", 'conditions = ["a@b"]'), "without @"),
        (
            STUDY + '"piezo.gain@warm" = {}\n',
            ("", 'conditions = ["other", "warm"]'),
            'record "r1" also has the condition "warm"',
        ),
    ],
)
def test_what_does_not_belong_together_is_refused(tmp_path, text, lines, message):
    with pytest.raises(InputError) as error:
        pdssjax.load_study(write(tmp_path, text, lines))
    assert message in str(error.value)
