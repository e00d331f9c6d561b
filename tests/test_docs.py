"""The documentation holds: its links lead somewhere, its commands and its study are read, its names exist.

`make docs` executes the tutorials; here they are only read.
"""

import csv
import json
import re
import shlex
import tomllib
from pathlib import Path

import pytest
from command_options import commands, rows
from python_objects import family_lines, markdown
from storeys import boxes
from study_keys import lines_of

import pdssjax
from pdssjax import Study
from pdssjax.cli.main import _parser
from pdssjax.core import members
from pdssjax.files import schema_text
from pdssjax.files.record_table import RECORD_KEYS
from pdssjax.study.catalogue import FAMILIES

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
HEADINGS = {"drive": "drives", "piezo": "piezo and platform", "friction": "friction"}
"""Of the lists in docs/study-file.md, by what a study chooses."""


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


def test_links_lead_to_files_and_headings():
    for page in PAGES:
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
    (page.name, re.split(" [#>]", line)[0].removeprefix("pdssjax").strip())
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
    assert {"format", "title", "actuator", "parameters", "constraints", "record", "design"} >= set(table)


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


@pytest.mark.parametrize(("said", "family"), FAMILIES.items())
def test_what_a_study_may_name_is_on_the_page_of_models_and_the_study_page_names_nothing_else(said, family):
    """The page of models is made of the members, so that a new one needs no edit; the other tells of some."""
    assert f"{{family}} {family}\n" in (ROOT / "docs/reference/models.md").read_text(encoding="utf-8")
    page = (ROOT / "docs/study-file.md").read_text(encoding="utf-8")
    if said == "measurement":
        named = re.findall(r'`"([\w-]+)"`', page.partition("| `measures` |")[2].partition("\n\n")[0])
    else:
        (line,) = re.findall(rf"^- \*\*{HEADINGS[said]}\*\*.*$", page, re.M)
        named = [name for name in re.findall(r"`([a-z-]+)`", line) if name not in ("waveform", "piezo", "friction")]
    assert named and set(named) <= set(members(family))


@pytest.mark.parametrize("target", ["demo", "test", "docs"])
def test_the_readme_names_the_targets_of_the_makefile(target):
    assert f"make {target}" in (ROOT / "README.md").read_text(encoding="utf-8")
    assert f"\n{target}:" in (ROOT / "Makefile").read_text(encoding="utf-8")


def test_files_that_are_named_exist():
    for page in PAGES:
        named = re.findall(r"`([\w/]+\.(?:py|md))`", page.read_text(encoding="utf-8"))
        for path in [path for path in named if "NAME" not in path]:  # which stands for a name of your choice
            places = [ROOT / path, ROOT / "pdssjax" / path, *(ROOT / "pdssjax").rglob(Path(path).name)]
            assert any(place.is_file() for place in places[: 2 if "/" in path else None]), f"{page.name} names {path}"


NOTEBOOKS = sorted((ROOT / "docs/tutorials").glob("*.md"))
REFERENCE = "".join(page.read_text(encoding="utf-8") for page in sorted((ROOT / "docs/reference").glob("*.md")))


def cells(page: Path) -> list[str]:
    """The code of a tutorial, without its options and without what a shell is asked."""
    found = blocks(page, r"\{code-cell\} ipython3")
    return [re.sub(r"^(:\w.*|!.*|%%.*)$", "", cell, flags=re.M) for cell in found]


@pytest.mark.parametrize("page", NOTEBOOKS, ids=lambda page: page.stem)
def test_tutorials_compile_and_import_what_is_there(page):
    assert cells(page)
    for cell in cells(page):
        compile(cell, page.name, "exec")
        for line in re.findall(r"^from pdssjax[\w.]* import [\w, ]+$", cell, re.M):
            exec(line, {})
        for name in re.findall(r"(?<![\w.])pdssjax\.(\w+)\(", cell):
            assert name in pdssjax.__all__


@pytest.mark.parametrize("page", NOTEBOOKS, ids=lambda page: page.stem)
def test_commands_in_tutorials_are_read(page):
    for line in re.findall(r"^!(pdssjax .+?)(?: [12&]*>.*)?$", page.read_text(encoding="utf-8"), re.M):
        _parser().parse_args(shlex.split(line)[1:])


