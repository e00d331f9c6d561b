"""What a fit tells its user is true, is said once, and says what to do next."""

import dataclasses
import json
import math
import re
from pathlib import Path

import fabricated
import numpy as np
import pytest
from record_tables import SHORT, loaded, record_table, step_table, write_columns
from scipy.signal import lfilter

import pdssjax
from pdssjax import Accuracy, Record
from pdssjax.cli.main import main
from pdssjax.core import member
from pdssjax.drive.sawtooth import Sawtooth
from pdssjax.inference import Evidence, least_squares as fitting, pose, summary
from pdssjax.inference.beyond_noise import exceeds_floor, exceeds_given_noise
from pdssjax.inference.notes.about_records import about_records, about_rests
from pdssjax.inference.notes.of_fit import about_information, about_models, about_resonances
from pdssjax.report.text import format_report
from pdssjax.study import FittedParameter, Models, compare
from pdssjax.study.measurement.effector import Effector
from pdssjax.study.measurement.platform import Platform

pytestmark = pytest.mark.usefixtures("undrawn")

GAIN, RATE, DAMPING = 1.1e-7, 6000.0, 0.2
NOISE = 1e-8
FILE = Path("made.csv")

STUDY = """\
format = "pdssjax-study/1"
[actuator]
piezo = "second-order"
friction = "coulomb"
[parameters]
"piezo.gain" = { start = "0.1 um/V" }
"piezo.natural_frequency" = { start = "6500 rad/s" }
"piezo.damping_ratio" = { start = 0.18 }
"""
GIVEN = 'noise = "0.01 um"'


def rung(time, rate=RATE):
    """The platform after a step of 50 V [m]."""
    return fabricated.step_motion(time, 50.0 * GAIN, rate, DAMPING)


def write(folder, records, text=STUDY):
    """A study of the platform alone; for each record its name: the samples, their motion, noise, role, noise line."""
    for number, (name, (time, motion, noise, role, line)) in enumerate(records.items()):
        random = np.random.default_rng([3, number] if number else 3)
        write_columns(
            folder / f"{name}.csv", "time_s,y_um", time, 1e6 * (motion + random.normal(0.0, noise, time.size))
        )
        text += "\n" + step_table(f'role = "{role}"', line, name=name, columns=SHORT)
    return loaded(folder, text)


TIME = np.arange(-0.005, 0.035, 5e-5)
LONG = np.arange(-0.005, 0.195, 5e-5)


def the_note(estimate, start):
    """The one note with `start` in it."""
    (note,) = [note for note in estimate.notes if start in note]
    return note


def test_a_record_that_does_not_fit_is_named_although_a_larger_one_hides_it(tmp_path):
    crooked = rung(TIME) + 2e-8 * np.sin(2e3 * np.maximum(TIME, 0.0))
    records = {
        "calm": (LONG, rung(LONG), 0.6 * NOISE, "fit", GIVEN),
        "crooked": (TIME, crooked, 0.6 * NOISE, "fit", GIVEN),
    }
    study = write(tmp_path, records)
    estimate = pdssjax.identify(study)
    assert estimate.statistics.reduced_chi2 < 1.0
    calm, poor = estimate.records
    assert calm.reduced_chi2 == pytest.approx(0.36, abs=0.05)
    assert poor.reduced_chi2 > 1.5
    assert calm.chi2 + poor.chi2 == pytest.approx(estimate.statistics.chi2)
    note = the_note(estimate, "does not explain")
    assert '"crooked"' in note and "calm" not in note
    assert estimate.converged and not estimate.explained
    assert "leave more than noise" in format_report(estimate)
    assert "too small if this record is right" in note
    assert f"{poor.reduced_chi2:.3g}" in note
    assert '"calm"' in the_note(estimate, "smaller than the noise given")


def test_records_that_contradict_each_other_deny_success_although_they_leave_no_more_than_noise(tmp_path):
    """Two steps of one voltage that differ by 0.2 %: their residuals are 2 % larger than noise."""
    time, random = np.arange(-0.02, 0.02, 5e-5), np.random.default_rng(4)
    noisy = lambda gain: gain * rung(time) + random.normal(0.0, NOISE, time.size)
    records = lambda gain: {
        "one": (time, noisy(1.0), 0.0, "fit", ""),
        "other": (time, noisy(gain), 0.0, "fit", ""),
    }
    agreeing = pdssjax.identify(write(tmp_path, records(1.0)))
    assert agreeing.success and not agreeing.notes
    estimate = pdssjax.identify(write(tmp_path, records(1.002)))
    assert estimate.converged and not estimate.success
    assert all(record.rmse < 1.05 * NOISE for record in estimate.records)
    assert "contradicts the other records" in the_note(estimate, "piezo.gain")
    assert "CONVERGED, BUT DOES NOT EXPLAIN ITS RECORDS" in format_report(estimate)
    assert estimate.unexplained_by == ("contradiction",)
    assert "Records ask for different parameters." in format_report(estimate)


