"""Further metrics and derivatives of a sweep: what is asked for, refused, and told; derivatives against differences."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray
from parts import Sawtooth, SecondOrder, Stribeck
from quick_blocks import found_at, study as study
from study_files import write_estimate

import pdssjax
from pdssjax import Accuracy, Actuator, InputError
from pdssjax.cli.main import main
from pdssjax.files import EXAMPLE
from pdssjax.report.figures import directions_figure
from pdssjax.report.text import format_sweep
from pdssjax.simulation import STOP_FORCE, StickSlip, sensor_samples
from pdssjax.sweeps import FURTHER, Listed, compared_directions, execution, plan_sweep
from pdssjax.sweeps.blocks import GRAZING, INCOMPLETE, POINT_FAILURES
from pdssjax.sweeps.cycles import Numbered
from pdssjax.sweeps.execution import job_document, point_function
from pdssjax.sweeps.further_metrics import peak_friction
from pdssjax.sweeps.point import compute_block, per_unit

DRIVES = {"drive.voltage": [64.0, 120.0], "drive.frequency": [50.0, 150.0]}
STOP = {"stop.stiffness": [1e5, 1e5]}
BY = ("piezo.gain", "friction.f_ss_a", "drive.frequency")
SMOOTH = ("net_step", "speed", "efficiency", "stroke", "back_slip")


def test_a_job_with_metrics_and_derivatives_is_rebuilt_from_its_text(study):
    planned = plan_sweep(study, DRIVES | STOP, metrics=("output_force",), derivatives=BY)
    assert job_document(point_function(json.loads(json.dumps(planned.document)))) == planned.document
    assert len(planned.document["metrics"]) == 6 + 6 * len(BY)
    assert "further" not in plan_sweep(study, DRIVES).document, "stores of plain sweeps are to stay those of today"
    column = planned.function.columns["speed_by_piezo_gain"]
    assert column.by == "piezo.gain" and column.unit == "(m/s)/(m/V)"
    assert planned.function.numbers["piezo.gain"] == study.values()["piezo.gain"]


@pytest.mark.parametrize(
    ("unit", "of", "found"), [("m", "V", "m/V"), ("1", "Hz", "1/Hz"), ("N", "N s/m", "N/(N s/m)"), ("m", "", "m")]
)
def test_units_of_derivatives_can_be_read(unit, of, found):
    assert per_unit(unit, of) == found


@pytest.mark.parametrize(
    ("asked", "essential"),
    [
        (dict(metrics=["peak_frictoin"]), 'did you mean "peak_friction"'),
        (dict(metrics=["speed"]), 'found the metric "speed" twice'),
        (dict(metrics=["reversals", "reversals"]), 'found the metric "reversals" twice'),
        (dict(metrics=["multiplier"]), 'expected cycles = "steady"'),
        (dict(metrics=["output_force"]), 'without "stop.stiffness"'),
        (dict(derivatives=["piezo.gian"]), 'did you mean "piezo.gain"'),
        (dict(derivatives=["drive.direction"]), "found a choice between forward and backward"),
        (dict(derivatives=["piezo.gain", "piezo.gain"]), "found it twice"),
        (dict(derivatives=["stop.stiffness"]), "found no number for it"),
    ],
)
def test_what_cannot_be_found_is_refused_before_any_work(study, monkeypatch, asked, essential):
    monkeypatch.setattr(execution, "compute_block", lambda *given: pytest.fail("computed for nothing"))
    with pytest.raises(InputError) as refused:
        pdssjax.sweep(study, DRIVES, **asked)
    assert essential in str(refused.value) and "\n" not in str(refused.value)


def test_a_point_whose_details_fail_keeps_its_cycle_and_says_so(study, monkeypatch):
    planned = plan_sweep(study, DRIVES, metrics=("reversals",), derivatives=("piezo.gain",))
    monkeypatch.setattr("pdssjax.sweeps.point._side_by_side", lambda f, p: (np.ones((len(p), 5)), np.zeros(len(p))))
    asked = []

    def detailed(function, points):
        asked.append(np.asarray(points))
        return np.ones((len(points), 6)), (np.asarray(points)[:, 0] > 100.0).astype(int)

    monkeypatch.setattr("pdssjax.sweeps.point._details", detailed)
    points = np.array([[64.0, 50.0], [120.0, 150.0], [80.0, 5.0], *[[80.0, 5.0]] * 61])
    found = compute_block(planned.function, points)
    assert found[:3, -1].tolist() == [0, INCOMPLETE, 0] and len(POINT_FAILURES) == GRAZING + 1
    assert np.isfinite(found[:3, :5]).all() and np.isnan(found[1, 5:-1]).all() and np.isfinite(found[2]).all()
    # What fills up a block is not looked at.
    assert len(asked) == 1 and np.isfinite(found[3:]).all()


def test_a_point_that_grazes_keeps_its_metrics_and_says_so(study, monkeypatch):
    """Found by Newton's method, or seen where derivatives are asked for."""
    planned = plan_sweep(study, DRIVES, cycles="steady", metrics=("reversals",), derivatives=("piezo.gain",))
    # The first repeats at once, the second grazes, the third was left to Newton's method and grazes.
    first = np.array([[1.0] * 5 + [repeats, 0.5] for repeats in (1.0, 1.0, 0.0)])
    blocks = {
        "_side_by_side": lambda f, p: (first, np.zeros(3)),
        "_one_by_one": lambda f, p: (np.full((len(p), 7), 2.0), np.full(len(p), GRAZING)),
        "_details": lambda f, p: (
            np.where((np.arange(6) > 0) & (np.asarray(p)[:, :1] > 70.0), np.nan, 4.0),
            np.where(np.asarray(p)[:, 0] > 70.0, GRAZING, 0),
        ),
    }
    for name, instead in blocks.items():
        monkeypatch.setattr(f"pdssjax.sweeps.point.{name}", instead)
    found = compute_block(planned.function, np.array([[64.0, 50.0], [80.0, 50.0], [120.0, 150.0]]))
    assert found[:, -1].tolist() == [0, GRAZING, GRAZING]
    np.testing.assert_array_equal(found[:, 0], [1.0, 1.0, 2.0])
    # The reversals are there, the derivatives are not.
    np.testing.assert_array_equal(found[:, 7], 4.0)
    np.testing.assert_array_equal(np.isnan(found[:, 8:-1]), np.array([[False], [True], [True]]).repeat(5, axis=1))


