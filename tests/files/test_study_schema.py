"""The JSON schema takes every study that is shipped and made, knows every key that is read, and refuses others."""

import copy
import json
import tomllib
from pathlib import Path

import fastjsonschema
import measured_study
import pytest
from study_files import STUDY

from pdssjax.cli.main import main
from pdssjax.core import member, members, quantities
from pdssjax.files.record_table import RECORD_KEYS
from pdssjax.files.study_schema import study_schema

ROOT = Path(__file__).parents[2]
STUDIES = sorted([*ROOT.glob("experiments/**/study.toml"), *ROOT.glob("pdssjax/**/study.toml")])
SCHEMA = study_schema()
check = fastjsonschema.compile(SCHEMA)


@pytest.mark.parametrize("path", STUDIES, ids=lambda path: path.parent.name)
def test_studies_that_are_shipped_pass(path):
    check(tomllib.loads(path.read_text(encoding="utf-8")))


@pytest.mark.parametrize("measurement", measured_study.variants(), ids=measured_study.label)
def test_studies_of_every_measurement_pass(measurement):
    check(tomllib.loads(measured_study.study(measured_study.record(measurement))))


@pytest.mark.parametrize("waveform", members("drive"))
def test_drives_of_every_waveform_pass(waveform):
    study = tomllib.loads(STUDY)
    drive = {"waveform": waveform} | {f: q.nominal for f, q in quantities(member("drive", waveform)).items()}
    study["record"][0]["drive"] = drive | ({"column": 3} if waveform == "sampled" else {})
    check(study)


@pytest.mark.parametrize("family", ["piezo", "friction"])
def test_every_parameter_of_every_member_is_known_also_under_a_condition(family):
    study = tomllib.loads(STUDY)
    for name in members(family):
        for field, declared in quantities(member(family, name)).items():
            study["parameters"] = {f"{family}.{field}": {"start": declared.nominal}, f"{family}.{field}@wet": {}}
            check(study)


def test_every_key_of_a_record_is_explained():
    described = SCHEMA["properties"]["record"]["items"]["properties"]
    assert set(RECORD_KEYS) <= set(described)
    assert all(described[key].get("description") or "oneOf" in described[key] for key in RECORD_KEYS)


@pytest.mark.parametrize(
    ("place", "key", "value"),
    [
        ([], "titel", "x"),
        ([], "format", "pdssjax-study/2"),
        (["actuator"], "piezo", "second_order"),
        (["actuator"], "feedback", "no"),
        (["parameters"], "friction.fss", {}),
        (["parameters", "piezo.gain"], "begin", 1),
        (["parameters", "piezo.gain"], "start", "much"),
        (["record", 0], "noize", 1),
        (["record", 0], "measures", "platfrom"),
        (["record", 0], "decimate", 1),
        (["record", 0], "held", 1),
        (["record", 0, "columns"], "tme", "t"),
        (["record", 0, "drive"], "waveform", "sawtoth"),
        (["record", 1, "drive"], "direction", "back"),
        (["record", 1, "drive"], "rise_time", 1),
    ],
)
def test_what_is_not_read_does_not_pass(place, key, value):
    study = copy.deepcopy(tomllib.loads(STUDY))
    table = study
    for step in place:
        table = table[step]
    table[key] = value
    with pytest.raises(fastjsonschema.JsonSchemaException):
        check(study)


def test_the_command_prints_it(capsys):
    assert main(["schema"]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads(json.dumps(SCHEMA))
