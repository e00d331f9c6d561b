"""A page holds what it was given, escaped; it loads nothing, and the same results give the same text."""

import html.parser
import json
import re

import numpy as np
import pytest
from matplotlib.figure import Figure

from pdssjax import InputError
from pdssjax.report.page import Illustration, Page, Section, Share, Table, page_html, table_html, write_page

HOSTILE = "<script>alert('x')</script> \"&\" --> <b>"


VOID = {"meta", "link", "br", "img", "hr", "input"}


class Elements(html.parser.HTMLParser):
    """All elements with their attributes, and the text outside of style and script; complains of what is not closed."""

    def __init__(self, text: str):
        super().__init__()
        self.found: list[tuple[str, dict]] = []
        self.open: list[str] = []
        self.text = ""
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if not {"style", "script"} & set(self.open):
            self.text += data

    def attributes(self, tag: str) -> list[dict]:
        return [attributes for name, attributes in self.found if name == tag]


def figure(samples: int = 50, marker: str = "") -> Figure:
    """A line, with its axes named."""
    made = Figure(figsize=(4.0, 3.0))
    axes = made.subplots()
    time = np.linspace(0.0, 2.0, samples)
    axes.plot(time, np.sin(40.0 * time), marker=marker)
    axes.set(xlim=(0.0, 2.0), ylim=(-1.0, 1.0), xlabel="time (s)", ylabel=f"displacement {HOSTILE}")
    return made


def page(*figures: Figure) -> Page:
    shown = [Illustration(each, "The motion.", "A sine") for each in figures]
    table = Table(["", "value"], [["gain", "0.1"], [HOSTILE, Share("3 %", 0.5)]], caption=HOSTILE)
    sections = [
        Section("Records", [HOSTILE], tables=[table], figures=shown),
        Section("Notes", points=[HOSTILE, "second"], folded=True),
        Section(HOSTILE, lines=["pdssjax identify a.toml", HOSTILE]),
    ]
    return Page(f"Rig {HOSTILE}", sections, subtitle=HOSTILE)


@pytest.fixture(scope="module")
def two_figures() -> str:
    return page_html(page(figure(), figure()))


def test_all_text_is_shown_as_text(two_figures):
    elements = Elements(two_figures)
    assert elements.text.count(HOSTILE) >= 8
    assert len(elements.attributes("script")) == 1
    assert not elements.attributes("b")
    (axes,) = json.loads(elements.attributes("svg")[0]["data-axes"])
    assert HOSTILE in axes["labels"][1]


def test_it_loads_nothing_and_forbids_what_it_does_not_hold(two_figures):
    elements = Elements(two_figures)
    addresses = ("href", "xlink:href", "src")
    links = [each[name] for _, each in elements.found for name in addresses if name in each]
    assert links and all(value.startswith(("#", "data:")) for value in links)
    assert not {tag for tag, _ in elements.found} & {"link", "img", "iframe", "object"}
    (policy,) = [each["content"] for each in elements.attributes("meta") if "http-equiv" in each]
    assert policy.startswith("default-src 'none'") and "script-src 'sha256-" in policy


def test_what_a_reader_with_a_screen_reader_needs_is_there(two_figures):
    elements = Elements(two_figures)
    assert elements.attributes("html") == [{"lang": "en"}]
    assert [each["aria-label"] for each in elements.attributes("svg")] == ["A sine", "A sine"]
    assert len(elements.attributes("h1")) == 1 and len(elements.attributes("h2")) == 3
    assert {each["scope"] for each in elements.attributes("th")} == {"row", "col"}
    targets = {each["href"][1:] for each in elements.attributes("a")}
    assert targets == {each["id"] for each in elements.attributes("section")}


def test_figures_share_no_identifier_and_the_same_page_gives_the_same_text(two_figures):
    identifiers = [each["id"] for _, each in Elements(two_figures).found if "id" in each]
    assert len(set(identifiers)) == len(identifiers) > 20
    used = set(re.findall(r'href="#([^"]+)"|url\(#([^)]+)\)', two_figures))
    assert {a or b for a, b in used} <= set(identifiers)
    assert page_html(page(figure(), figure())) == two_figures


def test_the_pointer_is_told_in_the_units_of_the_axes(two_figures):
    (axes,) = json.loads(Elements(two_figures).attributes("svg")[0]["data-axes"])
    assert axes["edges"] == [0.0, 2.0, -1.0, 1.0]
    assert axes["labels"][0] == "time (s)"
    left, top, right, bottom = axes["place"]
    assert 0.0 < left < right < 1.0 and 0.0 < top < bottom < 1.0


def test_axes_that_share_a_label_say_it_and_logarithmic_ones_say_nothing():
    made = Figure()
    upper, lower = made.subplots(2, 1, sharex=True)
    lower.set(xlabel="time (s)")
    (shown,) = Elements(page_html(Page("", [Section("", figures=[Illustration(made, "")])]))).attributes("svg")
    assert [each["labels"] for each in json.loads(shown["data-axes"])] == [["time (s)", "y"]] * 2
    upper.set_yscale("log")
    (shown,) = Elements(page_html(Page("", [Section("", figures=[Illustration(made, "")])]))).attributes("svg")
    assert len(json.loads(shown["data-axes"])) == 1


@pytest.mark.parametrize(("samples", "marker"), [(100_000, ""), (5_000, ".")])
def test_lines_of_many_samples_are_pictures_and_the_figure_stays_as_it_was(samples, marker):
    made = figure(samples, marker)
    text = page_html(page(made))
    assert 'href="data:image/png;base64,' in text
    assert len(text) < 500_000
    assert not made.axes[0].lines[0].get_rasterized()
    assert "data:image/png" not in page_html(page(figure(1_000)))


def test_bars_have_their_length_and_stay_in_their_cell():
    table = Table(["", "error"], [["a", Share("3 %", 0.25)], ["b", Share("-", np.nan)], ["c", Share("999 %", 7.0)]])
    shown = table_html(table)
    assert re.findall(r"width: ([\d.]+)%", shown) == ["25.0", "100.0"]


def test_rows_have_as_many_cells_as_the_head():
    with pytest.raises(ValueError):
        table_html(Table(["a", "b"], [["1"]]))


def test_a_page_is_written_whole_and_over_nothing_unasked(tmp_path):
    file = tmp_path / "page.html"
    write_page(file, page())
    assert file.read_text(encoding="utf-8") == page_html(page())
    (tmp_path / "plain").touch()
    assert file.stat().st_mode == (tmp_path / "plain").stat().st_mode
    with pytest.raises(InputError, match=r"page\.html: found a file there already; expected another name"):
        write_page(file, page())
    write_page(file, Page("another", []), overwrite=True)
    assert "another" in file.read_text(encoding="utf-8")
    with pytest.raises(InputError, match="found a folder, expected the name of an HTML file"):
        write_page(tmp_path, page())
    with pytest.raises(ValueError):
        write_page(file, Page("", [Section("", tables=[Table(["a"], [["1", "2"]])])]), overwrite=True)
    with pytest.raises(FileNotFoundError):
        write_page(tmp_path / "missing" / "page.html", page())
    assert {path.name for path in tmp_path.iterdir()} == {"page.html", "plain"}
    assert "another" in file.read_text(encoding="utf-8")


def test_a_name_of_any_letters_is_written(tmp_path):
    write_page(tmp_path / "page.html", Page("lone surrogate \udc80, Å", []))
    assert "Å" in (tmp_path / "page.html").read_text(encoding="utf-8")
