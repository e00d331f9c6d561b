"""What no sample of a voltage shows is left to the fit: how long a fast flank lasts and when it begins."""

import numpy as np
import pytest
import walk_files

from pdssjax.files import RigOptions
from pdssjax.metrics import detect_waveform

DT = 5e-5


def study_of(tmp_path, level, measures, scatter=0.0):
    """The study of a platform that follows a voltage, `level` of the time [s]; `scatter` is its own noise [um]."""
    time = np.arange(-0.005, 0.4, DT)
    volts = level(time)
    moved = 0.1 * volts + scatter * np.random.default_rng(5).normal(size=time.size)
    file = tmp_path / "run@60 V.csv"
    file.write_text(walk_files.text_of("t_s,u_V,x_um", time + 1.0, volts, moved, form=".18e"))
    rig = RigOptions(mass=0.1)
    return walk_files.study_of(tmp_path, walk_files.guessed(tmp_path, file, rig=rig, measures=measures), rig=rig)[1]


@pytest.mark.parametrize("late", [0.1, 0.5, 0.9])
def test_a_step_between_two_samples_may_begin_and_last_as_the_ringing_tells(tmp_path, late):
    begins = late * DT  # after the sample at 0
    study = study_of(tmp_path, lambda t: np.where(t >= begins, 60.0, 0.0), "platform")
    (record,) = study.records
    delay, unsure = study.parameters["sensor.delay@run at 60 V"].measured_apart
    assert abs(1.0 + begins - record.start - delay) < np.sqrt(3.0) * unsure and unsure < 2.0 * DT
    rise, error = study.parameters["drive.rise_time@run at 60 V"].measured_apart
    # As likely anywhere between 0 and 1.6 intervals.
    assert rise == pytest.approx(0.8 * DT) and error == pytest.approx(1.6 * DT / np.sqrt(12.0), rel=1e-2)
    assert not study.parameters["sensor.delay"].free and not study.parameters["drive.rise_time"].free


def test_a_sawtooth_that_falls_between_two_samples_may_take_its_time(tmp_path):
    study = study_of(tmp_path, lambda t: np.where(t >= 0, 60.0 * np.mod(20.0 * t, 1.0), 0.0), "effector")
    fall, error = study.parameters["drive.fall_time@run at 60 V"].measured_apart
    assert fall == pytest.approx(0.8 * DT) and error == pytest.approx(1.6 * DT / np.sqrt(12.0), rel=1e-2)
    assert study.parameters["sensor.delay@run at 60 V"].free and not study.parameters["drive.fall_time"].free


def test_a_flank_that_samples_show_leaves_nothing_open(tmp_path):
    rise = 4 * DT
    study = study_of(tmp_path, lambda t: 60.0 * np.clip(t / rise, 0.0, 1.0), "platform")
    assert not any("@" in path for path in study.parameters)
    (record,) = study.records
    assert float(record.drive.rise_time) == pytest.approx(rise, rel=1e-3)


def test_samples_too_far_apart_for_the_ringing_leave_a_step_as_it_is(tmp_path, monkeypatch):
    monkeypatch.setattr("pdssjax.files.guessed_record._LONGEST_INTERVAL", 0.5 * DT)
    study = study_of(tmp_path, lambda t: np.where(t >= 0, 60.0, 0.0), "platform")
    assert not any("@" in path for path in study.parameters)


def test_what_samples_on_a_flank_tell_is_measured_apart_with_its_error(tmp_path):
    rise, begins, noise = 3.0 * DT, 0.3 * DT, 0.05
    random = np.random.default_rng(3)
    level = lambda t: 60.0 * np.clip((t - begins) / rise, 0.0, 1.0) + noise * random.normal(size=t.size)
    study = study_of(tmp_path, level, "platform")
    found, error = study.parameters["drive.rise_time@run at 60 V"].measured_apart
    # Three samples lie on the slope, whose error is theirs over the root of 2 and their distance.
    assert error == pytest.approx(rise * noise / (np.sqrt(2.0) * DT) / (60.0 / rise), rel=0.05)
    assert abs(found - rise) < 4.0 * error
    (record,) = study.records
    late, unsure = study.parameters["sensor.delay@run at 60 V"].measured_apart
    assert abs(1.0 + begins - record.start - late) < 4.0 * unsure
    assert "drive.rise_time" not in record.overrides and "rise_time" not in record.overrides


@pytest.mark.parametrize(("noise", "told"), [(0.05, True), (1e-5, False)])
def test_a_voltage_is_measured_apart_where_its_noise_counts(tmp_path, noise, told):
    random = np.random.default_rng(4)
    level = lambda t: np.where(t >= 0.2, 60.0, 0.0) + noise * random.normal(size=t.size)
    study = study_of(tmp_path, level, "platform", scatter=1e-3)
    (record,) = study.records
    path = "drive.voltage@run at 60 V"
    assert (path in study.parameters) == told == ("voltage" not in record.overrides)
    assert float(record.drive.voltage) == pytest.approx(60.0, abs=4.0 * noise)
    if told:
        volts, error = study.parameters[path].measured_apart
        # 4000 samples after the step, by their median.
        assert error == pytest.approx(1.25 * noise / np.sqrt(4000.0), rel=0.05)
        assert float(record.drive.voltage) == volts and abs(volts - 60.0) < 4.0 * error
        assert not study.parameters["drive.voltage"].free


@pytest.mark.slow
def test_a_sawtooth_has_the_error_that_its_slow_flanks_leave(tmp_path):
    found = []
    for seed in range(24):
        random = np.random.default_rng(seed)
        time = np.arange(0.0, 0.4, DT)
        volts = 60.0 * np.mod(10.0 * time, 1.0) + 0.05 * random.normal(size=time.size)
        wave = detect_waveform(time, volts)
        whole = wave.numbers["voltage"] / (1.0 - wave.numbers.get("fall_time", 0.0) * wave.numbers["frequency"])
        found.append((whole - 60.0) / wave.voltage_error)
    assert 0.75 < np.sqrt(np.mean(np.square(found))) < 1.3
