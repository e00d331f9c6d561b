"""The start of a long stack is near its optimum: by least squares over its elements, without a simulation."""

import jax
import numpy as np
import pytest
from marks import slow
from record_tables import loaded, write_columns

import pdssjax
from pdssjax import Accuracy
from pdssjax.actuator import DrivenPlatform
from pdssjax.core import member
from pdssjax.drive.sampled import Sampled
from pdssjax.inference import guess_starts
from pdssjax.inference.initial_values.loop_starts import loop_starts
from pdssjax.piezo.base import Shown
from pdssjax.simulation import PlatformOnly, sensor_samples

NOISE = 2e-8
WALKS = """\
format = "pdssjax-study/1"
[actuator]
piezo = { dynamics = "second-order", hysteresis = { law = "none", asymmetry = 2 } }
friction = "coulomb"
[parameters]
"piezo.gain" = {}
"piezo.asymmetry_*" = {}
"piezo.natural_frequency" = { value = "5200 rad/s" }
"piezo.damping_ratio" = { value = 0.1 }
"friction.f_c" = { value = "0.1 N" }
"effector.mass" = { value = "50 g" }
"""
WALK = """
[[record]]
name = "{peak} V"
file = "{peak}.csv"
columns = {{ time = "time_s", displacement = "x_um" }}
measures = "effector"
noise = "20 nm"
drive = {{ {drive} }}
"""
STUDY = """\
format = "pdssjax-study/1"
[actuator]
piezo = {{ dynamics = "static", hysteresis = {{ law = "play", elements = {elements} }}, creep = {{ elements = 1 }} }}
[parameters]
"piezo.gain" = {{}}
"piezo.play_*" = {{}}
"piezo.play_range" = {{ {given} }}
"piezo.creep_*" = {{}}
"piezo.creep_time" = {{}}
[[record]]
name = "loops"
file = "loops.csv"
columns = {{ time = "time_s", displacement = "y_um" }}
measures = "platform"
noise = "20 nm"
drive = {{ waveform = "sampled", column = "u_V" }}
"""


def decaying(kind, time):
    """Voltages [V] whose swing decays, so that every element of play shows."""
    size = 60.0 * (1.0 - 0.9 * time / time[-1])
    phase = 0.7 * time
    if kind == "triangle":
        return 60.0 + size * (2.0 * np.abs(2.0 * (phase % 1.0) - 1.0) - 1.0)
    return 60.0 - size * np.cos(2.0 * np.pi * phase)


def simulated(time, volts, weights, span, creep, lasts):
    """Gain 80 nm/V, elements of play and one of creep, by the textbook's definitions [m]."""
    thresholds = span * np.arange(1, weights.size + 1) / weights.size
    z, c, out = np.zeros(weights.size), 0.0, np.empty(time.size)
    for k, v in enumerate(volts):
        if k:
            slope, gap = (v - volts[k - 1]) / (time[k] - time[k - 1]), time[k] - time[k - 1]
            c = v - lasts * slope + (c - volts[k - 1] + lasts * slope) * np.exp(-gap / lasts)
        z = np.maximum(v - thresholds, np.minimum(v + thresholds, z))
        out[k] = 8e-8 * v + weights @ z + creep * c
    return out


def study(folder, kind="triangle", elements=10, count=1500, given=""):
    time = 4e-3 * np.arange(count)
    volts = decaying(kind, time)
    volts[:5] = 0.0
    weights = 4e-8 / elements * np.exp(-np.arange(elements) / elements)
    motion = simulated(time, volts, weights, 90.0, 6e-9, 0.4) + np.random.default_rng(1).normal(0.0, NOISE, count)
    write_columns(folder / "loops.csv", "time_s,u_V,y_um", time, volts, 1e6 * motion, digits="%.9f")
    return loaded(folder, STUDY.format(elements=elements, given=given)), weights


@pytest.mark.parametrize("kind", ["triangle", "sine"])
@pytest.mark.parametrize("elements", [2, *(pytest.param(n, marks=pytest.mark.slow) for n in (10, 24))])
def test_the_start_leaves_little_more_than_noise(tmp_path, kind, elements):
    loaded, weights = study(tmp_path, kind, elements)
    starts, _ = guess_starts(loaded.models, loaded.parameters, loaded.records)
    assert set(starts) >= set(loaded.parameters) and all(number > 0.0 for number in starts.values())
    (record,) = loaded.records
    begun = np.array([starts[f"piezo.play_{j}"] for j in range(1, elements + 1)])
    span, creep, lasts = (starts[f"piezo.{name}"] for name in ("play_range", "creep_1", "creep_time"))
    left = record.measured - simulated(record.time, decaying_as_sampled(record), begun, span, creep, lasts)
    left -= (starts["piezo.gain"] - 8e-8) * decaying_as_sampled(record)
    # Each element that gets no weight begins at a thousandth of the gain: of 24 most do.
    assert np.std(left) < (1.1 if elements < 24 else 1.2) * NOISE
    assert span == pytest.approx(90.0, rel=0.05 if elements < 24 else 0.3)
    assert starts["piezo.gain"] + begun.sum() + creep == pytest.approx(8e-8 + weights.sum() + 6e-9, rel=0.02)


