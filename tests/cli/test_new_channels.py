"""`pdssjax new`: channels, units and factors, the velocities of a vibrometer, and records that are unlike most."""

import re
import shutil

import fabricated
import numpy as np
import pytest
import scipy.signal
from walk_files import detected_once as detected_once, guessed, study_by_command, study_of, text_of, walk_of

from pdssjax import InputError, identify, load_study
from pdssjax.drive.step import Step
from pdssjax.files import RigOptions
from pdssjax.study import make_recordings

pytestmark = pytest.mark.usefixtures("undrawn", "detected_once")
UNITS = {"time": "s", "voltage": "V", "displacement": "um"}


@pytest.mark.parametrize(
    ("volts_per_um", "told"),
    [
        (200.0, ["more than a stack moves", "--unit displacement=mV"]),
        (2e-4, ["less than a stack moves"]),
        (0.2, []),
    ],
)
def test_a_wrong_scale_of_an_end_effector_is_questioned(tmp_path, capsys, volts_per_um, told):
    options = ["--time", "1", "--voltage", "U_mon", "--displacement", "sensor", "--unit", "time=s", "--mass", "86 g"]
    options += ["--unit", "voltage=V", "--scale", "displacement=5 um/V"]
    study_by_command(tmp_path, text_of("t,U_mon,sensor", *walk_of(volts_per_um)), *options)
    errors = capsys.readouterr().err
    assert all(part in errors for part in told) and bool(errors) == bool(told)


def test_a_name_that_ends_in_no_unit_may_have_a_scale(tmp_path):
    time, volts, motion = walk_of(0.2)
    columns, scales = {"voltage": "U_mon", "displacement": "sensor"}, {"voltage": 20.0, "displacement": "5 um/V"}
    found = guessed(tmp_path, text_of("t,U_mon,sensor", time, volts / 20.0, motion), columns, {"time": "s"}, scales)
    assert found.guess.waveform.numbers["voltage"] == pytest.approx(60.0, rel=1e-3)


def test_a_command_at_the_piezo_s_place_is_questioned(tmp_path, capsys):
    """20 um/V of a stack behind an amplifier of 20 are no more than 1 um/V of a stage with levers has."""
    time, volts, motion = walk_of(1.0)
    text = text_of("time_s,AO_cmd_V,x_um", time, volts / 20.0, motion)
    study_by_command(tmp_path, text, "--mass", "86 g")
    assert "3 V at most, as a monitor or a command of an amplifier has" in capsys.readouterr().err
    shutil.rmtree(tmp_path / "rig")
    study_by_command(tmp_path, text, "--mass", "86 g", "--scale", "voltage=20")
    assert capsys.readouterr().err == ""


def test_names_tell_of_channels_without_units_what_shapes_leave_open(tmp_path):
    """A motion that follows the voltage has its waveform, too."""
    time, volts, _ = walk_of(0.2)
    found = guessed(tmp_path, text_of("U,t,x", volts, time, 0.1 * volts), units=UNITS)
    numbers = {quantity: channel.number for quantity, channel in found.roles.channels.items()}
    assert numbers == {"voltage": 1, "time": 2, "displacement": 3}
    assert "# guess: time, voltage, displacement told by the samples and names" in study_of(tmp_path, found)[0]
    with pytest.raises(InputError, match=r'several channels that may be the voltage .1: "ai0", 3: "ai1".'):
        guessed(tmp_path, text_of("ai0,t,ai1", volts, time, 0.1 * volts), units=UNITS)


