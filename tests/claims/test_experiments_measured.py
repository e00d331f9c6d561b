"""Experiments on measured and measured-like records: what they rest on, and behind `slow` their key numbers."""

import json
import math

import numpy as np
import pytest
from tribometer_record import TRIBOMETER

import pdssjax
from experiments import fits, identification, measured_fits, measured_laws, tribometer
from pdssjax import Accuracy, Taylor
from pdssjax.inference import guess_starts


def loops_of_dahl(stiffness: float, level: float, speed: float = 2e-4):
    """Time, motion and force of two cycles of 200 um: exponential in the distance on each way."""
    time = np.arange(0.0, 4.0, 0.02)
    motion = np.interp(time, np.arange(0.0, 5.0), speed * np.array([0.0, 1.0, 0.0, 1.0, 0.0]))
    force = [0.0]
    for way in np.diff(motion):
        force.append(
            np.sign(way) * level + (force[-1] - np.sign(way) * level) * math.exp(-stiffness * abs(way) / level)
        )
    return time, motion, np.array(force)


def friction_study(folder, time, motion, force, law="simplified-lugre"):
    np.savetxt(folder / "loops.csv", np.column_stack([time, motion, force]), delimiter=",", header="t,x,f", comments="")
    names = {"simplified-lugre": ["sigma0", "sigma1", "f_ss"]}[law]
    text = (
        f'format = "pdssjax-study/1"\n[actuator]\npiezo = "second-order"\nfriction = "{law}"\n[parameters]\n'
        + "".join(f'"friction.{name}" = {{}}\n' for name in names)
        + '[[record]]\nfile = "loops.csv"\nmeasures = "friction"\n'
        'columns = { time = "t", motion = "x", force = "f" }\nunits = { time = "s", motion = "m", force = "N" }\n'
    )
    (folder / "study.toml").write_text(text, encoding="utf-8")
    return pdssjax.load_study(folder / "study.toml")


@pytest.mark.parametrize(("stiffness", "level"), [(4.5e4, 2.35), (2e6, 40.0)])
def test_a_friction_record_alone_tells_where_its_law_starts(tmp_path, stiffness, level):
    posed = friction_study(tmp_path, *loops_of_dahl(stiffness, level))
    starts, searched = guess_starts(posed.models, posed.parameters, posed.records)
    assert searched
    assert level / 2.5 < starts["friction.f_ss"] < 2.5 * level
    assert stiffness / 2.5 < starts["friction.sigma0"] < 2.5 * stiffness
    assert starts["friction.sigma1"] * 2e-4 < level, "damping does not drown the force"


@pytest.mark.slow
def test_fits_recover_what_made_a_record_and_leave_out_what_is_not_used(tmp_path):
    time, motion, force = loops_of_dahl(4.5e4, 2.35)
    noise = 0.02 * np.random.default_rng(1).normal(size=force.size)
    posed = friction_study(tmp_path, time, motion, force + noise + 0.3)
    starts, _ = guess_starts(posed.models, posed.parameters, posed.records)
    curves = fits.Curves(posed, Accuracy(method=Taylor(4), tolerance=1e-8), starts)
    free = ["friction.sigma0", "friction.f_ss"]
    held = starts | {"friction.sigma1": 1e-3}
    found = curves.fit(held, free, [np.ones(force.size, bool)])
    assert found.converged and found.values["friction.sigma1"] == pytest.approx(1e-3)
    for path, truth in zip(free, (4.5e4, 2.35), strict=True):
        assert abs(found.values[path] - truth) < 4.0 * found.errors[path] < 0.05 * truth
    assert math.sqrt(found.squares / found.samples) == pytest.approx(0.02, rel=0.15)
    assert found.free == 3, "the offset counts"
    first = curves.fit(held, free, [time < 2.0])
    assert first.samples == 100
    assert np.std(first.predicted[0] - force - 0.3) < 0.01, "the half that was left out is predicted"


def test_the_floor_of_a_periodic_record_is_its_noise():
    times = 3.0 + 2e-3 * np.arange(1, 1000)
    noise = 0.05e-6 * np.random.default_rng(2).normal(size=times.size)
    walk = 3e-6 * ((times / 0.2) % 1.0) ** 2 + 0.4e-6 * times + noise
    mask = measured_fits.well_read(times)
    assert measured_fits.floor(walk, times, mask) == pytest.approx(0.05, rel=0.1)
    assert not mask[:3].any() and not mask[(times > 3.199) & (times < 3.205)].any() and mask.sum() > 950