def decaying_as_sampled(record):
    return np.asarray(record.drive.at(record.time))


def test_numbers_that_a_study_gives_are_kept_and_the_others_suit_them(tmp_path):
    loaded, _ = study(tmp_path, given='value = "60 V"')
    starts, _ = guess_starts(loaded.models, loaded.parameters, loaded.records)
    assert starts["piezo.play_range"] == 60.0
    assert 0.06e-6 < starts["piezo.gain"] < 0.1e-6


def test_stacks_without_elements_and_records_of_no_platform_begin_as_ever(tmp_path):
    loaded, _ = study(tmp_path)
    stack = type(loaded.models.piezo) if not isinstance(loaded.models.piezo, type) else loaded.models.piezo
    assert loop_starts(stack, Shown(), {}, []) == {}
    assert loop_starts(stack, Shown(), {"initial_voltage": 5.0}, loaded.records) == {}
    assert loop_starts(member("piezo", "second-order"), Shown(), {}, loaded.records) == {}
    assert loop_starts(member("piezo", "composed:static+bouc-wen"), Shown(), {}, loaded.records) == {}


@pytest.mark.parametrize("measured", [False, True], ids=["a known ramp", "a measured voltage"])
def test_walks_alone_tell_gain_and_curvature_where_they_stick(tmp_path, measured):
    """Cycles of 20 samples under 98 % ramps: the end-effector slips and rings at first, and follows in the end."""
    random, time = np.random.default_rng(3), 1e-3 * np.arange(600)
    cycle, phase = np.divmod(50.0 * time, 1.0)
    text = WALKS
    for peak in (60, 100):
        volts = peak * np.minimum(phase / 0.98, (1.0 - phase) / 0.02)
        follows = 4e-8 * volts + 3e-10 * volts**2
        slips = 1e-6 * np.exp(-phase / 0.1) * np.cos(60.0 * phase) + 2e-6 * np.minimum(phase / 0.3, 1.0)
        walked = follows + slips + 5e-6 * cycle + random.normal(0.0, NOISE, time.size)
        noisy = volts + 0.02 * random.normal(size=time.size)
        write_columns(tmp_path / f"{peak}.csv", "time_s,u_V,x_um", time, noisy, 1e6 * walked, digits="%.6f")
        known = f'waveform = "triangle", voltage = "{peak} V", frequency = "50 Hz", symmetry = 0.98'
        drive = 'waveform = "sampled", column = "u_V"' if measured else known
        text += WALK.format(peak=peak, drive=drive)
    (tmp_path / "walks.toml").write_text(text)
    loaded = pdssjax.load_study(tmp_path / "walks.toml")
    starts, _ = guess_starts(loaded.models, loaded.parameters, loaded.records)
    assert starts["piezo.gain"] == pytest.approx(4e-8, rel=0.15)
    assert starts["piezo.asymmetry_2"] == pytest.approx(3e-10, rel=0.15)


@pytest.mark.parametrize("name", [slow("static+play-4+asymmetry-3+creep-2"), "static+play-2", "static+creep-3"])
def test_columns_are_what_the_model_moves_by(name):
    """With random weights, as the model itself simulates it."""
    stack, random = member("piezo", f"composed:{name}"), np.random.default_rng(5)
    time = np.arange(1, 61) * 5e-3
    volts = 20.0 + 15.0 * np.sin(2 * np.pi * 7.0 * time) + 6.0 * np.sin(2 * np.pi * 19.0 * time)
    numbers = {n: {"play_range": 17.0, "creep_time": 0.03}[n] for n in stack.loop_numbers}
    columns = stack.loop_columns(time, volts, numbers)
    weights = {n: 1e-8 * random.random() / 20.0 ** (int(n[-1]) - 1 if "asym" in n else 0) for n in columns}
    system = PlatformOnly(DrivenPlatform(stack(**weights, **numbers)), Sampled(time, volts))
    moved = jax.jit(lambda time: sensor_samples(system, time, Accuracy(max_steps=20000), segments=time.size + 1))
    np.testing.assert_allclose(moved(time), sum(weights[n] * columns[n] for n in columns), atol=1e-12)