def test_a_sensor_in_volts_is_told_by_its_scale(tmp_path):
    """Neither a trigger nor a channel that stands still is a motion."""
    time, volts, motion = walk_of(0.2)
    columns = time, volts, 5.0 * (time > 0.1), 0.0 * time + 0.003, motion
    text = text_of("time_s,voltage_V,trigger_V,ai3_V,sensor_V", *columns)
    with pytest.raises(InputError) as asked:
        guessed(tmp_path, text)
    assert '(5: "sensor_V" [V])' in str(asked.value) and '--scale "displacement=0.5 um/V"' in str(asked.value)
    with pytest.raises(InputError, match=r'"sensor_V". in "V", expected --scale'):
        guessed(tmp_path, text, {"displacement": "sensor_V"})
    found = guessed(tmp_path, text, scales={"displacement": "5 um/V"})
    assert found.roles.channels["displacement"].number == 5 and found.roles.channels["voltage"].number == 2


def test_samples_that_are_no_numbers_are_excluded(tmp_path, capsys):
    time, volts, motion = walk_of(0.2)
    lines = text_of("time_s,voltage_V,x_um", time, volts, motion).splitlines()
    for row in (301, 302, 700):
        lines[row] = lines[row].rpartition(",")[0] + ",NaN"
    lines[900] = f"{time[899]:.6f},,{motion[899]:.6f}"
    _, study = study_by_command(tmp_path, "\n".join(lines), "--mass", "86 g")
    assert "found 4 samples that are no numbers; the record excludes them" in capsys.readouterr().err
    (record,) = study.records
    assert record.measured.size == time.size - 4
    for row in range(100, 500):
        lines[row] = lines[row].rpartition(",")[0] + ",NaN"
    with pytest.raises(InputError, match='line 101, column "x_um": found "NaN", expected a finite number'):
        guessed(tmp_path, "\n".join(lines))


def test_one_file_is_asked_about_once_for_all(tmp_path):
    time, volts, motion = walk_of(0.2)
    trigger = 5.0 * (time > 0.1)
    with pytest.raises(InputError) as asked:
        guessed(tmp_path, text_of("t,in,platform,slider,out", time, volts, motion, motion[::-1], trigger))
    for question in ("--voltage", "--displacement", "--unit time=s"):
        assert question in str(asked.value)
    assert str(asked.value).count("run.csv") == 1


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


HEADER = "time_s,voltage_V,displacement_um"
PLATFORM = "--measures", "platform"


@pytest.mark.parametrize(("first", "last"), [(20.0, 50.0), (50.0, 0.0)])
def test_a_step_from_a_bias_rings_and_is_counted_from_it(tmp_path, first, last):
    time = np.arange(-0.002, 0.015, 2e-5)
    random = np.random.default_rng(7)
    motion = 1e6 * fabricated.step_motion(time, (last - first) * 8.5e-8, 9100.0, 0.06)
    volts = np.where(time < 0, first, last) + 0.02 * random.normal(size=time.size)
    motion += 0.008 * random.normal(size=time.size)
    text, study = study_by_command(tmp_path, text_of(HEADER, time, volts, motion, form=".7g"), *PLATFORM)
    assert 'piezo = "second-order"' in text
    assert float(re.search(r"counted from (\S+) V", text)[1]) == pytest.approx(first, abs=0.01)
    assert "conditioning" not in text
    (record,) = study.records
    assert isinstance(record.drive, Step) and record.time[0] == pytest.approx(-0.002, abs=1e-4)
    assert float(record.drive.voltage) == pytest.approx(last - first, abs=0.02)


@pytest.mark.parametrize("rests", [True, False])
def test_a_stack_with_hysteresis_feels_the_level_and_gets_the_samples(tmp_path, rests):
    time = np.arange(0.0, 24.0, 0.01)
    turn = 0.25 * (time - (4.0 if rests else -1.0))
    volts = 20.0 + 50.0 * np.where(turn < 0.0, 0.0, 1.0 - np.abs(2.0 * np.mod(turn, 1.0) - 1.0))
    held = [20.0]
    for level in volts[1:]:
        held.append(float(np.clip(held[-1], level - 6.0, level + 6.0)))
    random = np.random.default_rng(3)
    motion = 0.1 * np.array(held) + 0.002 * random.normal(size=time.size)
    volts = volts + 0.01 * random.normal(size=time.size)
    text, study = study_by_command(tmp_path, text_of(HEADER, time, volts, motion, form=".7g"), *PLATFORM)
    assert 'waveform = "sampled"' in text and "a triangle of " in text and "hysteresis feels that level" in text
    assert ('conditioning = "60 s"' if rests else "conditioning = { cycles = 2, period = ") in text
    (record,) = study.records
    assert record.time[0] == pytest.approx(60.0 if rests else 8.0, abs=0.01)


