"""Drives at fault are refused with the place, the find and the need; those that are not are read as they stand."""

from pathlib import Path

import numpy as np
import pytest
from study_files import changed, check_refused, csv, write_study

from pdssjax import InputError, initial_guess, load_study
from pdssjax.actuator import ZeroOrderHold

STEP = '{ waveform = "step", voltage = "48.2 V" }'
SAMPLED = '{ waveform = "sampled", column = "voltage_V" }'
WALK = 'waveform = "sawtooth", direction = "backward"'


def record(volts, begin: float = 0.0, interval: float = 5e-5) -> str:
    """A CSV file of a platform that follows the voltages."""
    rows = [f"{begin + k * interval:.6f},{0.1 * u + 1e-3 * k},{u}\n" for k, u in enumerate(volts)]
    return "time_s,displacement_um,voltage_V\n" + "".join(rows)


RAMP = record(np.minimum(np.arange(40) * 2.0, 48.0))


def loaded(tmp_path: Path, drive: str, step: str = RAMP):
    return load_study(write_study(tmp_path, changed(STEP, drive), step=step)).records[0].drive


def periodic(waveform: str, more: str) -> str:
    return f'{{ waveform = "{waveform}", voltage = "9 V", frequency = "1 kHz", {more} }}'


def sampled(more: str) -> str:
    return SAMPLED.replace(" }", f", {more} }}")


# name: (the drive, what the message must contain, the record's file where it is not the ramp)
FAULTS = {
    "column missing": ('{ waveform = "sampled" }', ['record "step": drive', '"column" is missing']),
    "no such column": (SAMPLED.replace("voltage_V", "volts_V"), ["step.csv", '"volts_V"', '"voltage_V"']),
    "column of another dimension": (SAMPLED.replace("voltage_V", "displacement_um"), ['"um"', "converts to V"]),
    "column without a unit": (SAMPLED.replace("voltage_V", "u"), ['"u"', "no unit"], RAMP.replace("voltage_V", "u")),
    "unknown unit": (sampled('unit = "Volltt"'), ['"Volltt"', "V"]),
    "unknown interpolation": (sampled('interpolation = "cubic"'), ['"cubic"', "linear"]),
    "unknown key": (sampled('voltage = "3 V"'), ['"voltage"', 'record "step": drive']),
    "no such file": (sampled('file = "u.csv"'), ["u.csv", "no such file"]),
    "no such clock": (sampled('time = "t_s"'), ['"t_s"', "step.csv"]),
    "no volts": (SAMPLED, ['"voltage_V"', "0 V in all 40 samples"], record([0.0] * 40)),
    "not at rest before": (
        SAMPLED,
        ['"voltage_V", line 2', "30 V at -0.0005 s", "before t = 0"],
        record([30.0] * 20 + [40.0] * 20, -5e-4),
    ),
    "over before": (SAMPLED, ["as the last time", "after t = 0"], record([0.0] * 39 + [9.0], -1.0)),
    "a word among the volts": (SAMPLED, ["line", '"voltage_V"', '"high"'], RAMP.replace("48.0\n", "high\n", 1)),
    "scale that is a table": (sampled("scale = { value = 2 }"), ['"scale"', "a factor such as"]),
    "hold of nothing": (sampled("hold = 0"), ['"hold"', "0 s", "above 0"]),
    "hold in volts": (sampled('hold = "1 V"'), ['"hold"', '"V"']),
    "sampled key for a step": (STEP.replace("}", ', column = "x" }'), ['"column"', 'record "step": drive']),
    "symmetry of one": (periodic("triangle", "symmetry = 1"), ['"symmetry"', "1", "below 1"]),
    "duty beyond one, in per cent": (
        periodic("sawtooth", 'duty = "150 %"'),
        ['"duty"', "found 150 %, expected a value above 0 % and at most 100 %."],
    ),
    "fall beyond what the duty leaves": (
        periodic("sawtooth", 'duty = 0.5, fall_time = "0.6 ms"'),
        ['"fall_time"', "0.0006 s", "slow flank", "0.0005 s"],
    ),
    "rise beyond its plateau": (
        periodic("trapezoid", 'rise_time = "0.5 ms"'),
        ['"rise_time"', "0.0005 s", "rise and plateau", "0.0005 s"],
    ),
    "hold beyond the period": (periodic("sine", 'hold = "1 ms"'), ['"hold"', "0.001 s", "below the period"]),
}


@pytest.mark.parametrize("fault", FAULTS.values(), ids=FAULTS)
def test_drive_at_fault(tmp_path, fault):
    drive, essentials, step = (*fault, RAMP)[:3]
    check_refused(write_study(tmp_path, changed(STEP, drive), step=step), *essentials)


STATIC = (
    changed('"second-order"', '"static"')
    .replace('"piezo.natural_frequency" = {}\n', "")
    .replace('"piezo.damping_ratio" = { start = "20 %" }\n', "")
)


