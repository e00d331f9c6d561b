"""What a drive did before t = 0, and the noise of a voltage that was measured."""

import dataclasses

import numpy as np
import pytest
from study_files import changed, csv, write_study

import pdssjax
from pdssjax import InputError
from pdssjax.metrics import smoothed

SAMPLED = 'drive = { waveform = "sampled", column = "u_V" }'
STEP = 'drive = { waveform = "step", voltage = "48.2 V" }'


def sampled(folder, keys="", more="", volts=None):
    """A study whose platform record has a sampled drive of 10 Hz, with `keys` of the record and `more` of its drive."""
    time = np.arange(41) * 5e-3
    volts = 20.0 + 10.0 * np.sin(2 * np.pi * 10.0 * time) if volts is None else volts
    rows = "".join(f"{t:.6f},{v:.6f},{0.1 * v:.6f}\n" for t, v in zip(time, volts, strict=True))
    drive = SAMPLED.replace(" }", f", {more} }}") if more else SAMPLED
    text = changed(STEP, f"{keys}\n{drive}")
    return write_study(folder, text, step="time_s,u_V,displacement_um\n" + rows), volts


def test_cycles_of_samples_are_run_before_the_record(tmp_path):
    path, volts = sampled(tmp_path, 'conditioning = { cycles = 3, period = "0.1 s" }')
    record = pdssjax.load_study(path).records[0]
    assert record.time[0] == pytest.approx(0.3)
    np.testing.assert_allclose(record.drive.at(record.time), volts, atol=1e-6)
    for earlier in (0.1, 0.2, 0.3):
        np.testing.assert_allclose(record.drive.at(record.time[:20] - earlier), volts[:20], atol=1e-6)


def test_a_voltage_is_held_before_the_record(tmp_path):
    path, volts = sampled(tmp_path, 'conditioning = "60 s"')
    record = pdssjax.load_study(path).records[0]
    assert record.time[0] == pytest.approx(60.0)
    assert record.drive.at(np.array([1.0, 59.0])) == pytest.approx(volts[0])
    np.testing.assert_allclose(record.drive.at(record.time), volts, atol=1e-6)


def test_cycles_of_a_waveform_are_run_before_the_record(tmp_path):
    text = changed('drive = { waveform = "sawtooth"', 'conditioning = "2 cycles"\ndrive = { waveform = "sawtooth"')
    record = pdssjax.load_study(write_study(tmp_path, text)).records[1]
    assert record.time[0] == pytest.approx(0.4)


REFUSED = {
    'conditioning = "3 cycles"': 'found "3 cycles" of a sampled drive, expected its period, too',
    "conditioning = -1": "found -1 s, expected a time above 0",
    'conditioning = { cycles = 0, period = "0.1 s" }': "found 0, expected a number of cycles from 1 to 10000",
    'conditioning = { cycles = 3, period = "1 s" }': "found 1 s, expected a time that the samples hold",
    'conditioning = { cycles = 3, period = "0.13 s" }': "expected a period of the voltage",
    'conditioning = { cycles = 3, periods = "0.1 s" }': 'found the unknown key "periods"',
}


@pytest.mark.parametrize("key", REFUSED)
def test_conditioning_that_cannot_be_is_refused_with_its_place(tmp_path, key):
    path, _ = sampled(tmp_path, key)
    with pytest.raises(InputError, match="conditioning") as refused:
        pdssjax.load_study(path)
    assert REFUSED[key] in str(refused.value)
    assert str(path) in str(refused.value)


@pytest.mark.parametrize(
    ("text", "told"),
    [("2.5 cycles", "expected whole cycles"), ("3 s", "expected whole cycles"), ("0 cycles", "found 0")],
)
def test_a_waveform_is_conditioned_by_whole_cycles(tmp_path, text, told):
    study = changed('drive = { waveform = "sawtooth"', f'conditioning = "{text}"\ndrive = {{ waveform = "sawtooth"')
    with pytest.raises(InputError, match=told):
        pdssjax.load_study(write_study(tmp_path, study))


