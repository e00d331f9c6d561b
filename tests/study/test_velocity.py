"""A vibrometer's velocity: the rate of the displacement, low-passed and late as the sensor says, and fitted."""

import dataclasses
import json

import measured_study
import numpy as np
import pytest
from marks import slow
from scipy.signal import lsim

import pdssjax
from pdssjax import InputError, load_study
from pdssjax.cli.main import main
from pdssjax.drive.step import Step
from pdssjax.report.figures import record_figure
from pdssjax.study import Samples, compare, make_recordings
from pdssjax.study.measurement.acceleration import Acceleration
from pdssjax.study.measurement.effector import Effector
from pdssjax.study.measurement.platform import Platform
from pdssjax.study.measurement.velocity import Velocity

OF = ("platform", "effector")
SENSOR = '"sensor.bandwidth" = { value = "500 Hz" }\n"sensor.delay" = { value = "0.3 ms" }'
TIMES = np.linspace(-2e-3, 0.025, 27001)
"""Dense enough to differentiate and to filter by."""


def planned(folder, records, **kind):
    file = folder / "study.toml"
    file.write_text(measured_study.study("".join(records), **kind))
    return load_study(file, virtual=True)


def dense(study):
    """The study with its records sampled at `TIMES`."""
    return dataclasses.replace(
        study,
        records=tuple(dataclasses.replace(r, time=TIMES, measured=np.zeros(TIMES.shape)) for r in study.records),
    )


def shown(folder, measurements, **kind):
    """What each of these shows of one walk, at `TIMES`."""
    walks = [measured_study.record(measurement, measured_study.WALK) for measurement in measurements]
    return [np.asarray(values) for values in dense(planned(folder, walks, **kind)).predict()]


# By default the end-effector's is that of test_sensitivities' system, shown by `Velocity.output` as the platform's.
@pytest.mark.parametrize("displacement", [Platform(), slow(Effector())], ids=OF)
def test_the_velocity_is_the_rate_of_the_displacement(tmp_path, displacement):
    moved, speed = shown(tmp_path, [displacement, Velocity(displacement.name)])
    rate = np.gradient(moved, TIMES)
    # Central differences over 2 us; at a reversal or a corner, where the acceleration jumps, they lag by half a step.
    wrong = np.abs(speed - rate)
    assert wrong.max() < 2e-3 * np.ptp(speed)
    assert np.median(wrong) < 1e-5 * np.ptp(speed)
    assert (speed[TIMES < 0] == 0.0).all()


# By default `test_sensors` has the low-pass and the delay.
@pytest.mark.slow
@pytest.mark.parametrize("feedback", [False, True])
def test_a_slow_sensor_shows_the_velocity_low_passed_and_late(tmp_path, feedback):
    seen = [Velocity(of) for of in OF]
    ideal = shown(tmp_path, seen, feedback=feedback)
    late = shown(tmp_path, seen, feedback=feedback, more=SENSOR)
    pole = 2.0 * np.pi * 500.0
    for speed, through in zip(ideal, late, strict=True):
        _, filtered, _ = lsim(([pole], [1.0, pole]), speed, TIMES - TIMES[0])
        expected = np.interp(TIMES - 0.3e-3, TIMES, filtered)
        assert np.ptp(speed - through) > 0.1 * np.ptp(speed)
        np.testing.assert_allclose(through, expected, rtol=0.0, atol=3e-4 * np.ptp(speed))


def test_where_friction_acts_back_both_places_share_one_compiled_function(tmp_path):
    seen = [Platform(), Velocity("platform"), Effector(), Velocity("effector")]
    walks = [measured_study.record(measurement, measured_study.WALK) for measurement in seen]
    groups = planned(tmp_path, walks, feedback=True).predictor.groups
    assert [group.places for group in groups] == [(0, 2), (1, 3)]
    alone = planned(tmp_path, walks).predictor.groups
    assert [group.places for group in alone] == [(0,), (1,), (2,), (3,)]


def text(records, starts=True, moving=("piezo",)):
    """A study of these records, with the parameters of what is `moving` only."""
    whole = measured_study.study("".join(records), starts=starts)
    return "\n".join(line for line in whole.splitlines() if not line.startswith('"') or line[1:].startswith(moving))


def identified(folder, records, **kind):
    """What the command line records on a virtual rig and identifies from no starts; the truth; the report."""
    plan = folder / "plan.toml"
    plan.write_text(text(records, **kind))
    assert main(["record", str(plan), "--out", str(folder / "rig"), "--seed", "4"]) == 0
    study = folder / "rig" / "records" / "plan.toml"
    study.write_text(text(records, starts=False, **kind))
    assert main(["identify", str(study), "--out", str(folder / "found")]) == 0
    estimate = json.loads((folder / "found" / "estimate.json").read_text())
    return estimate, load_study(plan, virtual=True).values(), (folder / "found" / "report.txt").read_text()