@pytest.mark.parametrize("command", commands())
def test_every_command_has_a_page_with_its_options(command):
    page = (ROOT / "docs/how-to" / f"{command}.md").read_text(encoding="utf-8")
    assert f"```{{command-options}} {command}\n" in page
    shown = "\n".join(rows(commands()[command]))
    for action in commands()[command]._actions:
        assert action.help and (action.dest == "help" or all(option in shown for option in action.option_strings))


def test_every_public_name_is_in_the_reference():
    for name in pdssjax.__all__:
        assert re.findall(rf"\{{python-object\}} (pdssjax\.{name})\n", REFERENCE) == [f"pdssjax.{name}"]
        assert f" pdssjax.{name}" in markdown(f"pdssjax.{name}")[0]


def test_what_the_reference_shows_is_there_with_its_docstring():
    for path in re.findall(r"\{python-object\} (\S+)", REFERENCE):
        assert len([line for line in markdown(path) if line]) > 2, path


@pytest.mark.parametrize("family", re.findall(r"\{family\} (\S+)", REFERENCE))
def test_every_member_of_a_family_is_in_the_reference(family):
    shown = "\n".join(family_lines(family))
    assert shown.count("{py:class}") == len(members(family))


def keys(schema: dict) -> set[str]:
    """All keys that a JSON schema names."""
    named = set(schema.get("properties", {}))
    inner = [*schema.get("properties", {}).values(), schema.get("items"), *schema.get("oneOf", [])]
    return named.union(*(keys(part) for part in inner if isinstance(part, dict)))


def test_every_key_of_a_study_is_on_its_page():
    page = (ROOT / "docs/study-keys.md").read_text(encoding="utf-8")
    shown = "\n".join("\n".join(lines_of(part)) for part in re.findall(r"\{study-keys\} (\w+)", page))
    named = set(re.findall(r"`([^`]+)`", shown))
    schema = json.loads(schema_text())
    quantities = set(schema["properties"]["record"]["items"]["properties"]["units"]["properties"])
    assert keys(schema) - quantities - {"waveform"} <= named


@pytest.mark.parametrize("key", RECORD_KEYS)
def test_every_key_of_a_record_is_explained(key):
    assert re.search(rf"\b{key}\b", (ROOT / "docs/study-file.md").read_text(encoding="utf-8"))


def test_the_rooms_are_drawn_from_the_chart_of_github():
    (chart,) = blocks(ROOT / "docs/architecture.md", "mermaid")
    drawn = boxes(chart)
    assert all(room in drawn for room in ("simulation: hybrid systems", "cli: one file a command"))
    assert drawn.count("&rarr;") == chart.count("-->")


def test_what_the_architecture_names_exists():
    page = (ROOT / "docs/architecture.md").read_text(encoding="utf-8")
    files = {file.relative_to(ROOT / "pdssjax").as_posix(): file for file in (ROOT / "pdssjax").rglob("*.py")}
    for path in re.findall(r"`([\w/]+\.py)`", page):
        assert path in files or any(file.endswith(f"/{path}") for file in files) or (ROOT / path).exists(), path
    code = "\n".join(file.read_text(encoding="utf-8") for file in files.values())
    for name in re.findall(r"`(?:[A-Z]\w+\.)?(\w+)`", page.split("## Where is")[1]):
        assert re.search(rf"(def|class) {name}\b", code) or (ROOT / "pdssjax" / name).is_dir(), name


def test_claims_are_a_table_that_has_the_ten_of_the_page_and_names_tests_that_exist():
    with (ROOT / "docs/claims.csv").open(encoding="utf-8", newline="") as file:
        claims = list(csv.DictReader(file))
    assert all(set(row) == {"claim", "figure", "command"} and all(row.values()) for row in claims)
    commands_of_table = " ".join(row["command"] for row in claims)
    page = (ROOT / "docs/claims.md").read_text(encoding="utf-8")
    shown = re.findall(r"^\| .+ \| `([^|]+)` \|$", page, re.M)
    assert len(shown) == 10 and all(command in commands_of_table for command in shown)
    assert f"all {len(claims)} claims" in page
    assert all((ROOT / path).exists() for path in re.findall(r"\btests/[\w/.]+", commands_of_table))


def test_the_site_is_built_in_ci():
    assert "\nmake docs\n" in (ROOT / ".ci/run").read_text(encoding="utf-8")
