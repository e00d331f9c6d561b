"""Which parameters hold in a record: those under its conditions in place of the usual ones."""

import dataclasses

import pytest

import pdssjax
from pdssjax.files import EXAMPLE
from pdssjax.study import Parameter, paths_in


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