def test_a_step_has_no_cycle_to_condition_with(tmp_path):
    with pytest.raises(InputError, match="this waveform has no cycle"):
        pdssjax.load_study(write_study(tmp_path, changed(STEP, f'conditioning = "3 cycles"\n{STEP}'), csv(5e-5, 40)))


def test_a_smoothed_voltage_has_the_noise_that_its_formula_says():
    interval, width, noise = 5e-3, 15e-3, 0.02
    raw = np.random.default_rng(0).normal(0.0, noise, 200_000)
    left = smoothed(raw, width / interval)
    assert left.std() == pytest.approx(noise * np.sqrt(interval / (2.0 * np.sqrt(np.pi) * width)), rel=0.02)
    rate = np.diff(left) / interval
    expected = noise * np.sqrt(interval / (2.0 * np.sqrt(np.pi) * width)) / (np.sqrt(2.0) * width)
    assert rate.std() == pytest.approx(expected, rel=0.03)
    assert np.std(np.diff(raw)) / interval == pytest.approx(np.sqrt(2.0) * noise / interval, rel=0.01)


def test_a_smoothed_harmonic_keeps_its_phase_and_loses_what_the_formula_says():
    time, width = np.arange(2000) * 1e-3, 5e-3
    wave = np.sin(2 * np.pi * 3.0 * time)
    left = smoothed(wave, 5.0)
    size = np.exp(-0.5 * (2 * np.pi * 3.0 * width) ** 2)
    np.testing.assert_allclose(left[100:-100], size * wave[100:-100], atol=1e-5)


def test_a_voltage_is_smoothed_as_the_study_asks(tmp_path):
    path, volts = sampled(tmp_path, more='smooth = "6 ms"')
    record = pdssjax.load_study(path).records[0]
    np.testing.assert_allclose(record.drive.at(record.time), smoothed(np.round(volts, 6), 1.2), atol=1e-9)


@pytest.mark.parametrize("width", ["0 s", "-1 ms", "1 s"])
def test_a_width_that_cannot_be_is_refused(tmp_path, width):
    path, _ = sampled(tmp_path, more=f'smooth = "{width}"')
    with pytest.raises(InputError, match=r'key "smooth": found .* expected a time above 0 and up to 0.01 s'):
        pdssjax.load_study(path)


def noisy(volts, seed=0):
    return volts + 0.02 * np.random.default_rng(seed).standard_normal(volts.size)


TIME = np.arange(41) * 5e-3
STEPS = np.select([TIME < 0.05, TIME < 0.1], [60.0, 80.0], 30.0)
"""A voltage that begins at 60 V."""

RESTED = {
    "steps": (STEPS, 60.0),
    "noise": (noisy(STEPS), 60.0),
    "one bit to and fro": (STEPS + 0.5 * (np.arange(41) % 3 == 1), 60.0),
    "below zero": (-STEPS, -60.0),
    "a small bias": (STEPS - 59.0, 1.0),
    "already moving": (60.0 + 20.0 * np.sin(2 * np.pi * 7.0 * TIME), 60.0),
}


@pytest.mark.parametrize("kind", RESTED)
def test_a_voltage_that_begins_off_zero_was_held_before_where_nothing_is_said(tmp_path, kind):
    volts, level = RESTED[kind]
    path, _ = sampled(tmp_path, volts=volts)
    record = pdssjax.load_study(path).records[0]
    assert record.rest_voltage == pytest.approx(level, abs=0.1)
    assert record.time[0] == pytest.approx(60.0) and record.start == pytest.approx(-60.0)
    np.testing.assert_allclose(record.drive.at(record.time), volts, atol=1e-6)
    # The same as what is written out.
    told = pdssjax.load_study(sampled(tmp_path, 'conditioning = "60 s"', volts=volts)[0]).records[0]
    assert told.rest_voltage is None
    assert np.array_equal(told.time, record.time) and np.array_equal(told.drive.times, record.drive.times)


