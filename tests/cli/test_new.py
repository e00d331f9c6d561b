"""`pdssjax new`: from files of any lab to a study that loads, with the right drives and clocks, or a question."""

import shutil
import tomllib
from pathlib import Path

import fastjsonschema
import instrument_files
import numpy as np
import pytest
from walk_files import detected_once as detected_once, guessed, study_of, text_of

from pdssjax import InputError, load_study
from pdssjax.cli import main as cli
from pdssjax.drive.sampled import Sampled
from pdssjax.files import EXAMPLE, RigOptions
from pdssjax.files.study_schema import study_schema

pytestmark = pytest.mark.usefixtures("undrawn", "detected_once")
LIU = Path(__file__).parents[2] / "experiments" / "liu2015"
RIG = {
    "sawtooth_5Hz_A": ("sawtooth", "forward", 64.2, 5.0),
    "sawtooth_5Hz_B": ("sawtooth", "backward", 64.2, 5.0),
    "step_48p2V": ("step", "", 48.2, None),
    "step_75p4V": ("step", "", 75.4, None),
    "validation_20Hz_A": ("sawtooth", "forward", 64.2, 20.0),
    "validation_20Hz_B": ("sawtooth", "backward", 64.2, 20.0),
}
"""Of the packaged records: waveform, direction, voltage and frequency."""
UNITS = {"time": "s", "voltage": "V", "displacement": "um"}


def table_of(name):
    """Time [s], voltage [V] and displacement [um] of a packaged record."""
    return np.loadtxt(EXAMPLE / f"{name}.csv", delimiter=",", skiprows=1)


def without_header(file, name, order=(0, 1, 2)):
    file.write_text(text_of("", *table_of(name)[:, order].T).lstrip())
    return {}, UNITS


def in_another_order(file, name):
    return without_header(file, name, (2, 0, 1))


def with_a_row_of_units(file, name):
    rows = "".join(f"{x:.6f};{t:.6f};{u:.6f}\n" for t, u, x in table_of(name)).replace(".", ",")
    file.write_text(f"Weg;Zeit;Spannung\nµm;s;V\n{rows}", encoding="cp1252")
    return {}, {}


def as_an_oscilloscope(file, name):
    """No times but an interval, the sensor's amplifier in volts, and a clock that is late by 0.0123 s."""
    rows = "".join(f"{k},{u:.6f},{x / 2.0:.6f},,\n" for k, (_, u, x) in enumerate(table_of(name)))
    time = table_of(name)[:, 0]
    head = f"X,CH1,CH2,Start,Increment,\nSequence,Volt,Volt,{time[0] + 0.0123:.6f},{time[1] - time[0]:.6e}\n"
    file.write_text(head + rows)
    return {"voltage": "CH1", "displacement": "CH2"}, {}


def upside_down(file, name):
    time, volts, motion = table_of(name).T
    file.write_text(text_of("t_s,u_V,x_um", time, volts, -motion))
    return {}, {}


WAYS = [without_header, in_another_order, with_a_row_of_units, as_an_oscilloscope, upside_down]
QUICK = {(without_header, name) for name in ("sawtooth_5Hz_B", "step_48p2V")}
WRITTEN = [
    pytest.param(
        *(way, name),
        id=f"{way.__name__}-{name}",
        # Every way of one record, and one of each waveform and direction in one way.
        marks=()
        if (name == "sawtooth_5Hz_A" and way is not without_header) or (way, name) in QUICK
        else pytest.mark.slow,
    )
    for way in WAYS
    for name in RIG
]


