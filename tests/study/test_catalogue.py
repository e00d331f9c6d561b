"""What can be chosen is told by the members themselves, and nothing is left untold."""

import pytest

from pdssjax.cli import main as cli
from pdssjax.core import members
from pdssjax.study import catalogue_entries, entry_summaries, find_entry
from pdssjax.study.catalogue import FAMILIES, PARTS

ENTRIES = {entry.name: entry for entry in catalogue_entries()}


def test_every_member_and_part_has_an_entry():
    named = {f"{said}/{name}" for said, family in FAMILIES.items() for name in members(family)}
    assert set(ENTRIES) == named | set(PARTS)


def test_the_list_that_loads_nothing_says_the_same():
    assert entry_summaries() == {name: entry.summary for name, entry in ENTRIES.items()}


@pytest.mark.parametrize("name", ENTRIES)
def test_every_entry_says_what_it_is_and_what_its_parameters_are(name):
    entry = ENTRIES[name]
    assert len(entry.summary) > 20
    assert all(len(told) > 5 for _, told in entry.parameters.values())


@pytest.mark.parametrize("name", [name for name in ENTRIES if name.startswith(("piezo/", "friction/"))])
def test_every_model_cites_its_equation_or_its_paper(name):
    assert any(mark in ENTRIES[name].text for mark in ("(1.", "(4.", "(5.", "IEEE", "ASME", "19", "20"))


def test_an_entry_is_found_with_and_without_its_family():
    assert find_entry("friction/dahl") == find_entry("dahl")


def test_a_part_goes_before_a_member_of_the_same_name():
    assert find_entry("effector").name == "effector"
    assert find_entry("measurement/effector").name == "measurement/effector"


def test_the_command_lists_all_and_explains_one(capsys):
    assert cli.main(["models"]) == 0
    listed = capsys.readouterr().out
    assert all(name in listed for name in ENTRIES)
    assert cli.main(["models", "elastoplastic"]) == 0
    told = capsys.readouterr().out
    assert "elastic_part" in told and "optional" in told and "5.11" in told


def test_an_unknown_name_is_answered_with_the_nearest(capsys):
    assert cli.main(["models", "lugr"]) == 2
    assert 'did you mean "lugre"?' in capsys.readouterr().err
