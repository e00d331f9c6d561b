"""The command `explore`: what it refuses, before anything is compiled or served."""

import importlib.util
import re

import platform_study
import pytest
from walking_study import write_made_estimate, write_walking

from pdssjax import load_study
from pdssjax.cli import main as cli
from pdssjax.explore import Workbench


@pytest.fixture
def benches(monkeypatch):
    """Those that would be served; nothing is compiled for them."""
    served: list[Workbench] = []
    monkeypatch.setattr(Workbench, "warm", lambda bench: None)
    monkeypatch.setattr("pdssjax.explore.serve", lambda bench, *rest: served.append(bench) or True)
    return served


def test_without_panel_a_line_says_what_to_install(monkeypatch, tmp_path, capsys):
    found = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *rest: None if name == "panel" else found(name, *rest)
    )
    assert cli.main(["explore", str(tmp_path / "study.toml")]) == 2
    said = capsys.readouterr().err
    assert said == 'pdssjax: error: explore: found no panel, expected it installed: pip install "pdssjax[explore]"\n'


@pytest.mark.parametrize(("port", "expected"), [("99999", "at most 65535"), ("-1", "0 or more")])
def test_a_port_that_cannot_be_is_refused_before_any_file_is_read(tmp_path, capsys, port, expected):
    assert cli.main(["explore", str(tmp_path / "none.toml"), "--port", port]) == 2
    assert capsys.readouterr().err == f"pdssjax: error: option --port: found {port}, expected {expected}.\n"


def test_parameters_without_a_number_are_asked_for_by_name(tmp_path, capsys):
    study = platform_study.write_platform(tmp_path)
    assert cli.main(["explore", str(study), "--no-browser"]) == 2
    said = capsys.readouterr().err
    assert "found no number for piezo.gain, piezo.natural_frequency" in said
    assert "--guess" in said


def test_a_folder_without_a_sweep_is_refused(tmp_path, capsys):
    text = platform_study.PLATFORM.replace(" = {}", " = { start = 0.5 }")
    study = platform_study.write_platform(tmp_path, text)
    assert cli.main(["explore", str(study), "--no-browser", "--sweep", str(tmp_path)]) == 2
    assert "expected the results of pdssjax sweep" in capsys.readouterr().err


def test_the_numbers_of_an_estimate_are_saved_before_any_is_turned(tmp_path, benches):
    study = write_walking(tmp_path)
    estimate = write_made_estimate(study, tmp_path / "results")
    numbers = load_study(study).values()
    study.write_text(re.sub(r"start = [^,}]+,? ?", "", study.read_text()).replace('"86 g"', '"90 g"'))
    assert load_study(study).missing()
    assert cli.main(["explore", str(study), "--estimate", str(estimate), "--no-browser"]) == 0
    saved = load_study(benches[0].save(benches[0].begun, tmp_path / "saved.toml", False))
    assert saved.values() == numbers
    assert saved.parameters["piezo.gain"].free and not saved.parameters["effector.mass"].free


def test_guessed_numbers_are_saved_before_any_is_turned(tmp_path, benches):
    study = platform_study.write_platform(tmp_path)
    assert cli.main(["explore", str(study), "--guess", "--no-browser"]) == 0
    saved = load_study(benches[0].save(benches[0].begun, tmp_path / "saved.toml", False))
    assert saved.values() == dict(benches[0].begun.values)
