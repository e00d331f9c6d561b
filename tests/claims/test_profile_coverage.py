"""Coverage of profile and linear intervals over the random rigs: how it is counted, and that one rig goes through."""

import json

import numpy as np
import pytest

from experiments import blind_rigs, profile_coverage

TRUTH = {"piezo.gain": 1.0, "friction.sigma0_a": 2.0}


def result(number):
    """A rig whose linear intervals hold one and whose profiles hold three standard deviations of the error."""
    off = np.random.default_rng(number).standard_normal(2)
    about = lambda half: {
        path: [float(true + error - half), float(true + error + half)]
        for (path, true), error in zip(TRUTH.items(), off, strict=True)
    }
    return {"truth": TRUTH, "linear": about(1.0), "profile": about(3.0)}


def test_intervals_that_hold_the_truth_are_counted():
    results = [result(number) for number in range(2000)]
    for way, share in (("linear", 68.3), ("profile", 99.7)):
        found = profile_coverage.coverage(results, way)
        assert list(found) == list(TRUTH)
        np.testing.assert_allclose(list(found.values()), share, atol=2.5)
    rows = {row.name: row.ours for row in profile_coverage.table(results)}
    assert len(rows) == 6 and float(rows["linear: all"]) == pytest.approx(68.3, abs=2.0)


@pytest.mark.slow
def test_a_rig_has_both_intervals_and_those_of_the_profile_follow_the_valley(tmp_path, monkeypatch):
    for module in (blind_rigs, profile_coverage):
        monkeypatch.setattr(module, "OUT", tmp_path)
    made = {"arguments": repr((0,)), "result": blind_rigs.identified(0)}
    (tmp_path / blind_rigs.NAME).mkdir()
    (tmp_path / blind_rigs.NAME / "0000.json").write_text(json.dumps(made))
    found = profile_coverage.both_intervals(0)
    assert set(found["linear"]) == set(found["profile"]) and len(found["linear"]) == 9
    for path, (low, high) in found["profile"].items():
        begin, end = found["linear"][path]
        # Alike in width, not in place: chi-square is not quadratic.
        assert 0.7 < (high - low) / (end - begin) < 1.5
        assert low < made["result"]["joint"]["parameters"][path][0] < high