def test_a_static_platform_cannot_carry_an_effector_through_a_jump(tmp_path):
    jumping = changed('"drive.fall_time" = { value = "1 ms" }', "", STATIC)
    with pytest.raises(InputError, match=r'record "walk": drive: found a voltage that jumps, expected a fall or rise'):
        load_study(write_study(tmp_path, jumping))
    held = changed(WALK, WALK + ', hold = "50 us"', STATIC)
    with pytest.raises(InputError, match=r'record "walk": drive: found a voltage that jumps'):
        load_study(write_study(tmp_path, held))


def test_a_static_platform_may_carry_an_effector_that_is_not_shaken_so(tmp_path):
    load_study(write_study(tmp_path, STATIC))
    behind = changed('"drive.fall_time" = { value = "1 ms" }', '"amplifier.bandwidth" = { value = "5 kHz" }', STATIC)
    load_study(write_study(tmp_path, behind))


def test_a_static_platform_feels_no_friction(tmp_path):
    with pytest.raises(InputError, match=r'key "feedback": found true, expected false: no force moves the platform'):
        load_study(write_study(tmp_path, changed("feedback = false", "feedback = true", STATIC)))


def test_voltages_are_read_before_samples_are_left_out(tmp_path):
    text = changed("noise =", 'window = ["1 ms", "1.5 ms"]\nnoise =', changed(STEP, SAMPLED))
    found = load_study(write_study(tmp_path, text, step=RAMP)).records[0]
    assert found.time.size == 11
    np.testing.assert_allclose(found.drive.times, np.arange(40) * 5e-5)
    np.testing.assert_allclose(found.drive.at(np.array([1e-4, 1.25e-4])), [4.0, 5.0])


def test_voltages_before_the_begin_are_left_out(tmp_path):
    drive = loaded(tmp_path, SAMPLED, record([0.0] * 10 + [8.0] * 30, -4.75e-4))
    assert drive.times[0] == 0.0
    np.testing.assert_allclose(drive.at(np.array([-1e-5, 0.0, 1e-5, 1e-3])), [0.0, 4.0, 5.6, 8.0])
    held = loaded(
        tmp_path, SAMPLED.replace("}", ', interpolation = "held" }'), record([0.0] * 10 + [8.0] * 30, -4.75e-4)
    )
    np.testing.assert_allclose(held.at(np.array([-1e-5, 0.0, 2.4e-5, 2.6e-5])), [0.0, 0.0, 0.0, 8.0])


def test_voltages_may_come_from_another_file_in_another_unit(tmp_path):
    (tmp_path / "u.csv").write_text("t_ms;u\n0;0\n1;3000\n2;1000\n")
    drive = loaded(tmp_path, SAMPLED.replace('"voltage_V" }', '"u", file = "u.csv", time = "t_ms", unit = "mV" }'))
    np.testing.assert_allclose(drive.at(np.array([5e-4, 1e-3, 1.5e-3, 9.0])), [1.5, 3.0, 2.0, 1.0])


def test_any_drive_may_be_held_and_still_follows_the_shared_fall_time(tmp_path):
    text = changed(WALK, WALK + ', hold = "50 us"')
    walk = csv(1e-3, 40)
    study = load_study(write_study(tmp_path, changed('"5 Hz"', '"50 Hz"', text), walk=walk))
    drive = study.records[1].drive
    assert isinstance(drive, ZeroOrderHold)
    assert drive.interval == pytest.approx(50e-6)
    group = next(g for g in study.predictor.groups if isinstance(g.runs.drive, ZeroOrderHold))
    assert not bool(group.overrides["fall_time"][0])


@pytest.mark.parametrize("hold", ["", ', hold = "50 us"'])
def test_the_piezo_is_found_from_a_step_that_was_sampled(tmp_path, hold):
    time = np.arange(400) * 5e-5
    w, xi = 6736.0, 0.1772
    ring = w * np.sqrt(1 - xi**2)
    y = 1.0 - np.exp(-xi * w * time) * (np.cos(ring * time) + xi / np.sqrt(1 - xi**2) * np.sin(ring * time))
    rows = [f"{t:.6f},{4.85374 * x:.6f},48.2\n" for t, x in zip(time, y, strict=True)]
    text = changed(
        STEP, SAMPLED.replace("}", hold + " }"), changed('{ start = "0.1 um/V", min = "0.05 um/V", max = 2e-7 }', "{}")
    )
    text = changed('{ start = "20 %" }', "{}", text)
    text = text[: text.index('[[record]]\nname = "walk"')]
    study = load_study(write_study(tmp_path, text, step="time_s,displacement_um,voltage_V\n" + "".join(rows)))
    values = initial_guess(study)
    assert values["piezo.gain"] == pytest.approx(1.007e-7, rel=0.01)
    assert values["piezo.natural_frequency"] == pytest.approx(w, rel=0.1)
    assert values["piezo.damping_ratio"] == pytest.approx(xi, rel=0.1)
    shown = np.asarray(
        study.predict(values | {"piezo.gain": 1.007e-7, "piezo.natural_frequency": w, "piezo.damping_ratio": xi})[0]
    )
    np.testing.assert_allclose(shown, 4.85374e-6 * y, rtol=0.0, atol=1e-11)
