"""`pdssjax new` of records that are unlike most: steps from a bias, and what no rig does."""

import re

import fabricated
import numpy as np
import pytest
import scipy.signal
from walk_files import study_by_command, text_of

from pdssjax.drive.step import Step

pytestmark = pytest.mark.usefixtures("undrawn")

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
