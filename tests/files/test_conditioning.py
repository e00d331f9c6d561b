"""What a drive did before t = 0, and the noise of a voltage that was measured."""

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
    'conditioning = { cycles = 3, period = "0.13 s" }': "expected a period of it",
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