def test_what_no_rig_does_is_questioned(tmp_path, capsys):
    time = np.arange(0.0, 400.0, 0.2)
    volts = 1200.0 * np.mod(0.02 * time, 1.0)
    motion = np.minimum(0.08 * volts + np.random.default_rng(1).normal(0.0, 0.05, time.size), 60.0)
    study_by_command(tmp_path, text_of(HEADER, time, volts, motion, form=".6g"), "--mass", "45", *PLATFORM)
    said = capsys.readouterr().err
    assert "found a mass of 45 kg, more than friction carries: is its unit right?" in said
    assert "found a drive of 0.02 Hz: is the clock's unit right?" in said
    assert "V, more than stacks bear: is the voltage's unit or scale right?" in said
    assert "samples at exactly the highest of all, one after the other" in said


def test_a_sensor_that_holds_its_output_is_told_with_the_key_that_thins(tmp_path, capsys):
    time = np.arange(-0.002, 0.015, 1e-5)
    motion = 1e6 * fabricated.step_motion(time, 50.0 * 8.5e-8, 9100.0, 0.06)
    motion += 0.008 * np.random.default_rng(7).normal(size=time.size)
    columns = time, np.where(time < 0, 0.0, 50.0), np.repeat(motion[::4], 4)[: time.size]
    study_by_command(tmp_path, text_of(HEADER, *columns, form=".7g"), *PLATFORM)
    said = capsys.readouterr().err
    assert "run.csv: found a new sensor value only every 4 samples" in said
    assert "write held = 4 in its [[record]]" in said


def test_a_platform_alone_under_a_sawtooth_makes_a_study_that_is_read(tmp_path):
    time = np.arange(-0.01, 0.16, 5e-5)
    volts = np.where(time > 0.0, 50.0 * np.mod(20.0 * time, 1.0), 0.0)
    _, motion, _ = scipy.signal.lsim(([0.1 * 5e3**2], [1.0, 2e3, 5e3**2]), volts, time - time[0])
    motion += np.random.default_rng(2).normal(0.0, 0.01, time.size)
    _, study = study_by_command(tmp_path, text_of(HEADER, time, volts, motion, form=".7f"), *PLATFORM)
    assert study.parameters["drive.fall_time"].value == 0.0 and study.parameters["drive.fall_time@run"].free


@pytest.mark.parametrize("lasts", [0.0, 4e-5])
def test_a_flank_behind_an_amplifier_is_told_with_what_describes_it(tmp_path, capsys, lasts):
    time = np.arange(-0.002, 0.015, 1e-5)
    volts = 40.0 * (1.0 - np.exp(-np.maximum(time, 0.0) / lasts)) if lasts else 40.0 * np.clip(time / 8e-5, 0.0, 1.0)
    random = np.random.default_rng(7)
    motion = 1e6 * fabricated.step_motion(time, 4e-6, 5900.0, 0.2) + 0.01 * random.normal(size=time.size)
    study_by_command(tmp_path, text_of(HEADER, time, volts / 20.0, motion, form=".9f"), "--scale", "voltage=20")
    said = capsys.readouterr().err
    assert ('List "amplifier.bandwidth" = {} among the parameters' in said) == bool(lasts)
    assert ('drive = { waveform = "sampled", column = "voltage_V", scale = 20 }' in said) == bool(lasts)
