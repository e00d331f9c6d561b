"""An accelerometer's signal: the rate of the velocity shown, also of a platform that rings on below a stuck contact."""

import dataclasses

import measured_study
import numpy as np
import pytest

from pdssjax import InputError, load_study
from pdssjax.study.measurement.acceleration import Acceleration
from pdssjax.study.measurement.velocity import Velocity

TIMES = np.linspace(-2e-3, 0.025, 27001)
SENSOR = '"sensor.bandwidth" = { value = "500 Hz" }\n"sensor.delay" = { value = "0.3 ms" }'
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


def shown(folder, measurements, drive=measured_study.WALK, **kind):
    """What each of these shows of one walk, at `TIMES`."""
    records = "".join(measured_study.record(measurement, drive) for measurement in measurements)
    (folder / "study.toml").write_text(measured_study.study(records, **kind))
    study = load_study(folder / "study.toml", virtual=True)
    dense = [dataclasses.replace(r, time=TIMES, measured=np.zeros(TIMES.shape)) for r in study.records]
    return [np.asarray(values) for values in dataclasses.replace(study, records=tuple(dense)).predict()]


@pytest.mark.parametrize(("of", "kind"), KINDS)
def test_the_acceleration_is_the_rate_of_the_velocity(tmp_path, of, kind):
    velocity, acceleration = shown(tmp_path, [Velocity(of), Acceleration(of)], **kind)
    # Central differences over 2 us; where the contact switches the acceleration jumps between two samples.
    wrong = np.abs(acceleration - np.gradient(velocity, TIMES))
    assert np.mean(wrong > 2e-3 * np.ptp(acceleration)) < 2e-3
    assert np.median(wrong) < 2e-5 * np.ptp(acceleration)
    assert (acceleration[TIMES < 0] == 0.0).all()


STATIC = ("second-order", "static"), ('"piezo.natural_frequency"', "#"), ('"piezo.damping_ratio"', "#")
SINE = 'drive = { waveform = "sine", voltage = "60 V", frequency = "100 Hz" }'
AMPLIFIER = '"amplifier.bandwidth" = { value = "5 kHz" }'


def load_static(folder, drive, more=""):
    text = measured_study.study(measured_study.record(Acceleration("platform"), drive), more=more)
    for old, new in STATIC:
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
