"""`pdssjax new`: which channel is what, in which unit and by which factor, is told, questioned or asked for."""

import shutil

import pytest
from walk_files import guessed, study_by_command, study_of, text_of, walk_of

from pdssjax import InputError

pytestmark = pytest.mark.usefixtures("undrawn")

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
