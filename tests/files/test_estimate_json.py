"""estimate.json: what it says of each record, and what is taken from it."""

import dataclasses
import json

import fabricated
import measured_study
import numpy as np
import pytest

import pdssjax
from pdssjax.files import estimate_text, with_estimate
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
    found = {path: fabricated.parameter(path, number, 0.01 * number, "") for path, number in study.values().items()}
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
    assert kept["coloured"] == {"standard_error": 12.4, "interval": [50.4, 58.4]}
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
