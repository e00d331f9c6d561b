"""Records that are not fitted judge a fit: by their noise, and by what the errors of its parameters leave open."""

import numpy as np
import pytest
from record_tables import SHORT, record_table, write_columns

import pdssjax
from pdssjax.cli.main import main

pytestmark = pytest.mark.usefixtures("undrawn")

GAIN, ROUGH, FINE = 1.1e-7, 1e-7, 1e-9
TIME = np.arange(0.0, 0.1, 5e-4)
VOLTS = 20.0 * (1.0 - np.cos(2.0 * np.pi * 20.0 * TIME))
OFFSET_FREE = VOLTS - VOLTS.mean()
ERROR = ROUGH / np.sqrt(OFFSET_FREE @ OFFSET_FREE)
"""Standard error of the gain by the rough record, in closed form."""

HEAD = """\
format = "pdssjax-study/1"
[actuator]
piezo = "static"
friction = "coulomb"
[parameters]
"piezo.gain" = { start = "0.1 um/V" }
"""
DRIVE = 'drive = { waveform = "sine", voltage = "40 V", frequency = "20 Hz" }'


def study(folder, gain, draw=1, told=True, glitches=0, longer=1):
    """A rough record that is fitted, and a fine one of another `gain` that is not, `longer` times as long; its path."""
    random = np.random.default_rng(draw)
    text = HEAD
    for name, number, noise, line in (("rough", GAIN, ROUGH, ""), ("fine", gain, FINE, 'role = "validate"')):
        times = longer if name == "fine" else 1
        motion = number * np.tile(VOLTS, times) + random.normal(0.0, noise, TIME.size * times)
        if name == "fine":
            motion[10 : 10 + glitches] += 100.0 * noise
        write_columns(folder / f"{name}.csv", "time_s,y_um", 5e-4 * np.arange(motion.size), 1e6 * motion, digits="%.9f")
        lines = [line, DRIVE, *([f'noise = "{1e6 * noise} um"'] if told else [])]
        text += "\n" + record_table(name, "platform", *filter(None, lines), columns=SHORT)
    (folder / "study.toml").write_text(text)
    return folder / "study.toml"


def identified(*arguments, **more):
    return pdssjax.identify(pdssjax.load_study(study(*arguments, **more)))


@pytest.mark.parametrize("glitches", [0, 3])
def test_what_the_errors_of_the_parameters_leave_open_is_not_held_against_a_fit(tmp_path, glitches):
    """The fine record is seven times its noise off, which one standard error of the gain explains."""
    estimate = identified(tmp_path, GAIN + ERROR, glitches=glitches)
    gain = estimate.parameters["piezo.gain"]
    assert gain.standard_error == pytest.approx(ERROR, rel=0.03)
    assert estimate.records[1].rest_rmse > 3.0 * FINE
    assert estimate.success
    assert not any("not predicted" in note for note in estimate.notes)


@pytest.mark.parametrize("told", [True, False], ids=["given", "seen between neighbours"])
def test_a_fit_that_misses_a_record_by_more_is_no_success(tmp_path, told, capsys):
    path = study(tmp_path, GAIN + 9.0 * ERROR, told=told)
    assert main(["identify", str(path), "--out", str(tmp_path / "out")]) == 3
    printed = capsys.readouterr()
    assert "a record that was not fitted is not predicted" in " ".join(printed.err.split())
    estimate = pdssjax.identify(pdssjax.load_study(path))
    assert estimate.converged and not estimate.explained
    (note,) = [note for note in estimate.notes if "not predicted" in note]
    assert '"fine"' in note and "does not carry over" in note
    assert ("the noise given" in note) == told
    # The record that was fitted is explained.
    assert estimate.records[0].rmse == pytest.approx(ROUGH, rel=0.15)


@pytest.mark.parametrize(("off", "explained"), [(1.0, True), (9.0, False)])
def test_a_record_that_was_not_fitted_may_be_longer_than_those_that_were(tmp_path, off, explained):
    """Its derivatives are wanted to its end, where it is not predicted at first."""
    estimate = identified(tmp_path, GAIN + off * ERROR, longer=2)
    assert estimate.explained == explained


def test_a_fit_whose_parameters_are_all_at_bounds_is_judged_as_it_is(tmp_path):
    path = study(tmp_path, GAIN)
    path.write_text(path.read_text().replace('{ start = "0.1 um/V" }', '{ start = "0.09 um/V", max = "0.1 um/V" }'))
    estimate = pdssjax.identify(pdssjax.load_study(path))
    assert estimate.parameters["piezo.gain"].at_bound and not estimate.explained
    assert any('"fine"' in note and "does not carry over" in note for note in estimate.notes)


@pytest.mark.slow
def test_by_chance_no_fit_is_refuted(tmp_path):
    refuted = [not identified(tmp_path, GAIN, draw=draw).success for draw in range(40)]
    assert not any(refuted)