def test_a_platform_that_rested_at_a_bias_does_not_ring_at_first(tmp_path):
    """From 0 V it would swing by as much as the bias moves it."""
    path, _ = sampled(tmp_path, volts=STEPS)
    numbers = {"piezo.gain": 1e-7, "piezo.natural_frequency": 400.0, "piezo.damping_ratio": 0.1}
    study = pdssjax.load_study(path).with_values(numbers)
    (motion,) = dataclasses.replace(study, parameters=_stack(study), records=study.records[:1]).predict()
    assert motion[:10] == pytest.approx(1e-7 * 60.0, rel=1e-9)
    study = pdssjax.load_study(sampled(tmp_path, 'conditioning = "0 s"', volts=STEPS)[0]).with_values(numbers)
    (motion,) = dataclasses.replace(study, parameters=_stack(study), records=study.records[:1]).predict()
    assert abs(motion[0]) < 1e-15 and np.max(np.abs(motion[:10] - 6e-6)) > 2e-6


def _stack(study):
    return {path: parameter for path, parameter in study.parameters.items() if path.startswith("piezo.")}


SET_IN = {
    "from zero": ("", STEPS - 60.0),
    "from zero within its noise": ("", noisy(STEPS - 60.0)),
    "from zero, one bit to and fro": ("", STEPS - 60.0 + 0.5 * (np.arange(41) % 3 == 0)),
    "a step, which never changes": ("", 60.0 + 5.0 * noisy(np.zeros(41))),
    "as the study says": ('conditioning = "0 s"', STEPS),
}


@pytest.mark.parametrize("kind", SET_IN)
def test_a_voltage_that_sets_in_with_the_record_is_left_as_it_is(tmp_path, kind):
    keys, volts = SET_IN[kind]
    record = pdssjax.load_study(sampled(tmp_path, keys, volts=volts)[0]).records[0]
    assert record.rest_voltage is None and record.time[0] == 0.0 and record.start == 0.0


def test_a_stack_whose_start_is_a_parameter_is_not_held(tmp_path):
    path, _ = sampled(tmp_path, volts=STEPS)
    text = path.read_text().replace(
        'piezo = "second-order"', 'piezo = { dynamics = "static", creep = { elements = 1 } }'
    )
    told = '"piezo.creep_1" = {}\n"piezo.creep_time" = {}\n"piezo.initial_voltage" = {}\n"piezo.gain"'
    text = text.replace('"piezo.gain"', told)
    lines = [line for line in text.splitlines() if "natural_frequency" not in line and "damping_ratio" not in line]
    path.write_text("\n".join(lines).split("[[record]]")[0] + "[[record]]" + "\n".join(lines).split("[[record]]")[1])
    assert pdssjax.load_study(path).records[0].rest_voltage is None


def test_a_record_that_begins_before_its_drive_shows_what_was_there(tmp_path):
    """Its early samples are of an actuator at 0 V, by the clock that the study tells."""
    path, _ = sampled(tmp_path, volts=STEPS)
    (tmp_path / "volts.csv").write_text(
        "time_s,u_V\n" + "".join(f"{t},{v}\n" for t, v in zip(TIME, STEPS, strict=True))
    )
    drive = 'waveform = "sampled", file = "volts.csv", column = "u_V"'
    path.write_text(path.read_text().replace('waveform = "sampled", column = "u_V"', drive))
    assert pdssjax.load_study(path).records[0].rest_voltage == 60.0
    path.write_text(path.read_text().replace('measures = "platform"', 'measures = "platform"\nstart = "0.05 s"'))
    assert pdssjax.load_study(path).records[0].rest_voltage is None


def test_stairs_of_a_converter_fall_where_they_did(tmp_path):
    path, _ = sampled(tmp_path, more='hold = "7 ms"', volts=STEPS)
    record = pdssjax.load_study(path).records[0]
    plain = pdssjax.load_study(sampled(tmp_path, 'conditioning = "0 s"', volts=STEPS)[0]).records[0]
    assert record.rest_voltage == 60.0 and record.time[0] >= 60.0
    stairs = plain.drive.at(np.floor(plain.time / 7e-3 + 1e-6) * 7e-3 + 1e-8)
    np.testing.assert_allclose(record.drive.at(record.time), stairs, atol=0.1)