CARRIED = """\
format = "pdssjax-study/1"
[actuator]
piezo = "static"
friction = "coulomb"
[parameters]
"piezo.gain" = { start = "0.1 um/V" }
"effector.mass" = { value = "86 g" }
"friction.f_c" = { start = "0.5 N" }
[[record]]
name = "carried"
file = "carried.csv"
columns = { time = "time_s", displacement = "y_um" }
measures = "effector"
noise = "0.01 um"
drive = { waveform = "sine", voltage = "10 V", frequency = "20 Hz" }
"""


@pytest.mark.slow
def test_a_record_without_a_slip_is_called_so(tmp_path):
    time = np.arange(0.0, 0.25, 5e-4)
    motion = 5.0 * GAIN * (1.0 - np.cos(2.0 * np.pi * 20.0 * time))
    noisy = 1e6 * (motion + np.random.default_rng(7).normal(0.0, NOISE, time.size))
    write_columns(tmp_path / "carried.csv", "time_s,y_um", time, noisy)
    estimate = pdssjax.identify(loaded(tmp_path, CARRIED))
    assert estimate.parameters["piezo.gain"].value == pytest.approx(GAIN, rel=3e-3)
    assert "friction.f_c" in the_note(estimate, "The data say nothing about")
    note = the_note(estimate, "No record that was fitted walks")
    assert '"carried"' in note and "never slips" in note
    walking = dataclasses.replace(estimate.records[0], measured=estimate.records[0].measured + 2e-7 * 20.0 * time)
    assert not any("walks" in said for said in about_records([walking], 1.0, False))


def test_figures_of_each_record_are_written_and_printed(tmp_path, capsys):
    records = {
        "told": (TIME, rung(TIME), NOISE, "fit", GIVEN),
        "silent": (TIME, rung(TIME), NOISE, "fit", ""),
        "other": (TIME, rung(TIME, 6300.0), NOISE, "validate", GIVEN),
    }
    write(tmp_path, records)
    assert main(["identify", str(tmp_path / "study.toml"), "--out", str(tmp_path / "out")]) == 3  # "other" is missed
    document = json.loads((tmp_path / "out" / "estimate.json").read_text())
    told, silent, other = document["records"]
    assert told["reduced_chi2"] == pytest.approx(1.0, abs=0.2)
    assert told["chi2"] == pytest.approx(told["samples"], rel=0.2)
    assert not told["noise_estimated"] and silent["noise_estimated"]
    assert silent["reduced_chi2"] is None
    assert silent["noise_floor"] == pytest.approx(NOISE, rel=0.1)
    assert other["reduced_chi2"] > 10.0
    assert not document["statistics"]["noise_estimated"]
    assert any('"other"' in note and "not fitted" in note for note in document["notes"])
    printed = capsys.readouterr().out
    assert "(noise estimated from the residuals in 1 of 2 records)" in printed
    (told_line,) = [line.split() for line in printed.splitlines() if line.startswith("    told")]
    (silent_line,) = [line.split() for line in printed.splitlines() if line.startswith("    silent")]
    assert told_line[7:11] == ["0.0100", "given", f"{1e6 * told['noise_floor']:.4f}", f"{told['reduced_chi2']:.3f}"]
    assert silent_line[8:11] == ["found", f"{1e6 * silent['noise_floor']:.4f}", "-"]


def test_a_reduced_chi_square_of_one_by_construction_is_not_printed(tmp_path):
    estimate = pdssjax.identify(write(tmp_path, {"silent": (TIME, rung(TIME), NOISE, "fit", "")}))
    assert estimate.statistics.noise_estimated and estimate.explained
    assert estimate.statistics.reduced_chi2 == pytest.approx(1.0, abs=0.01)
    (line,) = [line for line in format_report(estimate).splitlines() if "reduced chi-square" in line]
    assert line.split("=")[1].strip() == "- (noise estimated from these residuals)"
    assert estimate.notes == ()


