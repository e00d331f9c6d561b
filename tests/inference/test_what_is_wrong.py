"""A wrong law, a model with too many parameters: each is named as what it is (records: `test_notes`)."""

import math

import numpy as np
import pytest
from record_tables import loaded, write_columns

import pdssjax
from pdssjax.report.text import format_report

SPEED, STIFFNESS, LEVEL, NOISE = 2e-4, 4.5e4, 2.35, 0.02

LOOPS = f"""
[[record]]
name = "loops"
file = "loops.csv"
measures = "friction"
columns = {{ time = "t", motion = "x", force = "f" }}
units = {{ time = "s", motion = "m", force = "N" }}
noise = "{NOISE} N"
"""


def head(law, *names, piezo="second-order"):
    lines = (name if "=" in name else f'"friction.{name}" = {{}}' for name in names)
    actuator = f'[actuator]\npiezo = "{piezo}"\nfriction = "{law}"\n'
    return f'format = "pdssjax-study/1"\n{actuator}[parameters]\n' + "\n".join(lines)


def loops(folder, text):
    """A study of two cycles of 200 um that bristles without damping resist, exponentially in the distance."""
    time = np.arange(0.0, 4.0, 0.02)
    motion = np.interp(time, np.arange(0.0, 5.0), SPEED * np.array([0.0, 1.0, 0.0, 1.0, 0.0]))
    force = [0.0]
    for way in np.diff(motion):
        end = np.sign(way) * LEVEL
        force.append(end + (force[-1] - end) * math.exp(-STIFFNESS * abs(way) / LEVEL))
    noisy = np.array(force) + np.random.default_rng(1).normal(0.0, NOISE, time.size)
    write_columns(folder / "loops.csv", "t,x,f", time, motion, noisy, digits="%.18e")
    return loaded(folder, text + LOOPS)


@pytest.mark.slow
def test_a_wrong_law_is_no_success_and_the_report_says_that_the_law_lacks_something(tmp_path):
    """Coulomb's force jumps where the bristles give way over 50 um."""
    estimate = pdssjax.identify(loops(tmp_path, head("coulomb", "f_c")))
    assert estimate.converged and not estimate.success
    (note,) = [note for note in estimate.notes if "does not explain" in note]
    assert '"loops"' in note and "another law" in note
    assert "The law lacks something" in format_report(estimate)


SLIDING = (
    head(
        "coulomb",
        "f_c",
        '"effector.mass" = { start = "90 g" }',
        '"piezo.gain" = { value = "0.1 um/V" }',
        piezo="static",
    )
    + """
[[record]]
name = "sliding"
file = "sliding.csv"
columns = { time = "time_s", displacement = "y_um" }
measures = "effector"
noise = "0.01 um"
drive = { waveform = "sine", voltage = "100 V", frequency = "50 Hz" }
"""
)


@pytest.mark.slow
def test_a_parameter_too_many_is_named_with_those_that_it_goes_with(tmp_path):
    """From displacement alone mass and force are told by their ratio only."""
    time = np.arange(0.0, 0.1, 2e-4)
    write_columns(tmp_path / "sliding.csv", "time_s,y_um", time, np.linspace(0.0, 1.0, time.size), digits="%.18e")
    study = loaded(tmp_path, SLIDING)
    motion = np.asarray(study.predict({"friction.f_c": 0.015, "effector.mass": 0.086})[0])
    noisy = 1e6 * (motion + np.random.default_rng(2).normal(0.0, 1e-8, time.size))
    write_columns(tmp_path / "sliding.csv", "time_s,y_um", time, noisy, digits="%.18e")
    estimate = pdssjax.identify(pdssjax.load_study(tmp_path / "study.toml"))
    (note,) = [note for note in estimate.notes if "common factor" in note]
    assert "friction.f_c" in note and "effector.mass" in note and "Fix one, for example the mass" in note
    for path in ("friction.f_c", "effector.mass"):
        assert not estimate.parameters[path].identifiable and np.isnan(estimate.parameters[path].standard_error)
    ratio = estimate.parameters["friction.f_c"].value / estimate.parameters["effector.mass"].value
    assert ratio == pytest.approx(0.015 / 0.086, rel=2e-3)


@pytest.mark.slow
def test_profiles_of_records_have_verdicts_of_every_kind(tmp_path):
    """Of a damping whose error is its own size the upper end is told; a force at the study's bound has a lower one."""
    text = head("simplified-lugre", "sigma0", "sigma1", "f_ss")
    study = loops(tmp_path, text)
    truth = {"friction.sigma0": STIFFNESS, "friction.sigma1": 15.0, "friction.f_ss": LEVEL}
    force = np.asarray(study.predict(truth)[0]) + np.random.default_rng(1).normal(0.0, NOISE, 200)
    write_columns(
        tmp_path / "loops.csv", "t,x,f", study.records[0].time, study.records[0].motion, force, digits="%.18e"
    )
    estimate = pdssjax.identify(
        loaded(tmp_path, text.replace('f_ss" = {}', f'f_ss" = {{ max = "{LEVEL - 0.01} N" }}') + LOOPS),
        intervals="profile",
    )
    verdicts = {profile.path: profile.verdict for profile in estimate.profiles}
    assert verdicts["friction.sigma0"] == "bounded"
    assert verdicts["friction.sigma1"] == "one-sided: only an upper end"
    low, high = estimate.parameters["friction.sigma1"].interval
    assert low == 0.0 and 15.0 < high < 100.0
    assert verdicts["friction.f_ss"] == "held by a bound: upper end"
    low, high = estimate.parameters["friction.f_ss"].interval
    assert estimate.parameters["friction.f_ss"].at_bound and high == pytest.approx(LEVEL - 0.01)
    assert LEVEL - 0.02 < low < high