def both_ways(ratio):
    """A sweep of both directions; backward is slower by a ratio."""
    voltage, frequency = np.linspace(10.0, 80.0, 8), np.linspace(5.0, 50.0, 6)
    speed = (np.maximum(voltage[:, None] - 20.0 - 0.2 * frequency, 0.0) * 1e-6)[..., None] * np.array([1.0, -ratio])
    dims = ("drive_voltage", "drive_frequency", "drive_direction")
    said = {"units": "m/s", "long_name": "average speed"}
    found = dict.fromkeys(("speed", "net_step", "stroke", "back_slip"), (dims, speed, said))
    found["efficiency"] = (dims, np.abs(speed) / 1e-4, {"units": "1", "long_name": "step efficiency"})
    found["failure"] = (dims, np.zeros(speed.shape, np.int8), {"meanings": ""})
    axes = {name: (name, values, {"units": unit, "long_name": name}) for name, values, unit in
            zip(dims, (voltage, frequency, np.array([1.0, -1.0])), ("V", "Hz", "1"), strict=True)}  # fmt: skip
    return xarray.Dataset(found, axes, {"title": "Rig", "record": "5 Hz"})


def test_directions_are_compared_along_their_drives():
    data = both_ways(0.5)
    found = compared_directions(data)
    moves = (data.speed.sel(drive_direction=1.0) > 0).values
    np.testing.assert_allclose(found.asymmetry.values[moves], 2.0 / 3.0)
    assert np.isnan(found.asymmetry.values[~moves]).all() and found.sizes == {"drive_voltage": 8, "drive_frequency": 6}
    np.testing.assert_allclose(found.speed_difference, 0.5 * data.speed.sel(drive_direction=1.0))
    assert found.speed_difference.attrs["units"] == "m/s"
    # Backward moves forward, too: the wrong way.
    np.testing.assert_allclose(compared_directions(both_ways(-0.5)).asymmetry.values[moves], 2.0)
    with pytest.raises(InputError, match="no two directions"):
        compared_directions(data.isel(drive_direction=[0]))


