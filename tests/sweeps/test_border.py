"""A border is found to its tolerance with few points."""

import dataclasses

import numpy as np
import pytest
import xarray
from quick_blocks import study as study
from study_files import write_estimate

import pdssjax
from pdssjax import InputError, InputWarning
from pdssjax.cli.main import main
from pdssjax.drive.triangle import Triangle
from pdssjax.files import EXAMPLE
from pdssjax.sweeps import execution, find_border

FREQUENCIES = np.linspace(5.0, 50.0, 10)
TRUTH = 12.0 + 0.7 * FREQUENCIES
"""The border [V] at each of them."""


@pytest.fixture
def dead(monkeypatch):
    """The step efficiency rises from zero at a voltage that depends on the frequency; says how many points it had."""
    asked = []

    def compute_block(function, points):
        asked.append(len(points))
        frequency, voltage = points[:, 0], points[:, -1]
        efficiency = np.maximum(0.01 + 0.05 * (voltage - 12.0 - 0.7 * frequency), 0.0)
        return np.column_stack([*[efficiency] * 5, np.zeros(len(points))])

    monkeypatch.setattr(execution, "compute_block", compute_block)
    return asked


def test_the_border_is_found_with_a_tenth_of_the_points_of_a_grid(study, dead):
    found = find_border(study, "drive.voltage", (8.0, 150.0), {"drive.frequency": FREQUENCIES}, tolerance=0.2)
    np.testing.assert_allclose(found.border, TRUTH, rtol=0.0, atol=0.1)
    assert found.border.attrs["units"] == "V" and (found.passes == 1).all()
    assert found.attrs["points"] < 0.1 * len(FREQUENCIES) * (150.0 - 8.0) / 0.2


def test_where_there_is_no_border_there_is_none(study, dead):
    found = find_border(study, "drive.voltage", (8.0, 30.0), {"drive.frequency": FREQUENCIES}, tolerance=0.2)
    np.testing.assert_array_equal(np.isfinite(found.border), TRUTH < 30.0)


@pytest.mark.parametrize(
    ("change", "essential"),
    [
        (dict(ends=(150.0, 8.0)), "expected the lower end first"),
        (dict(tolerance=0.0), "expected above 0 and at least 2"),
        (dict(metric="speeds"), 'unknown metric "speeds"'),
        (dict(path="drive.volt"), "did you mean"),
    ],
)
def test_what_has_no_border_is_refused_before_any_work(study, dead, change, essential):
    asked = dict(path="drive.voltage", ends=(8.0, 150.0), over={"drive.frequency": [5.0]}, tolerance=0.2) | change
    with pytest.raises(InputError) as refused:
        find_border(study, **asked)
    assert essential in str(refused.value) and not dead


@pytest.fixture
def command(study, tmp_path):
    """`pdssjax sweep` of the example with its true values."""
    estimate = write_estimate(tmp_path, study.values())
    return ["sweep", str(EXAMPLE / "study.toml"), "--estimate", str(estimate), "--out", str(tmp_path / "out")]


def test_the_command_finds_the_border_and_draws_it(command, dead, tmp_path, capsys):
    asked = ["--voltage", "8:150", "--frequency", "5:50:10", "--border", "drive.voltage=200 mV"]
    assert main([*command, *asked]) == 0
    found = xarray.open_dataset(tmp_path / "out" / "border.nc", engine="scipy").load()
    np.testing.assert_allclose(found.border, TRUTH, rtol=0.0, atol=0.1)
    assert found.drive_frequency.attrs["units"] == "Hz" and found.attrs["metric"] == "efficiency"
    assert found.attrs["points"] == 10 * (9 + 7)
    assert (tmp_path / "out" / "border.png").stat().st_size > 5_000
    told = capsys.readouterr().out
    assert "Border of efficiency = 0.01, to within 0.2 V, between 8 and 150 V" in told
    assert "drive.frequency (Hz)" in told and "there is no border" not in told


def test_the_command_finds_where_another_metric_passes_a_level(command, dead, tmp_path, capsys):
    asked = ["--voltage", "8:40:5", "--frequency", "5,50", "--both-directions", "--border", "drive.voltage=0.2"]
    assert main([*command, *asked, "--border-at", "stroke=0.01 mm"]) == 0
    found = xarray.open_dataset(tmp_path / "out" / "border.nc", engine="scipy").load()
    assert found.border.dims == ("drive_frequency", "drive_direction")
    # A metric without a sign of its own begins at zero: 0.01 + 0.05 (voltage - ...) passes 1e-5 where it begins.
    np.testing.assert_allclose(found.border[0], 12.0 + 0.7 * 5.0 - 0.2, rtol=0.0, atol=0.1)
    assert np.isnan(found.border[1]).all()
    assert "At 2 of 4 points there is no border" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("asked", "essential"),
    [
        (["--border", "drive.voltage"], 'found "drive.voltage", expected a name and a number'),
        (["--border", "drive.fall_time=1 ms"], 'found no range for "drive.fall_time"'),
        (["--border", "drive.voltage=0.2 s"], "option --border"),
        (["--border", "drive.voltage=0.2", "--border-at", "spede=0"], 'unknown metric "spede"; did you mean "speed"'),
        (["--border", "drive.voltage=0.2", "--bands"], "found with --bands, expected without"),
        (["--border", "drive.voltage=0.2", "--resume"], "found with --resume, expected without"),
        (["--border", "drive.voltage=0.2", "--voltage", "8:40:x"], "FROM:TO or FROM:TO:COUNT"),
        (["--border", "drive.voltage=0.2", "--voltage", "40:8"], "expected the lower end first"),
    ],
)
def test_a_border_that_makes_no_sense_is_refused_in_a_line(command, dead, tmp_path, capsys, asked, essential):
    assert main([*command, "--voltage", "8:150", "--frequency", "5:50:10", *asked]) == 2
    told = capsys.readouterr().err.strip()
    assert essential in told and "\n" not in told and not dead and not (tmp_path / "out").exists()


def test_a_drive_without_flanks_is_warned_of_once(study, dead):
    moving = next(record for record in study.records if record.measurement.effector_free)
    triangle = dataclasses.replace(moving, drive=Triangle(60.0, 5.0), overrides={})
    study = dataclasses.replace(study, records=(triangle,))
    with pytest.warns(InputWarning, match="stroke, back-slip and efficiency are NaN") as said:
        find_border(study, "drive.voltage", (8.0, 150.0), {}, tolerance=1.0, metric="net_step", level=1e-8)
    assert len(said) == 1 and len(dead) > 3


@pytest.mark.slow
def test_the_border_of_the_example_is_that_of_its_sweep(study):
    found = find_border(study, "drive.voltage", (1.0, 20.0), {"drive.frequency": [20.0, 40.0]}, tolerance=0.2)
    for border, frequency in zip(found.border.values, [20.0, 40.0], strict=True):
        over = {"drive.voltage": [border - 0.2, border + 0.2], "drive.frequency": [frequency]}
        below, above = pdssjax.sweep(study, over).efficiency.values.ravel()
        assert below < 0.01 < above
