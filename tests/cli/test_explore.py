"""The commands `explore` and `report`: what they refuse, and what they write."""

import importlib.util
import re

import fabricated
import platform_study
import pytest
from matplotlib.figure import Figure
from walking_study import write_made_estimate, write_walking

from pdssjax import load_study
from pdssjax.cli import main as cli
from pdssjax.cli.main import main
from pdssjax.explore import Workbench
from pdssjax.files import write_essentials


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
    saved = load_study(benches[0].save(benches[0].initial, tmp_path / "saved.toml", False))
    assert saved.values() == numbers
    assert saved.parameters["piezo.gain"].free and not saved.parameters["effector.mass"].free


def test_guessed_numbers_are_saved_before_any_is_turned(tmp_path, benches):
    study = platform_study.write_platform(tmp_path)
    assert cli.main(["explore", str(study), "--guess", "--no-browser"]) == 0
    saved = load_study(benches[0].save(benches[0].initial, tmp_path / "saved.toml", False))
    assert saved.values() == dict(benches[0].initial.values)


@pytest.fixture
def folder(tmp_path):
    write_essentials(fabricated.estimate(), tmp_path / "results")
    return tmp_path / "results"


def test_the_page_lies_in_the_folder_unless_told_otherwise(folder, tmp_path, capsys):
    assert main(["report", str(folder)]) == 0
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "<h1>Rig, July</h1>" in page and "friction.sigma0_a" in page
    assert str(folder / "report.html") in capsys.readouterr().out
    assert main(["report", str(folder)]) == 2
    assert "report.html: found a file there already; expected another --out, or --overwrite." in capsys.readouterr().err
    assert main(["report", str(folder), "--overwrite"]) == 0
    assert main(["report", str(folder), "--out", str(tmp_path / "pages" / "rig.html")]) == 0
    assert (tmp_path / "pages" / "rig.html").exists()


@pytest.mark.parametrize(
    ("name", "said"),
    [("missing", "found nothing there, expected a folder"), ("file", "found a file, expected a folder"),
     ("empty", "found no estimate.json, no text and no picture")],
)  # fmt: skip
def test_where_there_are_no_results_it_says_so(tmp_path, capsys, name, said):
    (tmp_path / "file").write_text("x")
    (tmp_path / "empty").mkdir()
    assert main(["report", str(tmp_path / name)]) == 2
    assert said in capsys.readouterr().err
    assert not list((tmp_path / "empty").iterdir())


def test_where_it_cannot_be_written_it_says_so(folder, tmp_path, capsys):
    (tmp_path / "file").write_text("x")
    assert main(["report", str(folder), "--out", str(tmp_path / "file" / "page.html")]) == 4
    assert "page.html: cannot be written to" in capsys.readouterr().err


def test_texts_and_pictures_of_other_results_are_shown_as_they_are(tmp_path, capsys):
    (tmp_path / "plots").mkdir()
    figure = Figure(figsize=(2.0, 1.0))
    for name in ("comparison.png", "plots/walk.png"):
        figure.savefig(tmp_path / name)
    (tmp_path / "comparison.txt").write_text("[[Laws]]\n    Dahl <b>  3\n", encoding="utf-8")
    (tmp_path / "comparison.json").write_text('{"title": "Which <law>"}', encoding="utf-8")
    (tmp_path / "broken.json").write_text("{", encoding="utf-8")
    assert main(["report", str(tmp_path)]) == 0
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "<h1>Which &lt;law&gt;</h1>" in page and "    Dahl &lt;b&gt;  3" in page
    assert page.count("data:image/png;base64") == 2 and 'viewBox="0 0 200 100"' in page


def test_a_picture_that_is_none_and_a_text_of_other_letters_are_refused(tmp_path, capsys):
    (tmp_path / "a.png").write_text("no picture")
    assert main(["report", str(tmp_path)]) == 2
    assert "found 10 bytes that are no PNG picture" in capsys.readouterr().err
    (tmp_path / "a.txt").write_bytes(b"\xff\xfe\x00")
    assert main(["report", str(tmp_path)]) == 2
    assert "a.txt: found invalid start byte at byte 0, expected UTF-8 text." in capsys.readouterr().err
    assert not (tmp_path / "report.html").exists()


def test_pictures_beyond_what_can_be_mailed_are_named(tmp_path, monkeypatch):
    from pdssjax.files import estimate_folder

    Figure().savefig(tmp_path / "large.png")
    monkeypatch.setattr(estimate_folder, "_MOST_BYTES", 10)
    assert main(["report", str(tmp_path)]) == 0
    assert "too large to send: large.png." in (tmp_path / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["comparison.html", "plan.html"])
def test_a_page_that_a_command_wrote_itself_is_taken(tmp_path, capsys, name):
    (tmp_path / name).write_text("its page", encoding="utf-8")
    (tmp_path / "comparison.txt").write_text("its text", encoding="utf-8")
    assert main(["report", str(tmp_path)]) == 0
    assert f"The page is in {tmp_path / name}" in capsys.readouterr().out
    assert main(["report", str(tmp_path), "--out", str(tmp_path / "sent" / "page.html")]) == 0
    assert (tmp_path / "sent" / "page.html").read_text(encoding="utf-8") == "its page"
    assert main(["report", str(tmp_path), "--out", str(tmp_path / "sent" / "page.html")]) == 2