def test_residuals_above_the_noise_between_neighbours_are_told_where_no_noise_is_given(tmp_path):
    crooked = rung(TIME) + 3e-8 * np.sin(2e3 * np.maximum(TIME, 0.0))
    estimate = pdssjax.identify(write(tmp_path, {"silent": (TIME, crooked, NOISE, "fit", "")}))
    (record,) = estimate.records
    note = the_note(estimate, "No noise is given")
    assert f'{record.rmse / record.noise_floor:.2g} times in "silent"' in note
    assert record.rmse / record.noise_floor > 1.8


def test_a_noise_given_too_small_is_not_blamed_on_the_model(tmp_path):
    estimate = pdssjax.identify(write(tmp_path, {"noisy": (TIME, rung(TIME), 2.0 * NOISE, "fit", GIVEN)}))
    note = the_note(estimate, "too small")
    assert '"noisy"' in note and "0.01 um" in note
    assert not any("does not explain" in note for note in estimate.notes)


@pytest.mark.parametrize(("hum", "noise", "said"), [(2.2e-8, 1e-8, "does not explain"), (0.0, 2e-8, "is too small")])
def test_what_exceeds_the_noise_is_told_as_misfit_or_noise_where_a_ring_is_sampled_coarsely_too(hum, noise, said):
    """There the samples of the ring bend by more than either."""
    time = np.arange(-5e-4, 4.5e-3, 1e-4)
    left = hum * np.sin(2.0 * np.pi * 700.0 * time) + np.random.default_rng(5).normal(0.0, noise, time.size)
    record = Record("short", FILE, "fit", Platform(), None, frozenset(), time, rung(time) + left, NOISE, 0.0)  # pyright: ignore[reportArgumentType]
    found = compare(record, rung(time), noise=NOISE, offset=0.0)
    assert found.noise_floor > 1.5 * found.rmse
    (note,) = [text for text in about_records([found], 1.0, False) if "short" in text and "noise given" in text]
    assert said in note
    if not hum:
        told = float(re.search(r"residuals alone scatter by (\S+) um", note)[1])
        assert told == pytest.approx(0.02, rel=0.2)


def made_record(samples, noise, seed, given=NOISE):
    """White noise on a ramp beside the ramp itself, as fitted."""
    time = np.arange(samples) * 1e-3
    motion = 1e-5 * time
    measured = motion + np.random.default_rng(seed).normal(0.0, noise, samples)
    posed = Record("r", FILE, "fit", Platform(), Sawtooth(), frozenset(), time, measured, given, 0.0)  # pyright: ignore[reportArgumentType]
    return compare(posed, motion, noise=given or float(np.std(measured - motion)), offset=0.0)


@pytest.mark.parametrize("samples", [20, *(pytest.param(n, marks=pytest.mark.slow) for n in (100, 400, 1600))])
def test_chance_alone_raises_no_alarm(samples):
    made = [made_record(samples, NOISE, seed) for seed in range(300)]
    assert not any(map(exceeds_given_noise, made))
    assert not any(map(exceeds_floor, made))
    assert sum(exceeds_given_noise(made_record(samples, 3.0 * NOISE, seed)) for seed in range(30)) == 30


@pytest.mark.parametrize(("kind", "said"), [("noise", True), ("swelling", False), ("repeating", False)])
def test_residuals_with_alike_neighbours_are_noise_where_they_lie_everywhere_and_do_not_repeat(kind, said):
    """Filtered noise; the same at one place; and the same in every cycle, which is as large everywhere."""
    time, random = np.arange(4000) * 1e-3, np.random.default_rng(4)
    slow = lfilter([1.0], [1.0, -0.9], random.normal(0.0, NOISE, 5000))[1000:]
    left = {
        "noise": slow,
        "swelling": slow * np.exp(-(((time - 2.5) / 0.5) ** 2)),
        "repeating": np.tile(slow[:200], 20),
    }
    measured = 1e-5 * time + left[kind] + random.normal(0.0, 0.2 * NOISE, time.size)
    drive = Sawtooth(frequency=5.0)
    posed = Record("r", FILE, "fit", Platform(), drive, frozenset(), time, measured, None, 0.0)  # pyright: ignore[reportArgumentType]
    made = compare(posed, 1e-5 * time, noise=float(np.std(left[kind])), offset=0.0)
    assert exceeds_floor(made) is not said
    notes = " ".join(about_records([made], 1.0, False))
    assert ("coloured noise, as of a filter in the sensor" in notes) is said
    assert ("correlated, as the model's errors are" in notes) is not said