@pytest.mark.parametrize(("way", "name"), WRITTEN)
def test_the_rigs_records_are_told_however_they_are_written(tmp_path, way, name):
    file = tmp_path / "run.csv"
    columns, units = way(file, name)
    scales = {"displacement": "2 um/V"} if way is as_an_oscilloscope else {}
    found = guessed(tmp_path, file, columns, units, scales)
    guess, (waveform, direction, voltage, frequency) = found.guess, RIG[name]
    assert (guess.waveform.name, guess.waveform.direction) == (waveform, direction)
    assert guess.measures == ("platform" if waveform == "step" else "effector")
    assert guess.turned == (way is upside_down)
    assert guess.waveform.numbers["voltage"] == pytest.approx(voltage, rel=0.01)
    time, _, motion = table_of(name).T
    late = guess.start - (0.0123 if way is as_an_oscilloscope else 0.0)
    if frequency is not None:
        assert guess.waveform.numbers["frequency"] == pytest.approx(frequency, rel=1e-3)
        late -= round(late * frequency) / frequency
    assert abs(late) <= 1.01 * (time[1] - time[0])
    assert guess.noise == pytest.approx(0.0108e-6, rel=0.1)
    assert guess.resolution == pytest.approx(0.01e-6, rel=1e-3)
    np.testing.assert_allclose(guess.motion, 1e-6 * motion, atol=2e-12)
    text, study = study_of(tmp_path, found, rig=RigOptions(mass=0.086))
    (record,) = study.records
    np.testing.assert_allclose(record.measured, 1e-6 * motion, atol=2e-12)
    delay = study.parameters.get("sensor.delay@run")
    begun = guess.start - (0.0 if delay is None else delay.start)
    np.testing.assert_allclose(record.time, guess.time - begun, atol=1e-8)
    guesses = [
        line for line in text.splitlines() if line.startswith(("piezo =", "friction =", "measures", "noise", "drive ="))
    ]
    assert len(guesses) == 5 and all("# guess: " in line for line in guesses)


@pytest.mark.filterwarnings("ignore:.*at least one period:pdssjax.core.errors.InputWarning")
def test_a_record_without_a_voltage_is_told_by_its_slips(tmp_path):
    columns = {"displacement": "end_effector_displacement_um", "voltage": "none"}
    rig = RigOptions(peak=30.0, mass=0.1)
    found = guessed(tmp_path, LIU / "endeffector_3to5s_500Hz.csv", columns, rig=rig)
    wave = found.guess.waveform
    assert (wave.name, wave.direction, wave.begins) == ("sawtooth", "forward", "clock")
    assert wave.numbers == {"voltage": 30.0, "frequency": pytest.approx(5.0, rel=1e-3)}
    assert found.guess.start == 0.0
    once = RigOptions(peak=30.0, frequency=5.0)
    alone = guessed(tmp_path, LIU / "fig22_slip_event_1kHz.csv", columns, rig=once)
    assert (alone.guess.waveform.direction, alone.guess.start) == ("forward", 0.0)
    _, study = study_of(tmp_path, found, alone, rig=rig)
    assert study.parameters["drive.fall_time"].free and len(study.records) == 2


def hysteresis(cycles=12, sets_in=False, noise=0.0):
    """The file of a platform that follows a 1 Hz sine in loops, with creep, at 200 Hz; unless it `sets_in` it runs."""
    time = 0.005 * np.arange(200 * cycles)
    volts = 1.8 + 1.8 * np.sin(2 * np.pi * time)
    play, center = np.zeros(time.size), 1.2
    for k, voltage in enumerate(volts):
        center = float(np.clip(center, voltage - 0.6, voltage + 0.6))
        play[k] = center
    motion = 20.0 * volts + 15.0 * play + 2.0 * np.log1p(time) + 0.03 * np.random.default_rng(2).normal(size=time.size)
    if sets_in:
        motion = motion * (1.0 - np.exp(-time / 0.02))
    volts += noise * np.random.default_rng(3).normal(size=time.size)
    return text_of("# time_s,voltage_V,x_um", time, volts, motion - 120.0)