def within_errors(estimate, true):
    assert estimate["converged"]
    for path, found in estimate["parameters"].items():
        if found["free"]:
            assert 0.0 < found["standard_error"] < 0.2 * found["value"], path
            assert abs(found["value"] - true[path]) < 3.5 * found["standard_error"], path


def test_the_platform_is_identified_from_its_velocity_after_a_step_alone(undrawn, tmp_path):
    estimate, true, report = identified(tmp_path, [measured_study.record(Velocity("platform"))])
    within_errors(estimate, true)
    assert [path for path, p in estimate["parameters"].items() if p["free"]] == list(true)
    assert [record["measures"] for record in estimate["records"]] == ["velocity"]
    assert "velocities in mm/s" in report
    (predictions,) = (tmp_path / "found" / "predictions").iterdir()
    assert predictions.read_text().splitlines()[0] == "time_s,measured_mm/s,predicted_mm/s,residual_mm/s,voltage_V"


@pytest.mark.slow
def test_piezo_and_friction_are_identified_from_velocities_alone(undrawn, tmp_path):
    records = [measured_study.record(Velocity(of)) for of in OF]
    estimate, true, _ = identified(tmp_path, records, moving=("piezo", "friction", "effector"))
    within_errors(estimate, true)
    assert sum(p["free"] for p in estimate["parameters"].values()) == 6


def test_what_a_step_shows_of_the_platform_is_told_before_any_fit(tmp_path):
    plan = tmp_path / "plan.toml"
    plan.write_text(text([measured_study.record(Velocity("platform"))]))
    study = load_study(plan, virtual=True)
    true = study.values()
    records = tuple(recording.record for recording in make_recordings(study, 2))
    startless = study.with_starts(dict.fromkeys(study.parameters))
    guessed = pdssjax.initial_guess(dataclasses.replace(startless, records=records))
    for path, number in guessed.items():
        assert number == pytest.approx(true[path], rel=0.1), path


def samples(voltage, offset, before=0):
    """What a vibrometer with a zero of 0.1 m/s shows of a thing that goes as the voltage does, 2 m a volt."""
    time = 1e-3 * (np.arange(voltage.size) - before)
    return Samples(time, 2.0 * np.gradient(voltage, time) + 0.1, voltage, offset)


RAMP = np.concatenate([np.zeros(20), np.linspace(0.0, 1.0, 100)])
STEP = np.concatenate([np.linspace(0.0, 1.0, 60), np.ones(60)])


@pytest.mark.parametrize("of", OF)
@pytest.mark.parametrize(
    "shown", [samples(RAMP, 0.1), samples(RAMP, None, before=15), samples(STEP, None)], ids=["given", "before", "late"]
)
def test_the_zero_is_given_or_seen_where_nothing_moves(of, shown):
    moved = Velocity(of).displacement(shown)
    np.testing.assert_allclose(moved, 2.0 * shown.voltage, atol=0.02)


def test_where_no_zero_is_seen_only_the_platform_is_taken_to_come_back():
    swings = samples(1.0 - np.cos(2.0 * np.pi * np.arange(201) / 100.0), None)
    assert Velocity("effector").displacement(swings) is None
    np.testing.assert_allclose(Velocity("platform").displacement(swings), 2.0 * swings.voltage, atol=0.02)


def test_the_figure_has_the_unit_and_the_name_of_what_is_shown(tmp_path):
    plan = tmp_path / "plan.toml"
    plan.write_text(text([measured_study.record(Velocity("platform"))]))
    (made,) = make_recordings(load_study(plan, virtual=True))
    figure = record_figure(compare(made.record, made.true, noise=5e-6, offset=made.offset))
    assert figure.axes[0].get_ylabel() == "velocity (mm/s)"
    drawn = figure.axes[0].lines[0].get_ydata()
    np.testing.assert_allclose(drawn, 1e3 * made.record.measured)


CHANGED = {
    "another thing": ('of = "platform"', 'of = "stage"', ['key "of"', '"stage"', '"platform"']),
    "a key of velocities alone": (
        'measures = "velocity"',
        'measures = "platform"',
        ["unknown key", '"of"'],
    ),
    "a misspelt key": ('of = "platform"', 'off = "platform"', ['"off"', 'did you mean "of"']),
    "noise of a length": ('"5 um/s"', '"5 um"', ['key "noise"', "m/s"]),
    "no such column": ('velocity = "', 'displacement = "', ["columns", '"displacement"', '"velocity"']),
}


@pytest.mark.parametrize(("old", "new", "essentials"), CHANGED.values(), ids=CHANGED)
def test_a_record_at_fault_is_refused(tmp_path, old, new, essentials):
    whole = text([measured_study.record(Velocity("platform"))])
    assert old in whole
    (tmp_path / "study.toml").write_text(whole.replace(old, new))
    with pytest.raises(InputError) as refused:
        load_study(tmp_path / "study.toml", virtual=True)
    for essential in ["study.toml", 'record "velocity-platform"', *essentials]:
        assert essential in str(refused.value)


