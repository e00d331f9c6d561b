"""Nothing is filled in silently: a number that is missing is asked for by name, and what was used is told."""

import dataclasses
import json
import warnings

import numpy as np
import pytest
from platform_study import PLATFORM, write_platform
from study_files import write_estimate, write_study

import pdssjax
from pdssjax import InputError, InputWarning
from pdssjax.cli.main import main
from pdssjax.core import member
from pdssjax.files import EXAMPLE, with_estimate
from pdssjax.inference.initial_values import search
from pdssjax.study import numbers_used
from pdssjax.sweeps import sweeping

pytestmark = pytest.mark.usefixtures("undrawn")
ASKED = ["piezo.natural_frequency", "friction.sigma0", "friction.sigma1", "friction.f_ss"]
"""What the study of `study_files` gives no number."""
REMEDIES = ["--estimate", "--guess", "pdssjax.initial_guess(study)", "{ start = ... }"]


@pytest.fixture(scope="module")
def platform(tmp_path_factory):
    """The file of a study whose piezo and sigma0 have no numbers."""
    return write_platform(tmp_path_factory.mktemp("platform"))


@pytest.fixture(scope="module")
def estimate(platform):
    return pdssjax.identify(pdssjax.load_study(platform))


def test_predict_asks_for_what_is_missing_by_name(tmp_path):
    study = pdssjax.load_study(write_study(tmp_path))
    with pytest.raises(InputError) as refused:
        study.predict()
    assert f"found no number for {', '.join(ASKED)};" in str(refused.value)
    assert all(remedy in str(refused.value) for remedy in REMEDIES)
    with pytest.raises(InputError, match=r"found no number for friction\.f_ss;"):
        study.predict(dict.fromkeys(ASKED[:-1], 1.0))


