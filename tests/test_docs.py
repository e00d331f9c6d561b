"""The documentation holds: its links lead somewhere, its commands and its study are read, its names exist."""

import re
import shlex
import tomllib
from pathlib import Path

import pytest

import pdssjax
from pdssjax.cli.main import _parser
from pdssjax.study import catalogue_entries
from pdssjax.study.study import Study

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
EVERY_PAGE = pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))


def links(text: str) -> list[str]:
    """Targets of links and pictures, but those to the web."""
    found = re.findall(r"\]\(([^)\s]+)\)", text) + re.findall(r'src="([^"]+)"', text)
    return [target for target in found if "://" not in target]


def anchors(page: Path) -> set[str]:
    """The anchors of the headings of a page, as GitHub makes them."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def blocks(page: Path, language: str) -> list[str]:
    """The code of a page in a language."""
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(encoding="utf-8"), re.M | re.S)


def shortly(part: str) -> str:
    """A name for a test: the page's, or the first line of its code."""
    return part.splitlines()[0]


@EVERY_PAGE
def test_links_lead_to_files_and_headings(page):
    for target in links(page.read_text(encoding="utf-8")):
        place, _, anchor = target.partition("#")
        file = (page.parent / place).resolve() if place else page
        assert file.exists(), f"{page.name} links to {target}"
        assert not anchor or anchor in anchors(file), f"{page.name} links to {target}"


def test_every_page_is_reached_from_the_readme():
    reached, left = set(), [ROOT / "README.md"]
    while left:
        page = left.pop()
        if page not in reached:
            reached.add(page)
            targets = (target.partition("#")[0] for target in links(page.read_text(encoding="utf-8")))
            left += [(page.parent / target).resolve() for target in targets if target.endswith(".md")]
    assert set(PAGES) <= reached


COMMANDS = [
    (page.name, line.partition("#")[0].removeprefix("pdssjax").strip())
    for page in PAGES
    for block in blocks(page, "sh")
    for line in block.replace("\\\n", " ").splitlines()
    if line.startswith("pdssjax ")
]


@pytest.mark.parametrize(("page", "command"), COMMANDS)
def test_commands_are_read(page, command):
    _parser().parse_args(shlex.split(command))


@pytest.mark.parametrize(
    ("page", "block"), [(page.name, block) for page in PAGES for block in blocks(page, "toml")], ids=shortly
)
def test_studies_are_toml_with_the_keys_that_are_read(page, block):
    table = tomllib.loads(block)
    assert table["format"] == "pdssjax-study/1"
    assert {"format", "title", "actuator", "parameters", "record"} >= set(table)


@pytest.mark.parametrize(
    ("page", "block"), [(page.name, block) for page in PAGES for block in blocks(page, "python")], ids=shortly
)
def test_code_compiles_and_names_what_is_there(page, block):
    compile(block, page, "exec")
    for name in re.findall(r"pdssjax\.(\w+)\(", block):
        assert name in pdssjax.__all__
    for name in re.findall(r"\bstudy\.(\w+)\(", block):
        assert hasattr(Study, name)
    for module, names in re.findall(r"^from (pdssjax[\w.]*) import (.+)$", block, re.M):
        exec(f"from {module} import {names}", {})


@pytest.mark.parametrize("name", [entry.name for entry in catalogue_entries() if "/" in entry.name])
def test_what_a_study_may_name_stands_on_its_page(name):
    """What `pdssjax models` lists stands in docs/study-file.md, as a study writes it."""
    family, _, member = name.partition("/")
    written = f'`"{member}"`' if family == "measurement" else f"`{member}`"
    assert written in (ROOT / "docs/study-file.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("target", ["demo", "test"])
def test_the_readme_names_the_targets_of_the_makefile(target):
    assert f"make {target}" in (ROOT / "README.md").read_text(encoding="utf-8")
    assert f"\n{target}:" in (ROOT / "Makefile").read_text(encoding="utf-8")


@EVERY_PAGE
def test_files_that_are_named_exist(page):
    named = re.findall(r"`([\w/]+\.(?:py|md))`", page.read_text(encoding="utf-8"))
    for path in [path for path in named if "NAME" not in path]:  # which stands for a name of your choice
        places = [ROOT / path, ROOT / "pdssjax" / path, *(ROOT / "pdssjax").rglob(Path(path).name)]
        assert any(place.is_file() for place in places[: 2 if "/" in path else None]), f"{page.name} names {path}"