def test_a_column_in_another_unit_is_refused_by_its_file(tmp_path):
    (tmp_path / "study.toml").write_text(
        text([measured_study.record(Velocity("platform"))]).replace("velocity_m/s", "v_um")
    )
    (tmp_path / "velocity-platform.csv").write_text("time_s,v_um\n0,1\n1e-4,2\n")
    with pytest.raises(
        InputError, match=r'velocity-platform\.csv: column "v_um": found the unit "um", expected a unit that'
    ):
        load_study(tmp_path / "study.toml")


STATIC = (
    text([measured_study.record(Velocity("platform"))])
    .replace("second-order", "static")
    .replace('"piezo.natural', '# "piezo.natural')
    .replace('"piezo.damping', '# "piezo.damping')
)


def test_a_platform_that_jumps_has_no_velocity_to_show(tmp_path):
    file = tmp_path / "study.toml"
    file.write_text(STATIC)
    expected = (
        r'study\.toml: record "velocity-platform": drive: found a voltage that jumps, .* its velocity has no bound'
    )
    with pytest.raises(InputError, match=expected):
        load_study(file, virtual=True)


def test_a_platform_that_follows_the_voltage_at_once_is_as_fast_as_that_rises(tmp_path):
    file = tmp_path / "study.toml"
    file.write_text(STATIC.replace('waveform = "step"', 'waveform = "step", rise_time = "10 ms"'))
    study = load_study(file, virtual=True)
    (speed,) = study.predict()
    assert isinstance(study.records[0].drive, Step)
    expected = np.where((study.records[0].time < 0.01 - 1e-9), 1e-7 * 60.0 / 0.01, 0.0)
    np.testing.assert_allclose(speed, expected, rtol=1e-12, atol=1e-18)


RINGS = {"sticks": True, "drive": measured_study.SLOW_FALL}
"""A contact that sticks for good while the platform rings."""
KINDS = [
    pytest.param("platform", {}, id="platform"),
    pytest.param("effector", RINGS, id="sticks while it rings", marks=pytest.mark.slow),
    pytest.param("effector", {}, id="effector", marks=pytest.mark.slow),
    pytest.param("effector", {"more": SENSOR}, id="effector, slow sensor", marks=pytest.mark.slow),
    pytest.param("platform", {"more": SENSOR}, id="platform, slow sensor", marks=pytest.mark.slow),
    pytest.param("effector", {"feedback": True}, id="effector, feedback", marks=pytest.mark.slow),
    pytest.param("platform", {"feedback": True}, id="platform, feedback", marks=pytest.mark.slow),
]


def accelerations(folder, measurements, drive=measured_study.WALK, **kind):
    """What each of these shows of one walk, at `TIMES`."""
    records = "".join(measured_study.record(measurement, drive) for measurement in measurements)
    (folder / "study.toml").write_text(measured_study.study(records, **kind))
    study = load_study(folder / "study.toml", virtual=True)
    dense = [dataclasses.replace(r, time=TIMES, measured=np.zeros(TIMES.shape)) for r in study.records]
    return [np.asarray(values) for values in dataclasses.replace(study, records=tuple(dense)).predict()]


@pytest.mark.parametrize(("of", "kind"), KINDS)
def test_the_acceleration_is_the_rate_of_the_velocity(tmp_path, of, kind):
    velocity, acceleration = accelerations(tmp_path, [Velocity(of), Acceleration(of)], **kind)
    # Central differences over 2 us; where the contact switches the acceleration jumps between two samples.
    wrong = np.abs(acceleration - np.gradient(velocity, TIMES))
    assert np.mean(wrong > 2e-3 * np.ptp(acceleration)) < 2e-3
    assert np.median(wrong) < 2e-5 * np.ptp(acceleration)
    assert (acceleration[TIMES < 0] == 0.0).all()


WITHOUT_INERTIA = ("second-order", "static"), ('"piezo.natural_frequency"', "#"), ('"piezo.damping_ratio"', "#")
SINE = 'drive = { waveform = "sine", voltage = "60 V", frequency = "100 Hz" }'
AMPLIFIER = '"amplifier.bandwidth" = { value = "5 kHz" }'


def load_static(folder, drive, more=""):
    text = measured_study.study(measured_study.record(Acceleration("platform"), drive), more=more)
    for old, new in WITHOUT_INERTIA:
        text = text.replace(old, new)
    (folder / "study.toml").write_text(text)
    return load_study(folder / "study.toml", virtual=True)


def test_a_platform_without_inertia_has_no_acceleration_at_a_corner(tmp_path):
    with pytest.raises(InputError, match=r"drive: found a voltage with corners, expected a smooth one or an amplifier"):
        load_static(tmp_path, measured_study.SLOW_FALL)
    with pytest.raises(InputError, match=r"found a voltage with jumps, expected a fall or rise time above 0"):
        load_static(tmp_path, measured_study.WALK, AMPLIFIER)
    load_static(tmp_path, SINE)
    load_static(tmp_path, measured_study.SLOW_FALL, AMPLIFIER)
