"""Rigs of another simulator for `compare`: their motion, their noise, their studies, and how a choice is judged."""

import dataclasses
import json

import numpy as np
import pytest

import pdssjax
from experiments import compared_rigs, drawn_rigs
from tests.reference.independent import Rig, simulate
from tests.reference.laws.dahl import Dahl
from tests.reference.laws.elastoplastic import Elastoplastic
from tests.reference.laws.lugre import LuGre
from tests.reference.laws.simplified_lugre import SimplifiedLuGre

KINDS = {"dahl": Dahl, "simplified-lugre": SimplifiedLuGre, "lugre": LuGre, "elastoplastic": Elastoplastic}


def drawn(law):
    return next(rig for rig in map(drawn_rigs.draw, range(5)) if rig.law == law)


@pytest.mark.slow
@pytest.mark.parametrize("law", KINDS)
def test_rigs_move_as_the_simulator_that_locates_events_has_it(law):
    rig, walk = drawn(law), drawn_rigs.Walk("fast", 25.0, 1, False, "fit")
    contact = KINDS[law](**rig.contact, **({"sigma2": 0.0} if "v_s" in rig.contact else {}))
    numbers = {name: getattr(rig, name) for name in ("gain", "frequency", "damping", "mass", "fall", "voltage")}
    given = Rig(**numbers, cycle=0.04, forward=False, law=contact)
    times = walk.times[:100]
    np.testing.assert_allclose(
        drawn_rigs.walked(rig, walk, times), simulate(given, times, 1e-10, 5e-5)[:, 1], rtol=0.0, atol=1e-12
    )


def test_of_ten_rigs_in_a_row_two_have_each_law_once_with_coloured_noise():
    rigs = [drawn_rigs.draw(number) for number in range(20, 30)]
    assert sorted(rig.law for rig in rigs) == sorted([*drawn_rigs.LAWS] * 2)
    for law in drawn_rigs.LAWS:
        assert {rig.correlation_time for rig in rigs if rig.law == law} == {0.0, drawn_rigs.CORRELATION_TIME}
    assert drawn_rigs.draw(7) == drawn_rigs.draw(7)
    assert all(rig.contact["f_s"] > rig.contact["f_c"] for rig in rigs if "f_s" in rig.contact)


@pytest.mark.parametrize("time, alike", [(0.0, 0.0), (1e-3, np.exp(-0.1))])
def test_noise_has_its_size_and_correlation(time, alike):
    noise = drawn_rigs.noise_of(200_000, 1e-4, time, np.random.default_rng(0)) / drawn_rigs.NOISE
    assert np.std(noise) == pytest.approx(1.0, rel=0.05)
    assert np.mean(noise[1:] * noise[:-1]) / np.var(noise) == pytest.approx(alike, abs=0.01)


def test_a_rig_s_folder_is_a_study_that_does_not_tell_its_law(tmp_path, monkeypatch):
    monkeypatch.setattr(drawn_rigs, "walked", lambda rig, walk, times: 1e-6 * times)
    rig = drawn("elastoplastic")
    study = pdssjax.load_study(drawn_rigs.write_rig(rig, tmp_path))
    assert [record.role for record in study.records] == ["fit"] * 4 + ["validate"]
    assert {p for p, parameter in study.parameters.items() if not parameter.free} == {
        "effector.mass",
        "drive.fall_time",
    }
    assert study.models.chosen["friction"] == "simplified-lugre"
    assert json.loads((tmp_path / "truth.json").read_text(encoding="utf-8")) == dataclasses.asdict(rig)
    platform = study.with_values({"piezo.gain": rig.gain, "piezo.natural_frequency": rig.frequency})
    at = platform.with_values({"piezo.damping_ratio": rig.damping})
    known = {"friction.sigma0": 1e6, "friction.sigma1": 40.0, "friction.f_ss": 0.6}
    steps = dataclasses.replace(at, records=study.records[:2]).predict(known)
    for record, motion in zip(study.records, steps, strict=False):
        assert np.std(record.measured - np.asarray(motion)) == pytest.approx(drawn_rigs.NOISE, rel=0.15)


def told(law, chosen, blocks=0.0, records=0.0):
    """A result in which the law chosen scores so far below the true one."""
    free = {name: 6 + place for place, name in enumerate(drawn_rigs.LAWS)}
    scores = {name: {"free": free[name], "blocks": 5.0, "records": 5.0, "error": 1e-9} for name in (law, chosen)}
    scores[chosen] |= {"blocks": 5.0 + blocks, "records": 5.0 + records}
    return {"number": 1, "law": law, "chosen": chosen, "coloured": False, "scores": scores, "seconds": 1.0}


def test_the_true_law_and_a_simpler_one_that_predicts_as_well_are_right():
    assert compared_rigs.is_right(told("lugre", "lugre"))
    assert compared_rigs.is_right(told("lugre", "simplified-lugre", records=2.0))
    assert not compared_rigs.is_right(told("lugre", "simplified-lugre", records=4.0))
    assert not compared_rigs.is_right(told("lugre", "elastoplastic", records=-50.0))
    assert not compared_rigs.is_right({**told("lugre", "dahl"), "chosen": ""})


def test_the_table_counts():
    rigs = [told("lugre", "lugre"), told("lugre", "dahl", records=9.0), told("lugre", "simplified-lugre")]
    rigs = [r | {"right": compared_rigs.is_right(r), "worse": compared_rigs.predicts_worse(r)} for r in rigs]
    text = compared_rigs.table(rigs)
    assert "Right: 2 of 3. A law that predicts worse is chosen in 1." in text
    assert "WRONG" in text and "| simpler |" in text
