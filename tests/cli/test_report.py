"""`pdssjax report`: a folder of results becomes one page, over nothing unasked, and what is wrong is said in a line."""

import fabricated
import pytest
from matplotlib.figure import Figure

from pdssjax.cli.main import main
from pdssjax.files import write_essentials


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
    assert "a.txt: cannot be read" in capsys.readouterr().err
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
