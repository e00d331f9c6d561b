"""Sets of points, what a sweep of them takes, and that every axis has an effect or is refused."""

import numpy as np
import pytest
from quick_blocks import example_study, study as study
from study_files import write_estimate
from walking_study import write_walking

import pdssjax
from pdssjax import InputError, load_study
from pdssjax.cli.main import main
from pdssjax.sweeps import (
    CovarianceDraws,
    Crossed,
    GivenDraws,
    Grid,
    LatinHypercube,
    Listed,
    Sobol,
    changes_a_sweep,
    driven_record,
    find_border,
    plan_sweep,
)
from pdssjax.sweeps.blocks import plan_blocks
from pdssjax.sweeps.execution import job_document, point_function

RANGES = {"drive.voltage": (20.0, 80.0), "drive.frequency": (2.0, 50.0)}


def test_a_grid_has_every_combination_the_last_axis_fastest():
    grid = Grid({"drive.voltage": [30.0, 64.0], "drive.frequency": [5.0, 23.0, 40.0]})
    assert grid.dimensions() == {"drive_voltage": 2, "drive_frequency": 3} and len(grid) == 6
    np.testing.assert_array_equal(grid.values()[:, 0], [30.0] * 3 + [64.0] * 3)
    np.testing.assert_array_equal(grid.values()[:, 1], [5.0, 23.0, 40.0] * 2)
    assert Grid({}).values().shape == (1, 0)


def test_a_list_has_its_points_as_they_are():
    listed = Listed({"drive.voltage": [30.0, 64.0], "drive.frequency": [5.0, 23.0]})
    assert listed.dimensions() == {"point": 2}
    np.testing.assert_array_equal(listed.values(), [[30.0, 5.0], [64.0, 23.0]])
    assert listed.coordinates()["drive.frequency"][0] == "point"


@pytest.mark.parametrize("kind", [Sobol, LatinHypercube])
def test_a_sample_fills_its_ranges_evenly_and_is_the_same_for_the_same_seed(kind):
    values = kind(RANGES, 32, seed=3).values()
    np.testing.assert_array_equal(values, kind(RANGES, 32, seed=3).values())
    assert not np.array_equal(values, kind(RANGES, 32, seed=4).values())
    for column, (low, high) in zip(values.T, RANGES.values(), strict=True):
        assert low <= column.min() and column.max() <= high
        # Both kinds put one point into each of 32 slices.
        assert set(np.floor(32 * (column - low) / (high - low)).astype(int)) == set(range(32))


def test_draws_have_the_covariance_of_the_estimate():
    means, errors = np.array([2.0, -1.0]), np.array([0.02, 0.05])
    covariance = np.outer(errors, errors) * np.array([[1.0, 0.6], [0.6, 1.0]])
    draws = CovarianceDraws(["a.b", "c.d"], means, covariance, np.array([True, False]), 20_000, seed=1)
    values = draws.values()
    assert (values[:, 0] > 0).all() and draws.dimensions() == {"draw": 20_000}
    np.testing.assert_allclose(values.mean(axis=0), means, atol=2e-3)
    np.testing.assert_allclose(np.cov(values.T), covariance, rtol=0.05)


def test_draws_made_elsewhere_are_taken_evenly():
    table = np.arange(20.0).reshape(10, 2)
    drawn = GivenDraws(["a.b", "c.d"], table, 4)
    assert drawn.dimensions() == {"draw": 4} and drawn.paths == ("a.b", "c.d")
    np.testing.assert_array_equal(drawn.values(), table[[0, 3, 6, 9]])
    np.testing.assert_array_equal(GivenDraws(["a.b", "c.d"], table, 200).values(), table)


def test_a_grid_crossed_with_a_sample_has_the_sample_at_every_point():
    crossed = Crossed(Grid({"drive.voltage": [30.0, 64.0]}), Sobol({"effector.load": (0.0, 0.1)}, 3))
    assert crossed.dimensions() == {"drive_voltage": 2, "point": 3}
    values = crossed.values().reshape(2, 3, 2)
    np.testing.assert_array_equal(values[0, :, 1], values[1, :, 1])
    np.testing.assert_array_equal(values[:, :, 0], [[30.0] * 3, [64.0] * 3])