def test_the_report_says_where_a_direction_moves_the_wrong_way():
    moves = int((both_ways(0.5).speed.sel(drive_direction=1.0) > 0).sum())
    told = format_sweep(both_ways(0.5))
    assert "Backward is 0.5 times as fast as forward in the median, 0.5 to 0.5 times" in told
    assert f"{moves} of 48 points" in told and "wrong way" not in told
    assert f"Driven backward it moves the wrong way at {moves} of 48 points." in format_sweep(both_ways(-0.5))


@pytest.mark.parametrize("cut", [{}, {"drive_frequency": 2}])
def test_directions_are_drawn_beside_each_other(cut):
    figure = directions_figure(both_ways(0.5).isel(cut))
    panels = [axes for axes in figure.axes if axes.get_label() != "<colorbar>"]
    assert len(panels) == (2 if cut else 3)
    if cut:
        np.testing.assert_allclose(panels[1].lines[0].get_ydata()[-1], 100.0 * 2.0 / 3.0)


def test_the_command_asks_for_metrics_and_derivatives(study, tmp_path, monkeypatch, capsys):
    seen = []

    def compute_block(function, points):
        seen.append(function)
        row = found_at(points)
        return np.column_stack([row[:, :5], np.ones((len(points), len(function.columns) - 5)), row[:, -1]])

    monkeypatch.setattr(execution, "compute_block", compute_block)
    estimate = write_estimate(tmp_path, study.values())
    command = ["sweep", str(EXAMPLE / "study.toml"), "--voltage", "20:80:3", "--estimate", str(estimate)]
    asked = ["--metrics", "all", "--derivatives", "piezo.gain, drive.frequency", "--both-directions"]
    assert main([*command, *asked, "--out", str(tmp_path / "out")]) == 0
    assert seen[0].further == tuple(n for n in FURTHER if n not in ("multiplier", "output_force"))
    data = xarray.open_dataset(tmp_path / "out" / "sweep.nc", engine="scipy").load()
    assert data["net_step_by_drive_frequency"].attrs["by"] == "drive.frequency"
    assert (tmp_path / "out" / "directions.png").stat().st_size > 10_000
    assert "peak of the friction force in a cycle" in capsys.readouterr().out
    assert main([*command, "--metrics", "speeed", "--out", str(tmp_path / "other")]) == 2
    assert "unknown metric" in capsys.readouterr().err and not (tmp_path / "other").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cycles", "names"),
    [(4, ("output_force", "peak_friction")), ("steady", ("peak_friction",)), ("steady", ("output_force",))],
)
def test_derivatives_are_those_of_central_differences(study, cycles, names):
    fine = dict(accuracy=Accuracy(max_steps=4096), metrics=names, workers=1)
    here = {path: np.full(2, study.values().get(path, np.nan)) for path in BY} | DRIVES
    if "output_force" in names:  # nothing else depends on a stop
        here |= STOP
    found = pdssjax.sweep(study, Listed(here), cycles=cycles, derivatives=BY, **fine)
    assert not found.failure.any()
    parts, rows = (-2, -1, 1, 2), []
    for path in BY:
        rows += [here | {path: (1.0 + 1e-4 * part) * np.asarray(here[path])} for part in parts]
    # These are steady at last by the 32nd cycle (the force at 150 Hz is 5e-7 N away after 16): another way to them.
    late = 32 if cycles == "steady" else cycles
    points = Listed({path: np.concatenate([row[path] for row in rows]) for path in here})
    moved = pdssjax.sweep(study, points, cycles=late, **fine)
    for i, path in enumerate(BY):
        for name in (*SMOOTH, *names):
            at = dict(zip(parts, moved[name].values.reshape(len(BY), len(parts), 2)[i], strict=True))
            wide, narrow = ((at[k] - at[-k]) / (2e-4 * k * np.asarray(here[path])) for k in (2, 1))
            slope = found[f"{name}_by_{path.replace('.', '_')}"].values
            # What hardly depends on a number is compared on the scale of metric by number.
            floor = 1e-5 * np.abs(found[name].values / np.asarray(here[path]))
            assert (np.abs(slope - (4 * narrow - wide) / 3) <= 1e-5 * np.abs(slope) + floor).all(), (name, path)


