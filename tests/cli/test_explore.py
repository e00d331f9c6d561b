"""The command `explore`: what it refuses, before anything is compiled or served."""

import importlib.util

import platform_study

from pdssjax.cli import main as cli


def test_without_panel_a_line_says_what_to_install(monkeypatch, tmp_path, capsys):
    found = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *rest: None if name == "panel" else found(name, *rest)
    )
    assert cli.main(["explore", str(tmp_path / "study.toml")]) == 2
    said = capsys.readouterr().err
    assert said == 'pdssjax: error: explore: found no panel, expected it installed: pip install "pdssjax[explore]"\n'


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