def test_the_measured_record_itself_allows_less_than_the_paper_s_error_but_not_at_the_slips():
    record = measured_fits.study("coulomb", "deflection").records[0]
    times = record.time + measured_fits.EARLIER
    assert measured_fits.floor(record.measured, times, measured_fits.well_read(times)) == pytest.approx(
        0.0517, rel=0.02
    )
    assert measured_fits.floor(record.measured, times, times > 3.007) == pytest.approx(0.103, rel=0.03)


def test_the_paper_s_parameters_are_not_a_contact_s():
    paper = {"effector.mass": 0.1, "drive.fall_time": 1e-3} | measured_laws.PUBLISHED
    assert measured_fits.judge(paper)["viscous"] > 10.0
    assert measured_fits.verdict(measured_fits.judge(paper)).startswith("not possible")


def test_a_raw_tribometer_record_becomes_loops_without_its_rests(tmp_path):
    time = np.arange(0.0, 175.0, 0.005)
    way = np.interp((time - 9.0) % 4.0, [0.0, 1.0, 2.0, 3.0, 4.0], [0.0, 0.23, 0.23, 0.0, 0.0]) * (time > 9.0)
    pull = np.clip(np.gradient(way), -1e-9, 1e-9) * 2.35e15
    table = np.column_stack([time, 5e6 * np.ones_like(time), way - 110.0, -pull])
    np.savetxt(tmp_path / "raw.tsv", table, delimiter="\t", header="a\tb\tc\td", comments="", fmt="%.7g")
    parts = tribometer.prepared(tmp_path / "raw.tsv")
    assert list(parts) == ["fitted", "earlier", "later"]
    for part in parts.values():
        assert part[0, 1] == 0.0 and part[0, 2] == 0.0, "the unloaded tester comes first"
        assert np.ptp(part[:, 1]) == pytest.approx(0.23e-3, rel=1e-3)
        assert 100 < len(part) < 150, "rests are two samples each"
        assert tribometer.repeatability(part) < 0.05 * 2.35


@pytest.mark.slow
def test_a_fit_at_5_Hz_predicts_20_Hz_to_the_noise(elsewhere):
    result = identification.calculate()
    assert [walk.role for walk in result.walks] == ["fit", "fit", "validate", "validate"]
    assert all(walk.rmse == pytest.approx(0.0104e-6, rel=0.05) for walk in result.walks)
    assert all(walk.r2 > 0.9999 for walk in result.walks)
    away = [
        (found.value - result.truth[path]) / found.standard_error
        for path, found in result.estimate.parameters.items()
        if found.free
    ]
    assert len(away) == 9 and max(map(abs, away)) < 3.0
    assert result.chapter_4["5 Hz B"] < 0.95 < identification.THESIS["20 Hz"], "a piezo 3 % off shows"


@pytest.mark.slow
def test_a_measured_motion_is_explained_to_its_noise_with_possible_parameters():
    starts = json.loads(measured_fits.STARTS.read_text(encoding="utf-8"))["starts"]
    lugre = measured_fits.fit("lugre", starts["lugre"])
    assert lugre.well < 0.09 < lugre.all < 0.135 == measured_laws.PAPER["lugre"]
    assert measured_fits.verdict(lugre.judged) == "possible"
    assert lugre.held_out < 0.135


@pytest.mark.slow
@pytest.mark.skipif(not TRIBOMETER.exists(), reason="the record is not part of the repository")
def test_measured_presliding_loops_are_nearly_elastic_and_plastic():
    parts = tribometer.prepared(TRIBOMETER)
    stiffness, level = tribometer.by_eye(parts["fitted"])
    assert stiffness == pytest.approx(4.3e4, rel=0.05) and level == pytest.approx(2.35, rel=0.02)
    dahl = tribometer.fit("dahl, n free", parts)
    assert dahl.index["fitted"] < 0.15 and dahl.out < 0.15
    assert dahl.found.values["friction.exponent"] < 0.2
    assert dahl.found.values["friction.f_c"] == pytest.approx(level, rel=0.03)