@pytest.mark.parametrize("hertz, interval", [(950.0, 2e-4), (190.0, 1e-3)])
def test_loops_with_ringing_have_both_and_a_delay(tmp_path, hertz, interval):
    """A sine switched on in mid-cycle: the platform rings there and makes loops for the rest of the record."""
    time = np.arange(0.0, 3.0, interval)
    late = np.clip(time - 0.5, 0.0, None)
    volts = np.where(time < 0.5, 0.0, 150.0 * np.sin(2 * np.pi * late - 0.65))
    play, center = np.zeros(time.size), 0.0
    for k, voltage in enumerate(volts):
        center = float(np.clip(center, voltage - 60.0, voltage + 60.0))
        play[k] = center
    rings = np.where(time < 0.5, 0.0, 10.0 * np.cos(2 * np.pi * hertz * late) * np.exp(-late * 0.3 * hertz))
    motion = 0.115 * volts + 0.018 * play + rings + 0.045 * np.random.default_rng(1).normal(size=time.size)
    rows = text_of("time_s,voltage_V,x_um", time, volts, motion, form=".7g")
    text, loaded = study_of(tmp_path, guessed(tmp_path, rows))
    assert 'piezo = { dynamics = "second-order", hysteresis = { law = "play"' in text
    free = {path for path, parameter in loaded.parameters.items() if parameter.free}
    assert free >= {"piezo.natural_frequency", "piezo.damping_ratio", "piezo.play_4", "sensor.delay"}
    assert loaded.parameters["sensor.delay"].bounds() == pytest.approx((0.0, 2.0 * interval))


def test_a_platform_with_hysteresis_is_told_from_an_end_effector(tmp_path):
    found = guessed(tmp_path, hysteresis())
    wave = found.guess.waveform
    assert (wave.name, found.guess.measures) == ("sine", "platform")
    assert wave.begins == "running"
    assert wave.numbers == {"voltage": pytest.approx(3.6, rel=1e-2), "frequency": pytest.approx(1.0, rel=1e-3)}
    assert found.guess.start % 1.0 == pytest.approx(0.75, abs=0.005) and found.guess.start < 0.0
    text, study = study_of(tmp_path, found)
    assert 'piezo = { dynamics = "first-order", hysteresis = ' in text and '"piezo.play_*" = {}' in text
    assert "friction." not in text and "effector." not in text
    (record,) = study.records
    assert record.measures == "platform"
    # Straight lines between the samples are quick to compute; the sine that ran before is repeated.
    assert "conditioning = { cycles = 2" in text and isinstance(record.drive, Sampled)
    np.testing.assert_allclose(np.asarray(record.drive.at(record.time)), found.guess.volts, atol=1e-9)
    np.testing.assert_allclose(record.time - record.time[0], found.guess.time - found.guess.time[0], atol=1e-9)
    assert record.time[0] == pytest.approx(2.0)


@pytest.mark.parametrize(("noise", "smoothed"), [(0.0, False), (0.03, True)])
def test_a_noisy_voltage_under_hysteresis_is_smoothed(tmp_path, noise, smoothed):
    text, study = study_of(tmp_path, guessed(tmp_path, hysteresis(noise=noise)))
    assert ('smooth = "10 ms"' in text) == smoothed
    (record,) = study.records
    left = np.asarray(record.drive.at(record.time)) - 1.8 - 1.8 * np.sin(2 * np.pi * record.time)
    assert np.std(left[200:-200]) < max(0.45 * noise, 1e-6)


def test_a_sine_that_sets_in_with_the_record_has_a_phase(tmp_path):
    found = guessed(tmp_path, hysteresis(sets_in=True))
    wave = found.guess.waveform
    assert (wave.name, wave.begins, found.guess.start) == ("sine", "motion", 0.0)
    assert wave.numbers["phase"] == pytest.approx(np.pi / 2, abs=1e-3)
    (record,) = study_of(tmp_path, found)[1].records
    np.testing.assert_allclose(np.asarray(record.drive.at(record.time)), found.guess.volts, atol=1e-4)


def test_a_voltage_that_no_waveform_explains_is_the_drive_itself(tmp_path):
    time = 1e-4 * np.arange(4000)
    volts = np.where(time < 0.01, 0.0, 20.0 * np.sin(300 * (time - 0.01)) ** 2 * (1.0 + np.sin(77 * time)))
    motion = 0.1 * volts + 0.01 * np.random.default_rng(5).normal(size=time.size)
    found = guessed(tmp_path, text_of("t_s,u_V,x_um", time, volts, motion, form=".18e"))
    assert found.guess.waveform.name == "sampled" and found.guess.start == pytest.approx(0.01, abs=1e-3)
    (record,) = study_of(tmp_path, found)[1].records
    shown = np.asarray(record.drive.at(record.time[200:]))
    np.testing.assert_allclose(shown, volts[200:], atol=1e-9)


