"""A virtual rig writes records as a rig would; what was identified from them can be used again."""

import json

import numpy as np
import pytest

import pdssjax
from pdssjax import InputError
from pdssjax.cli.main import main
from pdssjax.files import with_estimate
from pdssjax.study import make_recordings

pytestmark = pytest.mark.usefixtures("undrawn")
STUDY = """
format = "pdssjax-study/1"
title = "Planned"
[actuator]
piezo = "second-order"
friction = "simplified-lugre"
[parameters]
"piezo.gain" = { start = "0.1 um/V" }
"piezo.natural_frequency" = { start = "6700 rad/s" }
"piezo.damping_ratio" = { start = 0.18 }
"friction.sigma0" = { start = "1 N/um" }
"friction.sigma1" = { value = "45 N s/m" }
"friction.f_ss" = { start = "0.65 N" }
[[record]]
name = "step"
file = "data/step.csv"
columns = { time = "time_ms", displacement = "y_um" }
measures = "platform"
noise = "0.02 um"
resolution = "0.01 um"
sampling = { start = "-1 ms", end = "30 ms", interval = "50 us" }
drive = { waveform = "step", voltage = "60 V" }
[[record]]
name = "loops"
file = "loops.csv"
columns = { time = "time_s", motion = "d_um", force = "f" }
units = { force = "mN" }
measures = "friction"
noise = "5 mN"
offset = "20 mN"
sampling = { end = "2 s", interval = "5 ms", amplitude = "3 um", frequency = "1 Hz" }
"""


def planned(folder, text=STUDY):
    (folder / "study.toml").write_text(text)
    return folder / "study.toml"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rig")
    assert main(["record", str(planned(folder)), "--out", str(folder / "out"), "--seed", "3"]) == 0
    return folder / "out" / "records"


def test_the_records_can_be_read_back(made):
    step, loops = pdssjax.load_study(made / "study.toml").records
    assert step.time.size == 621 and step.time[0] == pytest.approx(-1e-3)
    counts = step.measured / 1e-8
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
    assert loops.motion is not None and np.abs(loops.motion).max() == pytest.approx(3e-6, rel=1e-3)


def test_what_went_in_is_kept_beside_the_records(made):
    truth = json.loads((made / "truth.json").read_text())
    assert truth["seed"] == 3 and truth["parameters"]["piezo.gain"] == {"value": 1e-7, "unit": "m/V"}
    assert truth["records"][1]["offset"] == pytest.approx(0.02)


def test_noise_and_zero_are_those_asked_for(made):
    study, truth = pdssjax.load_study(made / "study.toml"), json.loads((made / "truth.json").read_text())
    for record, motion, told in zip(study.records, study.predict({}), truth["records"], strict=True):
        left = record.measured - np.asarray(motion) - told["offset"]
        assert abs(left.mean()) < 4 * told["noise"] / np.sqrt(left.size)
        assert left.std() == pytest.approx(np.hypot(told["noise"], told["resolution"] / np.sqrt(12)), rel=0.1)


def test_a_seed_makes_the_same_records_again_and_another_seed_others(tmp_path):
    study = pdssjax.load_study(planned(tmp_path), virtual=True)
    first, again, other = (make_recordings(study, seed)[0].record.measured for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert (first != other).mean() > 0.5


def test_all_kinds_of_records_are_identified_together_and_the_estimate_is_used_again(made, tmp_path, capsys):
    assert main(["identify", str(made / "study.toml"), "--out", str(tmp_path / "found")]) == 0
    assert "forces in N" in capsys.readouterr().out
    file = tmp_path / "found" / "estimate.json"
    parameters = json.loads(file.read_text())["parameters"]
    for path, true in {"piezo.gain": 1e-7, "friction.sigma0": 1e6, "friction.f_ss": 0.65}.items():
        assert abs(parameters[path]["value"] - true) < 4.0 * parameters[path]["standard_error"]
    study = with_estimate(pdssjax.load_study(made / "study.toml"), file)
    assert study.parameters["friction.f_ss"].value == parameters["friction.f_ss"]["value"]
    out = str(tmp_path / "predicted")
    assert main(["simulate", str(made / "study.toml"), "--estimate", str(file), "--out", out]) == 0


@pytest.mark.parametrize(
    ("old", "new", "essentials"),
    [
        ('interval = "50 us"', 'interval = "1 s"', ["interval", "found 1 s", "fits in between"]),
        ('interval = "50 us"', 'intervall = "50 us"', ["intervall", "interval"]),
        ('amplitude = "3 um", ', "", ["amplitude", "missing"]),
        ('{ start = "0.65 N" }', "{}", ["no number for friction.f_ss;", "--estimate", "initial_guess"]),
        ('"data/step.csv"', '"../step.csv"', ["step", "expected a file beside it"]),
        ('"y_um"', '"y"', ['record "step": column "y"', "found no unit, expected a unit that converts to m"]),
        ('"time_ms"', '"time_um"', ['record "step": column "time_um"', 'found the unit "um"']),
        ('resolution = "0.01 um"', 'resolution = "0 um"', ["resolution", "above 0"]),
    ],
)
def test_a_plan_at_fault_is_refused_before_anything_is_simulated(tmp_path, capsys, monkeypatch, old, new, essentials):
    assert old in STUDY
    monkeypatch.setattr("pdssjax.study.make_recordings", lambda *given: pytest.fail("simulated"))
    assert main(["record", str(planned(tmp_path, STUDY.replace(old, new))), "--out", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().err
    assert all(essential in told for essential in [str(tmp_path / "study.toml"), *essentials])
    assert not (tmp_path / "out" / "records").exists()


def test_a_record_that_is_not_made_yet_is_named_with_the_command_that_makes_it(tmp_path, capsys):
    assert main(["simulate", str(planned(tmp_path)), "--out", str(tmp_path / "out")]) == 2
    assert "there is no such file, expected the record that `pdssjax record STUDY` makes" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("content", "essential"),
    [
        (None, "there is no such file"),
        ("{", "line 1, column 2"),
        ("{}", 'expected "pdssjax-estimate/1"'),
        ('{"format": "pdssjax-estimate/1", "parameters": {"piezo.gin": {"value": 1.0}}}', "piezo.gain"),
    ],
)
def test_an_estimate_at_fault_is_refused(tmp_path, content, essential):
    study = pdssjax.load_study(planned(tmp_path), virtual=True)
    file = tmp_path / "estimate.json"
    if content is not None:
        file.write_text(content)
    with pytest.raises(InputError) as refused:
        with_estimate(study, file)
    assert str(file) in str(refused.value) and essential in str(refused.value)
