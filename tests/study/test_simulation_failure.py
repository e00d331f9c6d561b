"""What cannot be simulated names the cause: record, reason and parameter."""

import dataclasses
from types import SimpleNamespace

import jax
import numpy as np
import pytest

import pdssjax
from pdssjax import Accuracy, InputError
from pdssjax.cli.main import main
from pdssjax.inference import Ending, least_squares as fitting
from pdssjax.study import failure_cause, make_recordings

pytestmark = pytest.mark.usefixtures("undrawn")
STUDY = """\
format = "pdssjax-study/1"
[actuator]
piezo = "creep"
friction = "coulomb"
[parameters]
"piezo.gain" = {{ start = "0.1 um/V" }}
"piezo.natural_frequency" = {{ value = "6500 rad/s" }}
"piezo.damping_ratio" = {{ value = 0.18 }}
"piezo.creep" = {{ value = 0.01 }}
"amplifier.bandwidth" = {bandwidth}
[[record]]
name = "slow loop"
file = "loop.csv"
columns = {{ time = "time_s", displacement = "y_um" }}
measures = "platform"
noise = "0.01 um"
drive = {{ waveform = "triangle", voltage = "60 V", frequency = "1 Hz" }}
"""


@pytest.fixture(scope="module")
def stalled(tmp_path_factory):
    """An amplifier so quick that a creeping stack behind it runs the integration out of room."""
    folder = tmp_path_factory.mktemp("stalled")
    time = np.linspace(0.0, 1.0, 101)
    rows = np.stack([time, 6.0 * (1.0 - np.abs(1.0 - 2.0 * time))], axis=1)
    np.savetxt(folder / "loop.csv", rows, "%.6f", ",", header="time_s,y_um", comments="")
    (folder / "study.toml").write_text(STUDY.format(bandwidth='{ value = "1 MHz" }'))
    return pdssjax.load_study(folder / "study.toml")


def cause(study, numbers):
    return failure_cause(study.predictor, study.records, numbers, Accuracy())


def test_the_parameter_that_keeps_a_start_from_being_simulated_is_named(stalled):
    text = cause(stalled, pdssjax.initial_guess(stalled))
    assert '"slow loop"' in text
    assert "ran out of steps" in text
    # What to do about it, at the command line, which has no option for it, and in Python.
    assert "bandwidth that is too high, take a shorter record" in text and "Accuracy(max_steps=...)" in text
    assert "amplifier.bandwidth" in text and "instead of 1e+06 Hz" in text


def test_a_start_that_no_single_parameter_spoils_says_so(stalled):
    numbers = pdssjax.initial_guess(stalled) | {"piezo.gain": np.nan, "piezo.creep": np.nan}
    assert "No parameter changed by itself" in cause(stalled, numbers)


def test_where_nothing_fails_there_is_no_cause(stalled):
    assert cause(stalled, pdssjax.initial_guess(stalled) | {"amplifier.bandwidth": 1e3}) == ""


def test_a_virtual_rig_and_a_simulation_name_it_too(stalled, tmp_path, capsys):
    with pytest.raises(InputError, match=r"study\.toml: found a simulation that fails.*amplifier\.bandwidth at "):
        make_recordings(stalled)
    assert main(["simulate", str(stalled.path), "--out", str(tmp_path / "out")]) == 3
    printed = capsys.readouterr()
    assert "simulation failed" in printed.out
    assert "With amplifier.bandwidth at" in printed.err


@pytest.mark.slow
def test_records_that_are_left_out_are_not_simulated_and_spoil_no_derivative(stalled):
    (slow,) = stalled.records
    quick = dataclasses.replace(slow, name="quick", time=1e-6 * np.arange(20), measured=np.zeros(20))
    problem, free = pdssjax.pose_problem(dataclasses.replace(stalled, records=(slow, quick)))
    slopes = jax.jacfwd(lambda free: problem.residual(free, np.array([0.0, 1e8])))(free)
    for values in jax.tree.leaves(slopes):
        assert np.isfinite(values).all()
    np.testing.assert_array_equal(slopes[0][: slow.time.size], 0.0)
    assert (np.abs(slopes[0][slow.time.size :]) > 0.0).any()


def test_a_start_that_fails_after_another_phase_has_no_chi_square():
    blank = fitting.Fit(np.zeros(2), SimpleNamespace(residual=np.zeros(3)), False, "", 0, 1, Ending.START_FAILED)
    earlier = fitting.Fit(np.zeros(2), SimpleNamespace(residual=np.ones(3)), True, "", 4, 5, Ending.CONVERGED)
    assert fitting.with_counts_of(blank, [earlier]).chi2 == np.inf


@pytest.mark.slow
def test_the_message_of_a_fit_that_is_lost_says_why(stalled):
    estimate = pdssjax.identify(stalled)
    assert not estimate.converged
    assert estimate.message.startswith(fitting.START_FAILED)
    assert "amplifier.bandwidth" in estimate.message
    assert estimate.notes == ()
