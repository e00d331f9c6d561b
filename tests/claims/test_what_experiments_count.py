"""What experiments count: coverage, endings, verdicts.  The claims of the documentation rest on it."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

import pdssjax
from experiments import (
    from_files,
    identification,
    map_of_rightness,
    measured_laws,
    profile_coverage,
    wrong_law,
)
from experiments.derivative_judge import Verdict
from experiments.from_files import TRUTH
from pdssjax.files import EXAMPLE
from pdssjax.metrics import r_squared

TWO = {"piezo.gain": 1.0, "friction.sigma0_a": 2.0}


def rig_of_two(number):
    """A rig whose linear intervals hold one and whose profiles hold three standard deviations of the error."""
    off = np.random.default_rng(number).standard_normal(2)
    about = lambda half: {
        path: [float(true + error - half), float(true + error + half)]
        for (path, true), error in zip(TWO.items(), off, strict=True)
    }
    return {"truth": TWO, "linear": about(1.0), "profile": about(3.0)}


def test_profile_coverage_counts_intervals_that_hold_the_truth():
    results = [rig_of_two(number) for number in range(2000)]
    for way, share in (("linear", 68.3), ("profile", 99.7)):
        found = profile_coverage.coverage(results, way)
        assert list(found) == list(TWO)
        np.testing.assert_allclose(list(found.values()), share, atol=2.5)
    rows = {row.name: row.ours for row in profile_coverage.table(results)}
    assert len(rows) == 6 and float(rows["linear: all"]) == pytest.approx(68.3, abs=2.0)


def test_neighbouring_noise_is_alike():
    noise = wrong_law.coloured(200_000, np.random.default_rng(0)) / wrong_law.NOISE
    assert np.std(noise) == pytest.approx(1.0, rel=0.02)
    assert np.mean(noise[1:] * noise[:-1]) == pytest.approx(wrong_law.CORRELATION, rel=0.02)


def test_coverage_is_counted_by_model_and_parameter():
    random = np.random.default_rng(1)
    told = lambda: [1.0 + 0.1 * random.standard_normal(), 0.05, 0.1, 0.2]
    results = [
        {"pseudo": {"a": 1.0, "b": 1.0}, "converged": True, "parameters": {"a": told(), "b": told()}}
        for _ in range(3000)
    ]
    np.testing.assert_allclose(wrong_law.coverage(results), [[0.673] * 2, [0.95] * 2, [0.9999] * 2], atol=0.03)
    rows = {row.name: row for row in wrong_law.rows(results)}
    assert list(rows)[:2] == ["a: white, coloured, with-misfit", "a: with misfit over coloured"]
    assert rows["a: with misfit over coloured"].ours == pytest.approx(2.0)
    # What the last model covers follows from how much wider it is than the one that is right.
    for ratio, follows in wrong_law.widths(results).values():
        assert (ratio, follows) == (pytest.approx(2.0), pytest.approx(0.9999, abs=1e-4))


def result(number, **changes):
    """A rig of which everything is found within a standard error of 1 % that is right."""
    random = np.random.default_rng(number)
    parameters = {}
    for path in [*TRUTH, "sensor.delay@step", "sensor.delay@forward"]:
        off = random.standard_normal()
        parameters[path] = [1.0, 1.0 + 0.01 * off, 0.01, [1.0 + 0.01 * (off - 1.96), 1.0 + 0.01 * (off + 1.96)]]
    distance = float(stats.chi2(len(TRUTH)).rvs(random_state=random))
    return {"new": 0, "status": 0, "seconds": 9.0, "parameters": parameters, "distance": distance} | changes


def test_endings_and_intervals_are_counted():
    blank = {**result(0)["parameters"], "piezo.gain": [1.0, 1.0, None, [None, None]]}
    odd = [{"new": 2, "words": "?"}, {"new": 0, "status": from_files.GIVEN_UP, "seconds": 1800.0}]
    results = [result(number) for number in range(400)] + odd + [result(0, status=3, parameters=blank)]
    rows = {row.name: row.ours for row in from_files.table(results)}
    assert rows["a question of new"] == rows["given up"] == rows["exit status 3"] == "1 of 403"
    assert rows["exit status 0"] == "400 of 403"
    assert rows["distance of the truth, mean"] == pytest.approx(9.0, abs=1.0)
    assert rows["chance of such a distribution of it"] > 1e-3
    assert len(from_files.ended(results)) == 400
    shares = from_files.coverage(results)
    np.testing.assert_allclose(list(shares.values()), 95.0, atol=4.0)
    assert [path for path in shares if "sensor" in path] == ["sensor.delay"]


def test_the_error_that_an_r2_amounts_to_gives_that_r2_back():
    study = pdssjax.load_study(EXAMPLE / "study.toml")
    walk = next(record for record in study.records if record.name == "5 Hz A")
    error = 1e-6 * identification.misfit(0.9987, walk)
    assert error == pytest.approx(0.4787e-6, rel=1e-3)
    wrong = walk.measured + error * np.resize([1.0, -1.0], walk.measured.size)
    assert r_squared(walk.measured, wrong) == pytest.approx(0.9987, abs=1e-9)


@pytest.mark.parametrize(("held_out", "verdict"), [((0.07, 0.08), "it is dahl"), ((0.08, 0.07), "does not tell")])
def test_a_law_is_named_only_where_aic_and_the_cycles_held_out_agree(held_out, verdict):
    results = [
        SimpleNamespace(law=law, held_out=left, whole=SimpleNamespace(aic=aic))
        for law, left, aic in zip(("dahl", "coulomb"), held_out, (100.0, 147.0), strict=True)
    ]
    said = measured_laws.which_law(results)
    assert verdict in said and "AIC prefers dahl, by 47 over coulomb" in said


RIGHT = Verdict("piezo.gain", 2e-6, 0.5, None, None, 0, 1e-13, 1e-12, "")
WRONG = RIGHT._replace(error=3e-3, discontinuity=1e-5, tight=2e-6, above=1)
CLIFF = RIGHT._replace(error=0.5, discontinuity=0.4, tight=0.5, value=1e-7)
FAILED = RIGHT._replace(error=np.nan, value=np.nan, reverse=np.nan, failure="usual")
FOUND = {"lugre": [RIGHT] * 3, "stop": [RIGHT, WRONG, CLIFF, FAILED, RIGHT._replace(reverse=1e-6, value=1e-3)]}


def test_rows_count_what_is_wrong_and_leave_out_what_a_cliff_explains():
    assert map_of_rightness.row("lugre", FOUND["lugre"])[1:] == ["3", "0", "0", "0", "2e-06", "1e-13 m", "1e-12"]
    assert map_of_rightness.row("stop", FOUND["stop"])[1:] == ["5", "1", "1", "1", "3e-03", "1e-03 N", "1e-06"]
    assert map_of_rightness.row("lugre", [FAILED])[1:6] == ["1", "0", "0", "1", "nan"]


def test_every_actuator_that_is_not_as_asked_is_named():
    text = map_of_rightness.table(FOUND)
    assert text.startswith("## 8 random actuators of 2 structures")
    named = [line for line in text.splitlines() if line.startswith("- ")]
    assert [line.split(":")[0] for line in named] == [f"- stop {number}" for number in (1, 2, 3, 4)]
    assert "1 above" in named[0] and "at a cliff" in named[1] and "value" not in named[1]
    assert "did not finish" in named[2] and "value off by 1.0e-03; forward less reverse 1.0e-06" in named[3]