def parameter(path, value, start, unit):
    return FittedParameter(path, value, math.nan, (math.nan, math.nan), unit, True, start, False, False)


def test_only_a_parameter_that_did_not_move_is_called_where_the_fit_began():
    null = [np.array([1.0])]
    still = parameter("piezo.gamma", 0.01, 0.01, "1/V")
    assert "its value is where the fit began" in about_information(null, ["piezo.gamma"], {"piezo.gamma": still})[0]
    away = parameter("piezo.gamma", -0.145, 0.01, "1/V")
    (note,) = about_information(null, ["piezo.gamma"], {"piezo.gamma": away})
    assert "where the fit began" not in note
    assert "from 0.01 1/V to -0.145 1/V" in note and "Fix it" in note


def test_a_parameter_at_a_bound_is_told_with_side_value_and_unit(tmp_path):
    text = STUDY.replace('{ start = "0.1 um/V" }', '{ start = "0.1 um/V", max = "0.105 um/V" }')
    estimate = pdssjax.identify(write(tmp_path, {"step": (TIME, rung(TIME), NOISE, "fit", GIVEN)}, text))
    note = the_note(estimate, "bound")
    assert note.startswith("piezo.gain is at its upper bound, 0.105 um/V, the max that the study gives")


def test_a_parameter_far_from_its_start_is_told(tmp_path):
    text = STUDY.replace('"0.1 um/V"', '"0.008 um/V"')
    estimate = pdssjax.identify(write(tmp_path, {"step": (TIME, rung(TIME), NOISE, "fit", GIVEN)}, text))
    assert estimate.converged
    assert "piezo.gain, from 0.008 um/V to 0.11 um/V, by a factor of 13.8" in the_note(estimate, "Far from")
    assert len(estimate.notes) == 1


def test_a_fit_that_is_lost_says_the_cause_and_nothing_that_would_mean_nothing(tmp_path, monkeypatch):
    study = write(tmp_path, {"step": (TIME, rung(TIME), 3.0 * NOISE, "fit", GIVEN)})
    problem = pose(study, pdssjax.initial_guess(study), Accuracy())
    failed = fitting.joint(problem, pdssjax.initial_guess(study), print)._replace(
        success=False, message=fitting.START_FAILED
    )
    monkeypatch.setattr(summary, "failure_cause", lambda *what: "the cause")
    estimate = summary.summarise(study, "joint", Evidence(problem, failed), pdssjax.initial_guess(study))
    assert estimate.message == f"{fitting.START_FAILED}: the cause"
    assert estimate.notes == ()


def sampled(name, interval, measures="effector"):
    time = np.arange(0.0, 1.0, interval)
    measurement = member("study.measurement", measures)()
    return Record(name, FILE, "fit", measurement, Sawtooth(), frozenset(), time, 1e-6 * time, NOISE, None)  # pyright: ignore[reportArgumentType]


MASS = 0.1
RINGS = {
    "effector.mass": MASS,
    "piezo.gain": 1e-7,
    "piezo.natural_frequency": 900.0,
    "piezo.damping_ratio": 0.2,
    "friction.sigma0": MASS * (2.0 * math.pi * 447.0) ** 2,
    "friction.sigma1": 2.0 * 0.0004 * MASS * 2.0 * math.pi * 447.0,
    "friction.f_ss": 0.6,
}
"""The contact rings at 447 Hz with a damping ratio of 0.0004, the platform at 143 Hz."""


def models(piezo="second-order", friction="simplified-lugre"):
    return Models(member("piezo", piezo), member("friction", friction), "deflection", False)


def test_a_contact_that_rings_above_what_its_records_show_is_warned_of():
    free = [path for path in RINGS if path.startswith("friction.")]
    slow, quicker, fine = sampled("slow", 2e-3), sampled("quicker", 1e-3), sampled("fine", 2e-4)
    (alias, undamped) = about_resonances(models(), RINGS, free, [slow])
    assert "contact" in alias and "447 Hz" in alias and "alias" in alias and '"slow" (500 Hz)' in alias
    assert "like those of 53 Hz" in alias
    assert "friction.sigma0" in alias and "friction.f_ss" not in alias
    assert "0.0004" in undamped and "not to be believed" in undamped
    assert len(about_resonances(models(), RINGS, free, [slow, quicker])) == 2
    assert about_resonances(models(), RINGS, free, [slow, fine]) == [undamped]
    assert about_resonances(models(), RINGS, ["friction.f_ss"], [slow]) == []
    assert about_resonances(models(), RINGS, free, [sampled("platform", 2e-3, "platform")]) == []
    at_end = {"friction.sigma0": RINGS["friction.sigma0"], "friction.elastic_part": 0.9999}  # of what is below 1
    (alias, *_) = about_resonances(models(friction="elastoplastic"), RINGS | at_end, list(at_end), [slow])
    assert "friction.sigma0" in alias and "elastic_part" not in alias


