"""Sines of fewer frequencies than a stack has numbers do not tell these apart: they have no errors, a note says why."""

import numpy as np
import pytest
from record_tables import loaded, write_columns

import pdssjax
from pdssjax.inference.steady_sines import steady_sine

RATE, DAMPING, GAIN, NOISE = 400.0, 0.2, 1e-7, 2e-9
HEAD = """\
format = "pdssjax-study/1"
[actuator]
piezo = "{piezo}"
[parameters]
"""
RECORD = """
[[record]]
name = "{name}"
file = "{name}.csv"
columns = {{ time = "time_s", displacement = "y_um" }}
measures = "platform"
noise = "2 nm"
drive = {{ waveform = "sine", voltage = "40 V", frequency = "{hertz} Hz" }}
"""
LINEAR = ("piezo.gain", "piezo.natural_frequency", "piezo.damping_ratio")


def motion(time, hertz):
    """A platform of second order under 20 V (1 - cos) from t = 0 on, from rest, in closed form [m]."""
    w = 2.0 * np.pi * hertz
    middle = 20.0 * GAIN
    steady = -middle * RATE**2 / complex(RATE**2 - w**2, 2.0 * DAMPING * RATE * w)
    pole = complex(-DAMPING * RATE, RATE * np.sqrt(1.0 - DAMPING**2))
    start = -(middle + steady.real)
    free = complex(start, (start * pole.real - w * steady.imag) / pole.imag)
    return middle + np.real(steady * np.exp(1j * w * time)) + np.real(free * np.exp(pole * time))


def study(folder, *sines, piezo="second-order", paths=LINEAR):
    """Of sines by frequency [Hz] and when their record begins [s]; loaded."""
    text = HEAD.format(piezo=piezo) + "".join(f'"{path}" = {{}}\n' for path in paths)
    for number, (hertz, begin) in enumerate(sines):
        time = begin + np.arange(800) / 4000.0
        seen = motion(time, hertz) + np.random.default_rng(number).normal(0.0, NOISE, time.size)
        write_columns(folder / f"s{number}.csv", "time_s,y_um", time, 1e6 * seen, digits="%.9f")
        text += RECORD.format(name=f"s{number}", hertz=hertz)
    return loaded(folder, text)


def note_of(estimate):
    return [note for note in estimate.notes if "apart: a steady sine tells" in note]


@pytest.mark.parametrize("hertz", [35.0, *(pytest.param(hertz, marks=pytest.mark.slow) for hertz in (10.0, 90.0))])
def test_a_steady_sine_alone_tells_no_mechanics(tmp_path, hertz):
    estimate = pdssjax.identify(study(tmp_path, (hertz, 1.0)))
    (note,) = note_of(estimate)
    assert 'of "s0"' in note and f"{hertz:g} Hz" in note and "2 numbers" in note and "these are 3" in note
    for path in LINEAR[1:]:
        found = estimate.parameters[path]
        assert path in note and (found.at_bound or not found.identifiable)
        assert np.isnan(found.standard_error) and not found.errors


@pytest.mark.parametrize(
    "sines",
    [
        ((35.0, 1.0), (90.0, 1.0)),
        ((35.0, 0.0),),
        pytest.param(((10.0, 1.0), (90.0, 0.0)), marks=pytest.mark.slow),
    ],
)
def test_another_frequency_or_the_onset_tells_it(tmp_path, sines):
    estimate = pdssjax.identify(study(tmp_path, *sines))
    assert not note_of(estimate)
    for path, truth in zip(LINEAR, (GAIN, RATE, DAMPING), strict=True):
        found = estimate.parameters[path]
        assert abs(found.value - truth) < 5.0 * found.standard_error < 0.1 * truth, path


def test_two_sines_of_one_frequency_are_one(tmp_path):
    estimate = pdssjax.identify(study(tmp_path, (35.0, 1.0), (35.0, 2.0)))
    (note,) = note_of(estimate)
    assert '"s0" and "s1"' in note and note.count("35 Hz") == 1


def test_what_is_held_is_not_wanted(tmp_path):
    study(tmp_path, (35.0, 1.0))
    text = (tmp_path / "study.toml").read_text()
    assert '"piezo.damping_ratio" = {}' in text
    text = text.replace('"piezo.damping_ratio" = {}', '"piezo.damping_ratio" = { value = 0.2 }')
    estimate = pdssjax.identify(loaded(tmp_path, text))
    assert not note_of(estimate)
    assert estimate.parameters["piezo.natural_frequency"].value == pytest.approx(RATE, rel=0.01)


@pytest.mark.parametrize("cycles, offset", [(1.2, 0.0), (7.3, 60.0), (43.0, -5.0)])
def test_a_sampled_sine_is_found_with_its_frequency(cycles, offset):
    time = 0.3 + np.linspace(0.0, 2.0, 900)
    volts = offset + 30.0 * np.sin(np.pi * cycles * time + 0.4)
    found = steady_sine(time, volts, None)
    assert found.frequency == pytest.approx(cycles / 2.0, rel=1e-3) and found.amplitude == pytest.approx(30.0, rel=1e-3)


@pytest.mark.parametrize(
    "shape",
    [
        lambda phase: np.abs(phase % 1.0 - 0.5),
        lambda phase: np.where(phase > 1.0, np.sin(2 * np.pi * phase), 0.0),
        lambda phase: np.sin(2 * np.pi * phase) * (1.0 - 0.1 * phase),
        lambda phase: np.sin(2 * np.pi * phase) + 0.3 * np.sin(5.1 * phase),
        lambda phase: np.sin(2 * np.pi * phase * (1.0 + 0.1 * phase)),
        lambda phase: np.ones_like(phase),
        lambda phase: np.sin(0.1 * phase),
    ],
    ids=["triangle", "after a rest", "decaying", "two", "chirp", "constant", "part of a cycle"],
)
def test_other_voltages_are_no_steady_sine(shape):
    time = np.linspace(0.0, 2.0, 900)
    assert steady_sine(time, 30.0 * shape(3.0 * time), None) is None
