"""estimate.json: what it says of each record, and what is taken from it."""

import dataclasses
import json

import fabricated
import measured_study
import numpy as np
import pytest

import pdssjax
from pdssjax import InputError
from pdssjax.files import estimate_text, read_covariance, starting_at_estimate, with_estimate
from pdssjax.study import compare


def planned(folder, of=""):
    """A study whose one record is a velocity, still to be made."""
    key = f'of = "{of}"\n' if of else ""
    kind = f"""
[[record]]
name = "seen"
file = "seen.csv"
measures = "velocity"
{key}columns = {{ time = "time_s", velocity = "velocity_mm/s" }}
drive = {{ waveform = "step", voltage = "40 V", rise_time = "1 ms" }}
sampling = {{ start = "0 s", end = "10 ms", interval = "0.1 ms" }}
noise = "0.1 mm/s"
"""
    (folder / "plan.toml").write_text(measured_study.study(kind))
    return pdssjax.load_study(folder / "plan.toml", virtual=True)


def written(study) -> dict:
    """What an estimate with the study's record and numbers is written as."""
    (record,) = study.records
    made = dataclasses.replace(record, measured=np.sin(2e3 * record.time))
    compared = compare(made, np.zeros_like(record.time), noise=1e-4, offset=0.0)
    units = {path: declared.unit for path, declared in study.legal().items()}
    found = {p: fabricated.parameter(p, number, 0.01 * number, units[p]) for p, number in study.values().items()}
    whole = dataclasses.replace(fabricated.estimate(), parameters=found, records=(compared,))
    return json.loads(estimate_text(whole))


@pytest.mark.parametrize(("of", "said"), [("platform", "platform"), ("effector", "effector"), ("", "effector")])
def test_a_velocity_says_of_what_it_is(tmp_path, of, said):
    (record,) = written(planned(tmp_path, of))["records"]
    assert (record["measures"], record["of"]) == ("velocity", said)


def test_other_records_have_no_such_key():
    records = json.loads(estimate_text(fabricated.estimate()))["records"]
    assert {record["measures"] for record in records} == {"platform", "effector"}
    assert not any("of" in record for record in records)


def test_numbers_are_taken_from_a_file_with_and_without_it(tmp_path):
    study = planned(tmp_path, "platform")
    document = written(study)
    document["parameters"]["piezo.gain"]["value"] = 2e-7
    taken = []
    for older in (False, True):
        if older:
            del document["records"][0]["of"]
        (tmp_path / "estimate.json").write_text(json.dumps(document))
        taken.append(with_estimate(study, tmp_path / "estimate.json").values())
    assert taken[0] == taken[1] == study.values() | {"piezo.gain": 2e-7}


def test_errors_by_every_model_are_kept_with_the_one_to_believe():
    whole = fabricated.with_errors(fabricated.estimate())
    document = json.loads(estimate_text(whole))
    kept = document["parameters"]["friction.sigma1_a"]["errors"]
    assert list(kept) == ["white", "coloured", "with-misfit"]
    known = {"standard_error": 12.4, "interval": [50.4, 58.4], "degrees_of_freedom": None}
    assert kept["coloured"] == known  # null where the noise is known: infinite
    assert document["error_advice"] == whole.error_advice._asdict()
    assert document["covariances"]["names"] == list(whole.names)
    assert document["covariances"]["coloured"][0][0] == pytest.approx(4.0 * whole.covariance[0, 0])
    assert "errors" not in document["parameters"]["effector.mass"]


def test_an_estimate_without_them_is_kept_and_read_all_the_same(tmp_path):
    study = planned(tmp_path, "platform")
    document = written(study)
    assert document["error_advice"] is None
    for path in document["parameters"]:
        assert "errors" not in document["parameters"][path]
    del document["error_advice"], document["covariances"]  # as older versions wrote it
    (tmp_path / "estimate.json").write_text(json.dumps(document))
    assert with_estimate(study, tmp_path / "estimate.json").values() == study.values()


def test_an_estimate_of_another_law_is_refused_by_both_names(tmp_path):
    study, file = planned(tmp_path, "platform"), tmp_path / "estimate.json"
    document = written(study)
    document["actuator"] = study.models.chosen
    file.write_text(json.dumps(document))
    assert with_estimate(study, file).values() == study.values()
    # All of its parameters are among those of the other law, which would have been used in part.
    document["actuator"] = study.models.chosen | {"friction": "stribeck"}
    file.write_text(json.dumps(document))
    for take in (with_estimate, starting_at_estimate):
        with pytest.raises(InputError) as caught:
            take(study, file)
        law = study.models.chosen["friction"]
        assert str(caught.value).startswith(
            f'{file}: found an estimate with friction = "stribeck", expected one with friction = "{law}"'
        )


GAIN, COVARIANCE = ("parameters", "piezo.gain"), ("covariance",)

# name: (where in the document, what stands there instead, what the message must contain)
EDITED = {
    "another unit": ((*GAIN, "unit"), "um/V", ['piezo.gain: key "unit"', '"um/V"', '"m/V"']),
    "no value": ((*GAIN, "value"), None, ['piezo.gain: key "value"', "None", "m/V"]),
    "a truth value": ((*GAIN, "value"), True, ['piezo.gain: key "value"', "True", "m/V"]),
    "a value beyond all floats": ((*GAIN, "value"), 10**400, ['piezo.gain: key "value"', "finite"]),
    "no table of a parameter": (GAIN, 0.1, ['"piezo.gain"', "0.1", "a table"]),
    "no table of the actuator": (("actuator",), "lugre", ['"actuator"', "lugre", "a table"]),
    "no table of parameters": (("parameters",), [], ['"parameters"', "a table"]),
    "no covariance": (COVARIANCE, None, ["covariance", "square matrix"]),
    "a name too few": ((*COVARIANCE, "names"), ["piezo.gain"], ["covariance", "square matrix"]),
    "words in the covariance": ((*COVARIANCE, "matrix", 0, 0), "x", ["covariance", "square matrix"]),
    "no name of the errors": (("error_advice",), {}, ["covariance", "square matrix"]),
}


@pytest.mark.parametrize(("place", "found", "essentials"), EDITED.values(), ids=EDITED)
def test_what_was_edited_by_hand_is_refused_where_it_is_wrong(tmp_path, place, found, essentials):
    study, file = planned(tmp_path, "platform"), tmp_path / "estimate.json"
    document = written(study)
    inner = document
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = found
    file.write_text(json.dumps(document))
    with pytest.raises(InputError) as caught:
        with_estimate(study, file) if place[0] in ("parameters", "actuator") else read_covariance(file)
    for essential in (str(file), *essentials):
        assert essential in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_number_with_a_unit_may_be_edited_in(tmp_path):
    study, file = planned(tmp_path, "platform"), tmp_path / "estimate.json"
    document = written(study)
    document["parameters"]["piezo.gain"]["value"] = "0.2 um/V"
    file.write_text(json.dumps(document), encoding="utf-8-sig")  # as some editors write it
    assert with_estimate(study, file).values()["piezo.gain"] == 2e-7


@pytest.mark.parametrize("value", ["[" * 100_000, "7" * 5000])
def test_json_beyond_what_python_reads_is_refused_in_one_line(tmp_path, value):
    file = tmp_path / "estimate.json"
    file.write_text(f'{{"format": "pdssjax-estimate/1", "parameters": {value}')
    with pytest.raises(InputError, match="found no valid JSON") as caught:
        read_covariance(file)
    assert str(caught.value).startswith(f"{file}: ") and "\n" not in str(caught.value)