def test_a_platform_that_rings_above_what_its_records_show_is_warned_of():
    values = RINGS | {"piezo.natural_frequency": 6736.0, "friction.sigma1": 30.0}
    free = ["piezo.natural_frequency"]
    (note,) = about_resonances(models(), values, free, [sampled("slow", 2e-3)])
    assert "platform" in note and "1072 Hz" in note and "piezo.natural_frequency" in note
    assert about_resonances(models(), values, free, [sampled("slow", 2e-3), sampled("step", 5e-5, "platform")]) == []


def test_conditions_between_parameters_that_are_broken_are_told():
    (note,) = about_models(models("bouc-wen"), {"piezo.gamma": -0.145, "piezo.beta": 0.03})
    assert "piezo.gamma is -0.145 1/V, beyond piezo.beta, 0.03 1/V" in note
    assert about_models(models("bouc-wen"), {"piezo.gamma": -0.03, "piezo.beta": 0.03}) == []
    (note,) = about_models(models("maxwell-slip"), {"piezo.share_1": 0.9})
    assert "1.05, not below 1" in note
    assert about_models(models("maxwell-slip"), {}) == []


def test_a_record_that_was_lost_is_told_and_nothing_else_of_it():
    failed = dataclasses.replace(fabricated.estimate().records[3])
    (note,) = about_records([failed], 1.0, False)
    assert "could not finish" in note and '"lost/run"' in note


@pytest.mark.parametrize("step", [2e-7, 0.0])
def test_a_record_that_counts_in_steps_is_told_where_they_hide_its_noise(step):
    exact = rung(TIME)
    noise = np.random.default_rng(5).normal(0.0, 0.0 if step else NOISE, TIME.size)
    measured = np.round(exact / step) * step if step else exact + noise
    posed = Record("counted", FILE, "fit", Platform(), Sawtooth(), frozenset(), TIME, measured, None, 0.0)  # pyright: ignore[reportArgumentType]
    compared = compare(posed, exact, noise=float(np.std(measured - exact)), offset=0.0)
    told = [note for note in about_records([compared], 1.0, False) if "counts in steps" in note]
    assert len(told) == (1 if step else 0)
    assert not step or 'of 0.2 um in "counted"' in told[0]


@pytest.mark.parametrize(
    ("first", "said_before", "told"),
    [(60.0, "", True), (0.0, "", False), (60.0, 'conditioning = "0 s"', False)],
)
def test_a_record_that_begins_off_zero_is_told_unless_the_study_says_what_was_before(
    tmp_path, first, said_before, told
):
    volts = np.where(TIME < 0.0, first, 80.0)
    write_columns(tmp_path / "bias.csv", "time_s,voltage_V,y_um", TIME - TIME[0], volts, 1e6 * rung(TIME))
    drive = 'drive = { waveform = "sampled", column = "voltage_V" }'
    table = record_table("bias", "platform", *filter(None, [said_before]), drive, columns=SHORT)
    notes = about_rests(loaded(tmp_path, f"{STUDY}\n{table}").records)
    assert [note.startswith('The voltage begins at 60 V in "bias"') for note in notes] == [True] * told


@pytest.mark.parametrize(("late", "said"), [(2e-4, "0.2 ms later"), (-2e-4, "0.2 ms earlier"), (0.0, "")])
def test_slips_at_other_times_than_predicted_are_told_as_such(late, said):
    time = np.arange(0.0, 1.0, 1e-4)
    # What is no delay: a stroke that is a hundredth larger.
    moved = fabricated.walk_motion(time - late, stroke=6.5e-6 if late else 6.565e-6)
    measured = moved + np.random.default_rng(5).normal(0.0, NOISE, time.size)
    posed = Record("walk", FILE, "fit", Effector(), Sawtooth(), frozenset(), time, measured, NOISE, 0.0)  # pyright: ignore[reportArgumentType]
    notes = about_records([compare(posed, fabricated.walk_motion(time), noise=NOISE, offset=0.0)], 1.0, False)
    assert any("does not explain" in note for note in notes)
    told = [note for note in notes if "Slips come" in note]
    assert (said in told[0] and '"walk"' in told[0]) if said else not told