@pytest.mark.parametrize(
    ("made", "essential"),
    [
        (lambda: Grid({"drive.voltage": []}), "expected some values"),
        (lambda: Grid({"drive.voltage": [1.0, np.inf]}), "finite"),
        (lambda: Listed({"drive.voltage": [1.0], "drive.frequency": [1.0, 2.0]}), "of one length"),
        (lambda: Sobol({"drive.voltage": (80.0, 20.0)}, 8), "80 to 20, expected the lower end first"),
        (lambda: Sobol({"drive.voltage": (20.0, 80.0)}, 0), "at least 1"),
        (lambda: Sobol({}, 8), "at least one path"),
        (lambda: LatinHypercube({"drive.voltage": (1.0, 2.0, 3.0)}, 8), "3 numbers"),
        (lambda: Crossed(Grid({"a.b": [1.0]}), Listed({"a.b": [1.0]})), "twice"),
        (lambda: Crossed(Listed({"a.b": [1.0]}), Listed({"a.c": [1.0]})), 'along "point"'),
        (lambda: CovarianceDraws(["a.b"], np.ones(1), np.full((1, 1), np.nan), np.ones(1, bool), 3), "no finite"),
        (lambda: GivenDraws(["a.b"], np.ones((3, 2))), "1 columns"),
        (lambda: GivenDraws(["a.b"], np.full((3, 1), np.nan)), "finite"),
        (lambda: GivenDraws(["a.b"], np.ones((3, 1)), 0), "at least 1"),
    ],
)
def test_what_is_no_set_of_points_is_refused(made, essential):
    with pytest.raises(InputError, match="sweep") as refused:
        made()
    assert essential in str(refused.value)


def test_a_plan_holds_every_point_once_in_whole_blocks_of_like_frequency():
    grid = Grid({"drive.frequency": np.linspace(50.0, 2.0, 25), "drive.voltage": np.linspace(20.0, 80.0, 5)})
    plan = plan_blocks(grid.paths, grid.values(), lanes=8)
    assert plan.blocks == 16 and sorted(plan.order) == list(range(125))
    np.testing.assert_array_equal(plan.values, grid.values()[plan.order])
    assert (np.diff(plan.values[:, 0]) >= 0).all()
    assert {plan.block(number).shape for number in range(plan.blocks)} == {(8, 2)}
    last = plan.block(15)
    np.testing.assert_array_equal(last[5:], np.repeat(last[4:5], 3, axis=0))


def test_points_blocks_and_room_are_printed_and_nothing_is_made(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("pdssjax.cli.sweep.study_of", lambda options: example_study())
    axes = ["--vary", "drive.frequency=5:20:3", "--vary", "drive.fall_time=1 ms:100 ms:40"]
    assert main(["sweep", "study.toml", "--out", str(tmp_path / "out"), *axes, "--explain"]) == 0
    lines = capsys.readouterr().out.split("\n")
    assert lines[1].split() == ["points", "120", "28", "of", "them", "skipped"]
    assert lines[2].split()[:4] == ["blocks", "2", "of", "64"]
    assert lines[3].split()[-3:] == ["MB", "at", "most"]
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "over",
    [
        {"amplifier.bandwidth": [100.0, 1e4]},
        {"amplifier.bandwidth": [100.0], "amplifier.slew": [1e4, 1e5]},
        Sobol({"amplifier.bandwidth": (100.0, 1e3)}, 4),
    ],
    ids=["bandwidth", "slew, too", "sample"],
)
def test_an_amplifier_that_the_study_has_not_is_put_before_the_stack(study, over):
    function = plan_sweep(study, over).function
    values = plan_sweep(study, over).points.values()[0]
    amplifier = function.system(values).actuator.amplifier
    assert float(amplifier.bandwidth) == values[0]
    # Another process makes the same of the job.
    again = point_function(job_document(function))
    assert float(again.system(values).actuator.amplifier.bandwidth) == values[0]
    assert plan_sweep(study, {"drive.voltage": [60.0]}).function.system(np.array([60.0])).actuator.amplifier is None


@pytest.mark.parametrize(
    ("over", "says"),
    [
        ({"sensor.bandwidth": [50.0, 1e4]}, "not the sensor's reading"),
        ({"sensor.delay": [0.0, 1e-3]}, "not the sensor's reading"),
        ({"stop.stiffness": [1e4, 1e5]}, "--metrics output_force"),
        ({"piezo.mass": [0.1, 1.0]}, r"feedback = true in \[actuator\]"),
        ({"amplifier.slew": [1e4, 1e5]}, 'without "amplifier.bandwidth"'),
        (Sobol({"sensor.bandwidth": (50.0, 1e4)}, 4), "sensor.bandwidth"),
    ],
)
def test_an_axis_that_would_change_nothing_is_refused(study, over, says):
    with pytest.raises(InputError, match=says) as refused:
        plan_sweep(study, over)
    assert str(refused.value).startswith("sweep: found ")


