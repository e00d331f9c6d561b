"""What a study says of itself: its conditions, bounds of its fits, a record beside its prediction, the catalogue."""

import dataclasses
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import pdssjax
from pdssjax.cli import main as cli
from pdssjax.core import check_range, member, members, quantities
from pdssjax.files import EXAMPLE
from pdssjax.study import Parameter, catalogue_entries, compare, entry_summaries, find_entry, paths_in
from pdssjax.study.catalogue import FAMILIES, PARTS
from pdssjax.study.measurement.effector import Effector


def test_what_holds_under_a_condition_takes_the_place_of_the_usual_one():
    paths = ["piezo.gain", "piezo.gain@wet", "piezo.gain@hot", "friction.f_ss@hot"]
    assert paths_in(paths, []) == {"piezo.gain": "piezo.gain"}
    assert paths_in(paths, ["wet"]) == {"piezo.gain": "piezo.gain@wet"}
    assert paths_in(paths, {"hot", "dry"}) == {"piezo.gain": "piezo.gain@hot", "friction.f_ss": "friction.f_ss@hot"}


@pytest.mark.parametrize(("start", "number"), [(None, 1e-4), (3e-4, 3e-4)])
def test_a_study_as_it_is_in_a_record_has_no_conditions_left(start, number):
    study = pdssjax.load_study(EXAMPLE / "study.toml")
    record = next(record for record in study.records if record.measurement.effector_free)
    declared = study.legal()["drive.fall_time"]
    usual = Parameter("drive.fall_time", "s", declared, value=1e-4)
    late = Parameter("drive.fall_time@slow", "s", declared, start=start)
    study = dataclasses.replace(study, parameters=study.parameters | {usual.path: usual, late.path: late})
    assert study.for_record(record).parameters == study.for_record(record).for_record(record).parameters
    assert study.for_record(record).parameters["drive.fall_time"] == usual
    slow = dataclasses.replace(record, conditions=frozenset({"slow"}))
    found = study.for_record(slow).parameters
    assert list(found) == [path for path in study.parameters if path != late.path]
    assert found["drive.fall_time"].free and found["drive.fall_time"].number == number


DECLARED = {
    f"{family}/{name}.{field}": declared
    for family in ("drive", "friction", "piezo")
    for name in members(family)
    for field, declared in quantities(member(family, name)).items()
    if math.isfinite(declared.high)
}


@pytest.mark.parametrize("path", DECLARED)
@pytest.mark.parametrize("started", [False, True])
def test_a_fit_that_ends_at_its_upper_bound_can_be_predicted(path, started):
    declared = DECLARED[path]
    start = declared.nominal if started else None
    check_range(Parameter(path, declared.unit, declared).bounds(start)[1], declared, path)


RANDOM = np.random.default_rng(0)
TIME = np.arange(800) / 100.0
NOISE = 1e-8


def compared(residual):
    """Eight cycles of 1 Hz predicted but for this residual, in units of the noise."""
    motion = 1e-6 * np.abs(np.mod(TIME, 1.0) - 0.5)
    drive = SimpleNamespace(cycle_frequency=lambda: 1.0)
    record = SimpleNamespace(
        name="walk", file=Path("walk.csv"), excitation="", role="fit",
        measures="effector", measurement=Effector(), drive=drive, motion=None,
        time=TIME, measured=motion + NOISE * residual, noise=NOISE, offset=0.0,
    )  # fmt: skip
    return compare(record, motion, noise=NOISE, offset=0.0)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("glitches", [[], [333], [40, 333, 505, 777]])
def test_what_repeats_is_seen_beside_glitches(glitches):
    residual = RANDOM.normal(size=TIME.size) + 0.7 * np.sin(6.0 * np.pi * TIME)
    for place in glitches:
        residual[place : place + 3] += 100.0
    found = compared(residual)
    assert found.outliers.size == 3 * len(glitches)
    assert np.isnan(found.rest).sum() == 3 * len(glitches)
    assert found.lack_of_fit.sigmas > 4.0
    assert found.lack_of_fit.noise == pytest.approx(NOISE, rel=0.1)
    assert found.lack_of_fit.misfit == pytest.approx(0.7 * NOISE / np.sqrt(2.0), rel=0.3)
    assert found.rest_rmse == pytest.approx(float(np.hypot(1.0, 0.7 / np.sqrt(2.0))) * NOISE, rel=0.1)


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