ALIKE = "time_s,a_V,b_V,x_um\n" + "".join(f"{k}e-4,{k % 40},{k % 40},{k % 7}\n" for k in range(400))
BARE = "".join(f"{k * 1e-4:.4f},{k % 40},{(k % 40) ** 1.5:.3f}\n" for k in range(400))
TIME = 1e-4 * np.arange(4000)
RINGS = 50.0 * np.mod(10.0 * TIME, 1.0)
RINGING = 0.1 * RINGS - 5.0 * np.exp(-20.0 * np.mod(TIME, 0.1)) * np.cos(600.0 * np.mod(TIME, 0.1))


def test_what_is_measured_is_told_of_some_files(tmp_path, capsys):
    for name in ("stood_a", "stood_b", "rang"):
        (tmp_path / f"{name}.csv").write_text(text_of("time_s,voltage_V,x_um", TIME, RINGS, RINGING))
    files = [str(tmp_path / f"{name}.csv") for name in ("stood_a", "stood_b", "rang")]
    command = ["new", str(tmp_path / "rig"), "--mass", "86 g", "--files", *files]
    for text, essentials in {
        "stod*=effector": ['found "stod*"', "stood_a.csv, stood_b.csv, rang.csv"],
        "rang.csv=stage": ['found "rang.csv=stage"', '"platform" or "effector"', "step*.csv=platform"],
    }.items():
        assert cli.main([*command, "--measures", text]) == 2
        told = capsys.readouterr().err
        assert told.count("\n") == 1 and all(essential in told for essential in essentials)
    assert cli.main([*command, "--measures", "rang.csv=platform"]) == 2
    told = capsys.readouterr().err
    assert "stood_a.csv" in told and "stood_b.csv" in told and "rang.csv" not in told
    # What is said of a file goes before what is said of all, whatever comes first.
    for options in (["stood_?.csv=effector", f"{files[2]}=platform"], [f"{files[2]}=platform", "effector"]):
        options = [word for option in options for word in ("--measures", option)]
        assert cli.main([*command, *options]) == 0
        text = (tmp_path / "rig" / "study.toml").read_text()
        seen = {record["name"]: record["measures"] for record in tomllib.loads(text)["record"]}
        assert seen == {"stood_a": "effector", "stood_b": "effector", "rang": "platform"}
        assert 'measures = "platform"\n' in text and 'measures = "effector"\n' in text  # no guesses
        shutil.rmtree(tmp_path / "rig")


QUESTIONS = {
    "a command and its monitor": (
        text_of("time_s,voltage_V,monitor_V,x_um", TIME, RINGS / 20.0, RINGS, RINGING),
        ['2: "voltage_V" [V], 3: "monitor_V" [V]', "expected --voltage"],
    ),
    "a platform that rings, or an end-effector that stands": (
        text_of("time_s,voltage_V,x_um", TIME, RINGS, RINGING),
        ["(sawtooth)", "--measures"],
    ),
    "two voltages": (ALIKE, ['2: "a_V" [V], 3: "b_V" [V]', "expected --voltage"]),
    "no units": (BARE, ["found no unit of the time in channel 1", "--unit time=s", "--unit voltage=V"]),
    "no voltage": ("time_s,x_um\n" + BARE, ["--peak"], "none"),
    "no clock": ("u_V,x_um\n" + "\n".join(f"{k % 40},{k % 7}" for k in range(400)), ["--time", "--interval"]),
    "no motion": ("time_s,u_V\n" + "\n".join(f"{k}e-4,{k % 40}" for k in range(400)), ["--displacement"]),
    "a voltage that never moves": (
        "time_s,u_V,x_um\n" + "\n".join(f"{k}e-4,3,{k % 7}" for k in range(99)),
        ["3 V in all"],
    ),
    "few samples": ("time_s,u_V,x_um\n0,1,2\n1,2,3\n", ["2 samples"]),
    "a wrong name": (ALIKE, ['"c_V"', "did you mean"], "c_V"),
    "neither platform nor effector": (
        text_of("time_s,u_V,x_um", TIME[:900], 5 - 5 * np.cos(500 * TIME[:900]), np.sin(3100 * TIME[:900])),
        ["(sine) explains 0 %", "--measures"],
    ),
}