def test_an_axis_takes_effect_where_what_it_needs_is_asked_for(study):
    plan_sweep(study, {"stop.stiffness": [1e4, 1e5]}, metrics=["output_force"])
    with pytest.raises(InputError, match="output_force"):
        plan_sweep(study, {"stop.stiffness": [1e4, 1e5]})


def test_a_border_and_a_derivative_along_what_changes_nothing_are_refused(study):
    with pytest.raises(InputError, match="sensor's reading"):
        find_border(study, "sensor.bandwidth", (50.0, 1e4), {}, tolerance=10.0)
    listed = study.with_values({"sensor.bandwidth": 1e3})
    with pytest.raises(InputError, match="sensor's reading"):
        plan_sweep(listed, {"drive.voltage": [60.0]}, derivatives=["sensor.bandwidth"])
    assert not changes_a_sweep("sensor.bandwidth", listed, ()) and changes_a_sweep("piezo.gain", listed, ())


def test_draws_of_what_is_known_may_hold_what_changes_nothing(study):
    """A band by a parameter without effect has no width, which is right."""
    listed = study.with_values({"sensor.bandwidth": 1e3})
    about = CovarianceDraws(["sensor.bandwidth"], np.array([1e3]), np.array([[100.0]]), np.array([True]), 5)
    assert len(plan_sweep(listed, Crossed(Grid({"drive.voltage": [60.0]}), about)).points) == 5


FALL = '"drive.fall_time" = { value = 0 }\n'
LOCAL = '"drive.fall_time@slow" = { start = "0.4 ms" }\n"piezo.gain@other" = { start = "0.2 um/V" }\n'


@pytest.fixture
def written(tmp_path):
    """The walking rig, with a fall time of its own in the record that walks, and a gain in the one that steps."""
    file = write_walking(tmp_path)
    head, step, walk = file.read_text().replace(FALL, FALL + LOCAL).split("[[record]]")
    file.write_text("[[record]]".join([head, step + 'conditions = ["other"]\n', walk + 'conditions = ["slow"]\n']))
    return file


def test_numbers_are_those_of_the_record(written):
    planned = plan_sweep(load_study(written), {"drive.voltage": np.array([50.0, 64.0])})
    assert not any("@" in path for path in planned.used)
    assert planned.used["drive.fall_time"]["value"] == pytest.approx(4e-4)
    assert planned.used["piezo.gain"]["value"] == pytest.approx(1e-7)


def test_a_voltage_is_the_peak_however_the_record_tells_it(written):
    """By the slope of slow flanks 64 V would be 63.5 V with a flank of 0.4 ms at 20 Hz."""
    text = written.read_text()
    (line,) = [line for line in text.splitlines() if line.startswith("drive = ") and "sawtooth" in line]
    written.write_text(text.replace(line, line.replace("{ ", '{ told_by = "slope", ', 1)))
    drive = driven_record(load_study(written), None).drive
    assert (drive.told_by, drive.fall_time) == (0.0, pytest.approx(4e-4))
    assert drive.voltage == pytest.approx(64.0 * (1.0 - 4e-4 * 20.0))


class Asked(Exception):
    """What a sweep was asked for."""


@pytest.fixture
def asked(monkeypatch):
    def sweep(study, points, **options):
        raise Asked(study, points, options)

    monkeypatch.setattr(pdssjax, "sweep", sweep)


@pytest.fixture
def estimate(written, tmp_path):
    """An estimate.json that knows the numbers of the study to 1 %."""
    values = load_study(written).values()
    names = ["piezo.gain", "piezo.gain@other", "drive.fall_time", "drive.fall_time@slow", "drive.rise_time"]
    matrix = np.diag([(0.01 * values.get(name, 1.0)) ** 2 for name in names]).tolist()
    return write_estimate(tmp_path, values, covariance={"names": names, "matrix": matrix})


@pytest.mark.parametrize("option", ["--bands", "--derivatives"])
def test_bands_and_derivatives_are_by_what_holds_there(written, estimate, tmp_path, asked, option):
    command = ["sweep", str(written), "--voltage", "20,40", "--frequency", "20", "--estimate", str(estimate), option]
    with pytest.raises(Asked) as caught:
        main([*command, "--out", str(tmp_path / "swept")])
    study, points, options = caught.value.args
    plan_sweep(study, points, **{name: options[name] for name in ("record", "cycles", "metrics", "derivatives")})
    if option == "--derivatives":
        assert set(options["derivatives"]) == set(study.for_record(study.records[1]).parameters)
        return
    assert set(points.paths) == {"drive.voltage", "drive.frequency", "piezo.gain", "drive.fall_time"}
    falls = points.values()[:, points.paths.index("drive.fall_time")]
    assert np.median(falls) == pytest.approx(4e-4) and np.ptp(falls) > 1e-6
