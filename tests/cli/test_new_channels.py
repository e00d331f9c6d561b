"""`pdssjax new`: which channel is what, in which unit and by which factor, is told, questioned or asked for."""

import pytest
from walk_files import text_of, walk_of

from pdssjax import InputError, load_study
from pdssjax.cli import main as cli
from pdssjax.files import Hints, Told, guess_file
from pdssjax.files.new_study import study_text

pytestmark = pytest.mark.usefixtures("undrawn")

UNITS = {"time": "s", "voltage": "V", "displacement": "um"}


@pytest.mark.parametrize(
    ("volts_per_um", "scale", "told"),
    [
        (200.0, "displacement=5 um/V", ["more than a stack moves", "--unit displacement=mV"]),
        (2e-4, "displacement=5 um/V", ["less than a stack moves"]),
        (0.2, "displacement=5 um/V", []),
    ],
)
def test_a_wrong_scale_of_an_end_effector_is_questioned(tmp_path, capsys, volts_per_um, scale, told):
    (tmp_path / "run.csv").write_text(text_of("t,U_mon,sensor", *walk_of(volts_per_um)))
    options = ["--time", "1", "--voltage", "U_mon", "--displacement", "sensor", "--unit", "time=s", "--mass", "86 g"]
    options += ["--unit", "voltage=V", "--scale", scale]
    assert cli.main(["new", str(tmp_path / "rig"), "--files", str(tmp_path / "run.csv"), *options]) == 0
    errors = capsys.readouterr().err
    assert all(part in errors for part in told) and bool(errors) == bool(told)


def test_a_name_that_ends_in_no_unit_may_have_a_scale(tmp_path):
    time, volts, motion = walk_of(0.2)
    (tmp_path / "run.csv").write_text(text_of("t,U_mon,sensor", time, volts / 20.0, motion))
    hints = Hints(
        {"voltage": "U_mon", "displacement": "sensor"}, {"time": "s"}, {"voltage": 20.0, "displacement": "5 um/V"}
    )
    found = guess_file(tmp_path / "run.csv", hints, Told())
    assert found.guess.waveform.numbers["voltage"] == pytest.approx(60.0, rel=1e-3)


def test_a_command_at_the_piezo_s_place_is_questioned(tmp_path, capsys):
    """20 um/V of a stack behind an amplifier of 20 are no more than 1 um/V of a stage with levers has."""
    time, volts, motion = walk_of(1.0)
    (tmp_path / "run.csv").write_text(text_of("time_s,AO_cmd_V,x_um", time, volts / 20.0, motion))
    files = ["--files", str(tmp_path / "run.csv"), "--mass", "86 g"]
    assert cli.main(["new", str(tmp_path / "rig"), *files]) == 0
    assert "3 V at most, as a monitor or a command of an amplifier has" in capsys.readouterr().err
    assert cli.main(["new", str(tmp_path / "scaled"), *files, "--scale", "voltage=20"]) == 0
    assert capsys.readouterr().err == ""


def test_names_tell_of_channels_without_units_what_shapes_leave_open(tmp_path):
    """A motion that follows the voltage has its waveform, too."""
    time, volts, _ = walk_of(0.2)
    (tmp_path / "run.csv").write_text(text_of("U,t,x", volts, time, 0.1 * volts))
    found = guess_file(tmp_path / "run.csv", Hints({}, UNITS, {}), Told())
    assert {q: channel.number for q, channel in found.roles.channels.items()} == {
        "voltage": 1,
        "time": 2,
        "displacement": 3,
    }
    assert "# guess: time, voltage, displacement told by the samples and names" in study_text(
        [found], Told(), tmp_path, "named"
    )
    (tmp_path / "run.csv").write_text(text_of("ai0,t,ai1", volts, time, 0.1 * volts))
    with pytest.raises(InputError, match=r'several channels that may be the voltage .1: "ai0", 3: "ai1".'):
        guess_file(tmp_path / "run.csv", Hints({}, UNITS, {}), Told())


def test_a_sensor_in_volts_is_told_by_its_scale(tmp_path):
    """Neither a trigger nor a channel that stands still is a motion."""
    time, volts, motion = walk_of(0.2)
    columns = time, volts, 5.0 * (time > 0.1), 0.0 * time + 0.003, motion
    (tmp_path / "run.csv").write_text(text_of("time_s,voltage_V,trigger_V,ai3_V,sensor_V", *columns))
    with pytest.raises(InputError) as asked:
        guess_file(tmp_path / "run.csv", Hints({}, {}, {}), Told())
    assert '(5: "sensor_V" [V])' in str(asked.value) and '--scale "displacement=0.5 um/V"' in str(asked.value)
    with pytest.raises(InputError, match=r'"sensor_V". in "V", expected --scale'):
        guess_file(tmp_path / "run.csv", Hints({"displacement": "sensor_V"}, {}, {}), Told())
    found = guess_file(tmp_path / "run.csv", Hints({}, {}, {"displacement": "5 um/V"}), Told())
    assert found.roles.channels["displacement"].number == 5 and found.roles.channels["voltage"].number == 2


def test_samples_that_are_no_numbers_are_excluded(tmp_path, capsys):
    time, volts, motion = walk_of(0.2)
    lines = text_of("time_s,voltage_V,x_um", time, volts, motion).splitlines()
    for row in (301, 302, 700):
        lines[row] = lines[row].rpartition(",")[0] + ",NaN"
    lines[900] = f"{time[899]:.6f},,{motion[899]:.6f}"
    (tmp_path / "run.csv").write_text("\n".join(lines) + "\n")
    assert cli.main(["new", str(tmp_path / "rig"), "--files", str(tmp_path / "run.csv"), "--mass", "86 g"]) == 0
    assert "found 4 samples that are no numbers; the record excludes them" in capsys.readouterr().err
    (record,) = load_study(tmp_path / "rig" / "study.toml").records
    assert record.measured.size == time.size - 4
    for row in range(100, 500):
        lines[row] = lines[row].rpartition(",")[0] + ",NaN"
    (tmp_path / "run.csv").write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError, match='line 101, column "x_um": found "NaN", expected a finite number'):
        guess_file(tmp_path / "run.csv", Hints({}, {}, {}), Told())


def test_one_file_is_asked_about_once_for_all(tmp_path):
    time, volts, motion = walk_of(0.2)
    trigger = 5.0 * (time > 0.1)
    (tmp_path / "run.csv").write_text(text_of("t,in,platform,slider,out", time, volts, motion, motion[::-1], trigger))
    with pytest.raises(InputError) as asked:
        guess_file(tmp_path / "run.csv", Hints({}, {}, {}), Told())
    for question in ("--voltage", "--displacement", "--unit time=s"):
        assert question in str(asked.value)
    assert str(asked.value).count("run.csv") == 1
