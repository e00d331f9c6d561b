"""`pdssjax new` of a vibrometer's files: the record is of a velocity, and what else was measured is a clear line."""

import numpy as np
import pytest
from walk_files import guessed, study_by_command, study_of, text_of

from pdssjax import InputError, identify, load_study
from pdssjax.files import RigOptions
from pdssjax.study import make_recordings

pytestmark = pytest.mark.usefixtures("undrawn")

PLAN = """
format = "pdssjax-study/1"
actuator = {{ piezo = "second-order", friction = "simplified-lugre" }}
[parameters]
"effector.mass" = {{ value = "45 g" }}
"piezo.gain" = {{ value = "0.15 um/V" }}
"piezo.natural_frequency" = {{ value = "700 Hz" }}
"piezo.damping_ratio" = {{ value = "5 %" }}
"friction.sigma0" = {{ value = "0.6 N/um" }}
"friction.sigma1" = {{ value = "30 N s/m" }}
"friction.f_ss" = {{ value = "0.3 N" }}
[[record]]
name = "run"
file = "run.csv"
columns = {{ time = "time_s", velocity = "velocity_mm/s" }}
measures = "velocity"
of = "{of}"
noise = "0.02 mm/s"
drive = {{ {drive} }}
sampling = {{ start = "-20 ms", end = "{end}", interval = "50 us" }}
"""

DRIVES = {
    "platform": ('waveform = "step", voltage = "40 V", rise_time = "0.3 ms"', "0.1 s"),
    "effector": (
        'waveform = "sawtooth", direction = "forward", voltage = "40 V", frequency = "10 Hz", fall_time = "0.3 ms"',
        "0.5 s",
    ),
}


def written(folder, of, sign=1.0, zero=0.3, head="time_s,monitor_V,vibrometer_mm/s"):
    """The file of an instrument: times [s], volts, and the velocity [mm/s] with a zero of its own."""
    drive, end = DRIVES[of]
    (folder / "plan.toml").write_text(PLAN.format(of=of, drive=drive, end=end))
    (made,) = make_recordings(load_study(folder / "plan.toml", virtual=True), 5)
    time, random = made.record.time, np.random.default_rng(5)
    volts = np.asarray(made.record.drive.at(time)) + 0.002 * random.normal(size=time.size)
    speed = sign * 1e3 * (made.true + 2e-5 * random.normal(size=time.size)) + zero
    return text_of(head, time, volts, speed, form=".18e")


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("of", DRIVES)
def test_a_velocity_is_told_from_a_displacement_and_turned(tmp_path, of, sign):
    rig = RigOptions(mass=0.045)
    found = guessed(tmp_path, written(tmp_path, of, sign), rig=rig)
    (record,) = study_of(tmp_path, found, rig=rig)[1].records
    assert (record.measures, record.measurement.words) == ("velocity", {"of": of})
    assert found.guess.turned == (sign < 0)
    assert record.noise == pytest.approx(2e-5, rel=0.2)
    speed = np.loadtxt(tmp_path / "run.csv", delimiter=",", skiprows=1)[:, 2]
    np.testing.assert_allclose(record.measured, sign * 1e-3 * speed, atol=1e-12)
    assert float(record.drive.peak()) == pytest.approx(40.0, rel=1e-3)


@pytest.mark.slow
def test_two_commands_lead_from_a_vibrometer_to_the_stack(tmp_path):
    _, study = study_by_command(tmp_path, written(tmp_path, "platform"))
    found = identify(study)
    assert found.success
    truth = {"piezo.gain": 0.15e-6, "piezo.natural_frequency": 2 * np.pi * 700.0, "piezo.damping_ratio": 0.05}
    for path, number in truth.items():
        parameter = found.parameters[path]
        assert abs(parameter.value - number) < 4.0 * parameter.standard_error < 0.02 * number


@pytest.mark.parametrize(("unit", "kind"), [("N", "force"), ("m/s^2", "acceleration")])
def test_what_is_not_guessed_says_what_to_do(tmp_path, unit, kind):
    with pytest.raises(InputError) as told:
        guessed(tmp_path, written(tmp_path, "platform", head=f"time_s,monitor_V,sensor_{unit}"))
    assert f'measures = "{kind}"' in str(told.value) and "--displacement" in str(told.value)
    assert "\n" not in str(told.value)


def test_a_velocity_without_units_is_named(tmp_path):
    text, units = written(tmp_path, "platform", head="t,u,v"), {"time": "s", "voltage": "V", "velocity": "mm/s"}
    assert guessed(tmp_path, text, {"voltage": "u", "velocity": "v"}, units).guess.measures == "platform"
    with pytest.raises(InputError, match="both --displacement and --velocity"):
        guessed(tmp_path, text, {"velocity": "v", "displacement": "v"})
    with pytest.raises(InputError, match="found a velocity without a voltage"):
        guessed(tmp_path, text, {"voltage": "none", "velocity": "v"}, units, rig=RigOptions(peak=40.0))