@pytest.mark.parametrize(("command", "more"), [("simulate", []), ("record", []), ("sweep", ["--voltage", "20:80:3"])])
def test_a_command_that_lacks_numbers_says_which_and_does_nothing(tmp_path, capsys, command, more):
    study = write_study(tmp_path)
    assert main([command, str(study), *more, "--out", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and str(study) in told
    assert all(essential in told for essential in [*ASKED, *REMEDIES])
    assert not (tmp_path / "out").exists()


def test_a_study_is_not_searched_for_numbers(platform, monkeypatch):
    monkeypatch.setattr(search, "guess_starts", lambda *given: pytest.fail("searched unasked"))
    study = pdssjax.load_study(platform)
    with pytest.raises(InputError, match="found no number"):
        study.values()
    assert study.missing() == ["piezo.gain", "piezo.natural_frequency", "piezo.damping_ratio", "friction.sigma0"]


def test_initial_guess_gives_every_number_and_keeps_those_of_the_study(platform):
    study = pdssjax.load_study(platform)
    guess = pdssjax.initial_guess(study)
    assert list(guess) == list(study.parameters)
    assert guess["friction.sigma1"] == 45.0 and guess["piezo.gain"] == pytest.approx(1.1e-7, rel=0.05)
    assert all(np.isfinite(motion).all() for motion in study.predict(guess))


def test_predict_takes_an_estimate(platform, estimate):
    study = pdssjax.load_study(platform)
    numbers = {path: parameter.value for path, parameter in estimate.parameters.items()}
    (motion,), (again,) = study.predict(estimate), study.predict(numbers)
    np.testing.assert_array_equal(motion, again)
    np.testing.assert_allclose(motion + estimate.records[0].offset, estimate.records[0].predicted, rtol=0, atol=1e-15)


def test_an_estimate_of_another_study_is_refused(tmp_path, estimate):
    text = PLATFORM.replace('"second-order"', '"static"')
    for path in ("natural_frequency", "damping_ratio"):
        text = text.replace(f'"piezo.{path}" = {{}}\n', "")
    study = pdssjax.load_study(write_platform(tmp_path, text))
    for take in (study.predict, study.with_values, study.with_starts):
        with pytest.raises(InputError, match=r'found an estimate with piezo = "second-order", expected.* "static"'):
            take(estimate)
    older = dataclasses.replace(estimate, actuator={})
    with pytest.raises(InputError, match=r'unknown parameter "piezo\.natural_frequency"'):
        study.predict(older)


def test_a_reading_and_a_feedback_are_the_estimate_s_own(estimate):
    assert estimate.actuator == {
        "piezo": "second-order",
        "friction": "simplified-lugre",
        "friction_state": "deflection",
        "feedback": False,
    }
    study = pdssjax.load_study(EXAMPLE / "study.toml")
    study.models.check_same(study.models.chosen, "here")
    study.models.check_same({}, "here")  # of a file of an older version
    told = study.models.chosen | {"friction_state": "force", "feedback": True}
    expected = (
        r'here: found an estimate with friction_state = "force", feedback = true, '
        r'expected one with friction_state = "deflection", feedback = false'
    )
    with pytest.raises(InputError, match=expected):
        study.models.check_same(told, "here")
    # A law without a reading has none that could differ.
    simple = dataclasses.replace(study, friction=member("friction", "simplified-lugre")).models
    simple.check_same(simple.chosen | {"friction_state": "force"}, "here")


def test_simulate_prints_and_keeps_the_numbers_used_and_where_they_come_from(tmp_path, platform, estimate, capsys):
    kept = {path: estimate.parameters[path].value for path in ("piezo.gain", "piezo.damping_ratio")}
    file = write_estimate(tmp_path, kept)
    text = PLATFORM.replace('"friction.sigma0" = {}', '"friction.sigma0" = { start = "2 N/um" }')
    study = write_platform(tmp_path, text)
    out = tmp_path / "out"
    assert main(["simulate", str(study), "--estimate", str(file), "--guess", "--out", str(out)]) == 0
    document = json.loads((out / "parameters.json").read_text())
    assert document["format"] == "pdssjax-parameters/1"
    used = document["parameters"]
    assert used["piezo.gain"] == {"value": kept["piezo.gain"], "unit": "m/V", "source": f"estimate {file}"}
    assert used["piezo.natural_frequency"]["source"] == "guess from the records"
    assert used["friction.sigma0"] == {"value": 2e6, "unit": "N/m", "source": "start in the study"}
    assert used["friction.sigma1"] == {"value": 45.0, "unit": "N s/m", "source": "value in the study"}
    rows = [line.split() for line in capsys.readouterr().out.splitlines() if line]
    assert ["[[Parameters", "used]]"] in rows
    assert ["friction.sigma0", "N/um", "2", "start", "in", "the", "study"] in rows


def test_a_guess_needs_records_that_have_been_made(tmp_path, capsys):
    planned = 'sampling = { end = "30 ms", interval = "50 us" }\ndrive'
    study = write_platform(tmp_path, PLATFORM.replace("drive", planned))
    assert main(["record", str(study), "--guess", "--out", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().err
    assert "no number for piezo.gain, piezo.natural_frequency" in told and "still to be made" in told


def test_record_keeps_the_numbers_used(tmp_path, capsys):
    text = PLATFORM.replace("= {}", "= { start = 0.2 }")
    planned = 'sampling = { end = "30 ms", interval = "50 us" }\ndrive'
    study = write_platform(tmp_path, text.replace("drive", planned))
    assert main(["record", str(study), "--out", str(tmp_path / "out")]) == 0
    used = json.loads((tmp_path / "out" / "parameters.json").read_text())["parameters"]
    assert used["piezo.gain"] == {"value": 0.2, "unit": "m/V", "source": "start in the study"}
    assert "[[Parameters used]]" in capsys.readouterr().out


def test_a_sweep_asks_for_no_number_of_an_axis_and_tells_what_was_held(tmp_path, monkeypatch):
    study = pdssjax.load_study(write_study(tmp_path))
    held = study.with_values({"piezo.natural_frequency": 6700.0, "friction.sigma0": 1e6, "friction.sigma1": 45.0})
    ones = lambda function, document, plan, numbers, *rest: ((n, lambda: np.ones((plan.lanes, 6))) for n in numbers)
    monkeypatch.setattr(sweeping, "run_blocks", ones)
    with pytest.raises(InputError, match=r"found no number for friction\.f_ss;"):
        pdssjax.sweep(held, {})
    data = pdssjax.sweep(held, {"friction.f_ss": [0.5, 0.6]})
    told = json.loads(data.attrs["parameters"])
    assert "friction.f_ss" not in told
    assert told["friction.sigma0"] == {"value": 1e6, "unit": "N/m", "source": "given"}
    assert told["effector.mass"] == {"value": 0.086, "unit": "kg", "source": "value in the study"}
    # The study's own fall time, not the one that its drive would have without it.
    assert data.attrs["drive.fall_time"] == 1e-3 and data.attrs["drive.voltage"] == pytest.approx(64.2)


@pytest.mark.parametrize(
    ("flags", "said"),
    [({"explained": False}, "unexplained"), ({"converged": False, "explained": False}, "not converged"), ({}, "")],
)
def test_numbers_of_a_fit_that_does_not_explain_its_records_are_told_apart(tmp_path, platform, flags, said):
    """A fit that left 50 times the noise had been taken without a word."""
    file = write_estimate(tmp_path, {"piezo.gain": 1e-7}, **flags)
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        study = with_estimate(pdssjax.load_study(platform), file)
    texts = {"unexplained": "does not explain its records", "not converged": "did not converge"}
    assert [str(w.message).split("the fit ")[1][: len(texts[said])] for w in warned] == ([texts[said]] if said else [])
    assert all(w.category is InputWarning for w in warned)
    source = numbers_used(study, set(study.parameters) - {"piezo.gain"})["piezo.gain"]["source"]
    assert source == f"estimate {file}" + (f" ({said})" if said else "")


def test_starts_are_those_told_and_what_is_fixed_stays(platform):
    study = pdssjax.load_study(platform)
    apart = dataclasses.replace(study.parameters["piezo.damping_ratio"], start=0.2, standard_error=0.01)
    study = dataclasses.replace(study, parameters=study.parameters | {"piezo.damping_ratio": apart})
    told = {"piezo.gain": 2e-7, "friction.sigma1": 1.0, "piezo.damping_ratio": 0.3}
    begun = study.with_starts(told)
    assert begun.parameters["piezo.gain"].start == 2e-7 and begun.parameters["piezo.gain"].free
    assert begun.parameters["friction.sigma1"] == study.parameters["friction.sigma1"]
    assert begun.parameters["piezo.damping_ratio"] == apart
    assert begun.with_starts(dict.fromkeys(study.parameters)).parameters["piezo.gain"].start is None
    bounded = dataclasses.replace(study.parameters["piezo.gain"], high=1.5e-7)
    narrow = dataclasses.replace(study, parameters=study.parameters | {"piezo.gain": bounded})
    assert narrow.with_starts(told).parameters["piezo.gain"].start == 1.5e-7
    with pytest.raises(InputError, match=r'starts: "piezo\.gain": found -1 m/V, expected'):
        study.with_starts({"piezo.gain": -1.0})
    for path in ("piezo.gan", "amplifier.bandwidth", "stop.stiffness"):
        with pytest.raises(InputError, match=rf'starts: found "{path}", which the study does not list'):
            study.with_starts({path: 1.0})