@pytest.mark.parametrize("question", QUESTIONS.values(), ids=QUESTIONS)
def test_what_is_not_clear_is_asked_for(tmp_path, question):
    text, essentials, *voltage = question
    with pytest.raises(InputError) as asked:
        guessed(tmp_path, text, dict(zip(["voltage"], voltage, strict=False)))
    assert "\n" not in str(asked.value)
    for essential in [str(tmp_path / "run.csv"), *essentials]:
        assert essential in str(asked.value)


@pytest.mark.parametrize("name", instrument_files.FORMATS)
def test_a_step_is_told_in_every_format(tmp_path, name):
    ending, write = instrument_files.FORMATS[name]
    write(tmp_path / f"step{ending}")
    bare = name in ("MATLAB 4", "MATLAB 5", "MATLAB 7.3")
    if bare:
        with pytest.raises(
            InputError, match=r"found no unit of the time in channel 1 \(.t.\), the voltage in channel 2"
        ):
            guessed(tmp_path, tmp_path / f"step{ending}", {"voltage": "u", "displacement": "x"})
    columns = {"voltage": "u", "displacement": "x"} if bare else {}
    found = guessed(tmp_path, tmp_path / f"step{ending}", columns, UNITS if bare else {})
    assert (found.guess.waveform.name, found.guess.measures, found.guess.start) == ("step", "platform", 0.0)
    assert found.guess.waveform.numbers["voltage"] == pytest.approx(48.2)


def test_the_command_makes_a_study_with_figures(tmp_path, capsys):
    out = tmp_path / "rig"
    files = [str(EXAMPLE / f"{name}.csv") for name in ("sawtooth_5Hz_A", "step_48p2V")]
    assert cli.main(["new", str(out), "--files", *files]) == 0
    printed = capsys.readouterr()
    assert f"pdssjax identify {out / 'study.toml'}" in printed.out and "by the clock" in printed.out
    assert "the mass of the end-effector is a guess" in printed.err
    assert sorted(path.name for path in (out / "check").iterdir()) == ["sawtooth_5Hz_A.png", "step_48p2V.png"]
    assert [record.role for record in load_study(out / "study.toml").records] == ["fit", "fit"]
    fastjsonschema.compile(study_schema())(tomllib.loads((out / "study.toml").read_text(encoding="utf-8")))
    assert cli.main(["new", str(out), "--files", *files]) == 2
    assert "found something there already" in capsys.readouterr().err


def test_what_should_not_be_overlooked_is_said(tmp_path, capsys, monkeypatch):
    (tmp_path / "loops.csv").write_text(hysteresis(cycles=3))
    monkeypatch.setattr("pdssjax.cli.new._MANY_SAMPLES", 500)
    assert cli.main(["new", str(tmp_path / "rig"), "--files", str(tmp_path / "loops.csv")]) == 0
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2 and "600 samples make a slow fit" in lines[0]
    assert "um/V, more than a stack moves" in lines[1] and "--scale voltage=20" in lines[1]


def test_the_command_asks_all_its_questions_at_once_and_writes_nothing(tmp_path, capsys):
    (tmp_path / "bare.csv").write_text(BARE)
    (tmp_path / "short.csv").write_text(QUESTIONS["few samples"][0])
    files = [str(tmp_path / name) for name in ("bare.csv", "short.csv", "none.csv")]
    assert cli.main(["new", str(tmp_path / "rig"), "--files", *files]) == 2
    errors = capsys.readouterr().err.splitlines()
    assert len(errors) == 3 and all(line.startswith("pdssjax: error: ") for line in errors)
    assert not (tmp_path / "rig").exists()