@pytest.mark.slow
def test_the_output_force_is_that_of_a_single_run_against_the_stop(study):
    data = pdssjax.sweep(study, Listed(DRIVES | STOP), metrics=("output_force",), workers=1)
    function = plan_sweep(study, Listed(DRIVES | STOP), metrics=("output_force",)).function
    for i, row in enumerate(Listed(DRIVES | STOP).values()):
        system = function.system(jnp.asarray(row), blocked=True)
        assert isinstance(system, StickSlip)
        period, fall = 1.0 / row[1], system.drive.flanks().fast
        # A line through the plateau of the fourth cycle tells the end of its flank, whether six samples or many.
        for count, apart in ((6, 1e-6), (401, 0.02)):
            parts = np.linspace(0.751, 0.949, count)
            times = jnp.asarray(3.0 * period + fall + (period - fall) * parts)
            pushed = np.asarray(sensor_samples(system, times, Accuracy(max_steps=20_000), STOP_FORCE))
            line = np.polyfit(parts - 1.0, pushed, 1)
            assert float(data.output_force[i]) == pytest.approx(line[1], rel=apart)


@pytest.mark.slow
def test_where_reversals_come_and_go_one_grazes(study):
    sweep = lambda volts: pdssjax.sweep(
        study, {"drive.voltage": volts, "drive.frequency": [150.0]}, metrics=("reversals", "grazing"), workers=1
    )
    coarse = sweep(np.linspace(40.0, 140.0, 60))
    counts = coarse.reversals.values.ravel()
    change = int(np.flatnonzero(np.diff(counts))[0])
    low, high = coarse.drive_voltage.values[change : change + 2]
    for _ in range(4):
        volts = np.linspace(low, high, 8)
        found = sweep(volts)
        inside = int(np.flatnonzero(np.diff(found.reversals.values.ravel()))[0])
        low, high = volts[inside], volts[inside + 1]
    assert float(found.grazing.min()) < 0.1 * float(coarse.grazing.median())


@pytest.mark.slow
def test_peak_friction_has_the_derivatives_of_central_differences_at_random_actuators(study):
    rng, by = np.random.default_rng(3), ("piezo.gain", "friction.sigma0_a", "friction.sigma1_a", "friction.f_ss_a")
    here = {path: np.asarray(study.values()[path]) * np.exp(rng.uniform(-0.2, 0.2, 6)) for path in by}
    here |= {"drive.voltage": rng.uniform(15.0, 140.0, 6), "drive.frequency": 10 ** rng.uniform(0.7, 2.3, 6)}
    asked = dict(metrics=("peak_friction",), workers=1)
    found = pdssjax.sweep(study, Listed(here), derivatives=by, **asked)
    assert not found.failure.any()
    parts = (-2, -1, 1, 2)
    rows = [here | {path: (1.0 + 1e-4 * part) * here[path]} for path in by for part in parts]
    moved = pdssjax.sweep(study, Listed({path: np.concatenate([row[path] for row in rows]) for path in here}), **asked)
    peaks = moved.peak_friction.values.reshape(len(by), len(parts), 6)
    for path, at in zip(by, peaks, strict=True):
        wide, narrow = (at[3] - at[0]) / (4e-4 * here[path]), (at[2] - at[1]) / (2e-4 * here[path])
        slope = found[f"peak_friction_by_{path.replace('.', '_')}"].values
        expected, scale = (4 * narrow - wide) / 3, found.peak_friction.values / here[path]
        assert (np.abs(slope - expected) <= 1e-5 * np.abs(slope) + 1e-7 * scale).all(), path


@pytest.mark.slow
def test_a_peak_at_a_breakaway_moves_with_the_event():
    """A contact that sticks lets go at its static force: that is the peak, and nothing else changes it."""

    def peak(numbers):
        f_s, f_c, voltage, damping = numbers
        actuator = Actuator(SecondOrder(damping_ratio=damping), Stribeck(f_c=f_c, f_s=f_s))
        system, cycle = StickSlip(actuator, Sawtooth(voltage, 20.0, 5e-4)), Numbered(2)
        return peak_friction(cycle.course(system, cycle.opening(system)))

    numbers = jnp.array([0.65, 0.55, 80.0, 0.1772])
    height, slopes = jax.jit(lambda n: (peak(n), jax.jacfwd(peak)(n)))(numbers)
    assert float(height) == pytest.approx(0.65, rel=1e-9)
    np.testing.assert_allclose(slopes * numbers / 0.65, [1.0, 0.0, 0.0, 0.0], rtol=0.0, atol=1e-6)
