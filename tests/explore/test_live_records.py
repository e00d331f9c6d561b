"""The record shown is predicted as a fit predicts it, and anew only where it must be; a sweep as points on a map."""

import dataclasses
import json
from typing import NamedTuple

import measured_study
import numpy as np
import pytest
import xarray
from marks import slow
from walking_study import made_sweep, write_made_sweep, write_walking

from pdssjax import InputError, load_study
from pdssjax.explore import live_record
from pdssjax.explore.live_record import LiveRecords, clipped_stretch, initial_stretch, instants_of
from pdssjax.explore.settings import settings_of, study_at
from pdssjax.explore.sweep_map import PointSimulation, is_grid, small_map, sweep_map, ticks_along, tiles_along
from pdssjax.files import read_sweep
from pdssjax.study.measurement.friction import Friction


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return load_study(write_walking(tmp_path_factory.mktemp("rig")))


@pytest.fixture(scope="module")
def records(study):
    return LiveRecords(study)


def redrawn(records, name, settings):
    record = next(r for r in records.study.records if r.name == name)
    return record, records.redraw(name, settings, instants_of(record, *initial_stretch(record)))


TURNED = {"piezo.gain": 1.13e-7, "effector.mass": 0.1, "friction.f_ss": 0.5, "drive.fall_time": 1e-3}


def turned_settings(study):
    return settings_of(study).with_values(TURNED).with_drive("walk", "drive.frequency", 16.0)


@pytest.fixture(scope="module")
def turned(study):
    """What a fit predicts of each record at the numbers `TURNED`."""
    predicted = study_at(study, turned_settings(study)).predict()
    return {record.name: np.asarray(motion) for record, motion in zip(study.records, predicted, strict=True)}


@pytest.mark.parametrize("name", [slow("step"), "walk"])
def test_it_is_what_a_fit_predicts(study, records, turned, name):
    record, found = redrawn(records, name, turned_settings(study))
    assert records.is_ready(name)
    expected = turned[name]
    assert found.predicted - found.score.offset == pytest.approx(expected, abs=2e-9)
    assert found.residual == pytest.approx(record.measured - found.predicted)
    squares = np.sum(found.residual**2) / found.score.noise**2
    assert found.score.chi2 == pytest.approx(squares / (record.time.size - 1))
    assert found.score.noise_given == (name == "step")
    at_samples = np.interp(record.time, found.instants, found.between)
    assert np.median(np.abs(at_samples - found.predicted)) < 0.01 * np.ptp(found.predicted)


def test_inside_the_end_effector_stands_on_the_platform(study, records):
    _, found = redrawn(records, "walk", settings_of(study))
    inside = found.inside
    assert np.ptp(inside.voltage) == pytest.approx(64.0, rel=0.02)
    effector = inside.platform - inside.relative
    assert effector + found.score.offset == pytest.approx(found.between, abs=1e-12)
    assert np.max(np.abs(inside.friction)) < 2.0


def test_a_platform_alone_has_no_contact(study, records):
    _, found = redrawn(records, "step", settings_of(study))
    assert np.isnan(found.inside.friction).all()
    assert np.isfinite(found.inside.platform_velocity).all()


def test_at_once_nothing_is_compiled(study):
    fresh = LiveRecords(study)
    record = study.records[0]
    instants = instants_of(record, *initial_stretch(record))
    assert fresh.redraw_at_once("step", settings_of(study), instants) is None
    first = fresh.redraw("step", settings_of(study), instants)
    again = fresh.redraw_at_once("step", settings_of(study), instants)
    assert again is not None
    assert np.array_equal(again.predicted, first.predicted)


def test_a_drive_of_more_segments_than_a_page_can_hold_is_refused_before_anything_is_compiled(study):
    fresh, settings = LiveRecords(study), settings_of(study).with_drive("walk", "drive.frequency", 1e9)
    walk = study.records[1]
    with pytest.raises(InputError, match=r'record "walk": found a drive of 4.99e\+08 segments within the record'):
        fresh.redraw("walk", settings, instants_of(walk, *initial_stretch(walk)))


class Run(NamedTuple):
    """What is asked of a run here."""

    failure: int


def test_numbers_that_take_many_steps_do_not_slow_down_the_others(study, monkeypatch):
    needs, given = {"steps": 300}, []

    def run(setup, models, run, values, instants, accuracy, segments):
        given.append(accuracy.max_steps)
        return Run(live_record.OUT_OF_STEPS if accuracy.max_steps < needs["steps"] else 0)

    monkeypatch.setattr(live_record, "observed", run)
    monkeypatch.setattr(live_record, "steps_taken", lambda *asked: needs["steps"])
    walk, values = study.records[1], study.values()
    live = live_record.LiveRecord(study, walk, values)
    instants = instants_of(walk, *initial_stretch(walk))
    assert live.run(walk, values, instants).failure == 0
    needs["steps"] = 1000
    assert live.run_at_once(walk, values, instants) is None
    assert live.run(walk, values, instants).failure == 0
    many = given[-1]
    assert many > given[0]
    assert live.run_at_once(walk, values, instants).failure == 0
    assert given[-1] == many
    needs["steps"] = 300
    assert live.run_at_once(walk, values, instants).failure == 0
    assert given[-1] == given[0]


def test_a_contact_alone_has_a_loop(tmp_path):
    (tmp_path / "plan.toml").write_text(measured_study.study(measured_study.record(Friction())))
    study = load_study(tmp_path / "plan.toml", virtual=True)
    record, found = redrawn(LiveRecords(study), "friction", settings_of(study))
    assert found.predicted - found.score.offset == pytest.approx(np.asarray(study.predict()[0]), abs=1e-5)
    assert np.interp(record.time, found.instants, found.inside.relative) == pytest.approx(record.motion, abs=2e-8)
    assert np.isnan(found.inside.voltage).all()


def test_the_stretch_enlarged_stays_within_the_record(study):
    walk = study.records[1]
    begin, end = initial_stretch(walk)
    assert walk.time[0] <= begin < end <= walk.time[-1]
    assert clipped_stretch(walk, -1.0, -0.9) == pytest.approx((0.0, 0.1))
    assert clipped_stretch(walk, 0.2, 0.3) == pytest.approx((walk.time[-1] - 0.1, walk.time[-1]))
    assert clipped_stretch(walk, -5.0, 5.0) == (walk.time[0], walk.time[-1])


def test_a_point_walks_with_its_numbers(study):
    simulation = PointSimulation(study, None)
    walk = simulation.motion({"drive.voltage": 64.0, "drive.frequency": 25.0, "friction.f_ss": 0.65})
    assert walk.message == ""
    assert walk.time[-1] == pytest.approx(5 / 25.0)
    assert walk.voltage.max() == pytest.approx(64.0, rel=0.01)
    assert walk.effector[-1] > 2e-6


def test_without_an_end_effector_there_is_nothing_to_sweep(study):
    alone = dataclasses.replace(study, records=study.records[:1])
    with pytest.raises(InputError, match="found no effector record under a periodic drive"):
        small_map(alone, settings_of(alone), lambda line: None, "step")


@pytest.mark.parametrize(("chosen", "mapped"), [("fast", "fast"), ("walk", "walk"), ("step", "walk")])
def test_a_small_map_is_of_the_record_chosen_where_that_walks(study, monkeypatch, chosen, mapped):
    step, walk = study.records
    fast = dataclasses.replace(walk, name="fast", drive=walk.drive.with_numbers({"frequency": 80.0}))
    both = dataclasses.replace(study, records=(step, walk, fast))
    asked = []
    monkeypatch.setattr(
        "pdssjax.explore.sweep_map.sweep", lambda study, points, record, progress: asked.append((record, points))
    )
    small_map(both, settings_of(both), lambda line: None, chosen)
    ((record, points),) = asked
    assert record == mapped
    frequency = {"walk": 20.0, "fast": 80.0}[mapped]
    assert np.median(points.axes["drive.frequency"]) == pytest.approx(frequency)


def test_every_point_has_its_coordinates_its_metrics_and_its_numbers():
    found = sweep_map(made_sweep())
    assert list(found.axes) == ["drive.voltage", "drive.frequency"]
    assert found.axes["drive.frequency"].label == "drive.frequency (Hz)"
    label, speed = found.metrics["speed"]
    assert label == "average speed (µm/s)"
    assert speed[5] == pytest.approx(0.1 * 25 * 40)
    assert found.metrics["efficiency"][0] == "step efficiency (%)"
    assert "failure" not in found.metrics
    numbers = found.numbers(5)
    assert numbers == {"drive.voltage": 45, "drive.frequency": 40, "effector.mass": 0.086, "drive.direction": 1}
    assert found.record == "walk"
    assert is_grid(found, ["drive.voltage", "drive.frequency"])


def test_a_map_goes_through_the_point_chosen():
    data = made_sweep().expand_dims(friction_f_ss=[0.5, 0.7])
    data["friction_f_ss"].attrs = {"units": "N", "long_name": "friction.f_ss"}
    found = sweep_map(data)
    chosen = found.slice_of(["drive.voltage", "drive.frequency"], 15)
    assert chosen.sum() == 12
    assert set(found.axes["friction.f_ss"].values[chosen]) == {0.7}
    assert found.numbers(15)["friction.f_ss"] == 0.7


def test_an_axis_of_one_value_is_held():
    found = sweep_map(made_sweep(frequencies=(20.0,)))
    assert list(found.axes) == ["drive.voltage"]
    assert found.numbers(0)["drive.frequency"] == 20.0


def test_a_sample_is_no_grid():
    volts = np.array([30.0, 40.0, 55.0, 61.0])
    data = xarray.Dataset(
        {"speed": ("sample", volts, {"units": "m/s", "long_name": "average speed"})},
        {
            "drive_voltage": ("sample", volts, {"units": "V", "long_name": "drive.voltage"}),
            "drive_frequency": ("sample", volts[::-1].copy(), {"units": "Hz", "long_name": "drive.frequency"}),
        },
        {"record": "walk", "parameters": json.dumps({})},
    )
    assert not is_grid(sweep_map(data), ["drive.voltage", "drive.frequency"])


def test_tiles_reach_half_way_to_their_neighbours():
    linear = tiles_along(np.array([0.0, 1.0, 2.0, 4.0]))
    assert linear.low.tolist() == [-0.5, 0.5, 1.5, 3.0]
    assert linear.high.tolist() == [0.5, 1.5, 3.0, 5.0]
    assert not linear.logarithmic
    ratios = tiles_along(np.array([1.0, 4.0, 2.0, 1.0]))
    assert ratios.logarithmic
    assert ratios.high / ratios.low == pytest.approx(np.full(4, 2.0))


def test_a_sweep_is_read_back_and_what_is_none_is_refused(tmp_path):
    folder = write_made_sweep(tmp_path / "map")
    assert sweep_map(read_sweep(folder)).axes.keys() == {"drive.voltage", "drive.frequency"}
    with pytest.raises(InputError, match=r"found no sweep\.nc or sweep\.zarr, expected the results of pdssjax sweep"):
        read_sweep(tmp_path)
    (tmp_path / "sweep.nc").write_bytes(b"no netCDF")
    with pytest.raises(InputError, match=r"sweep\.nc: cannot be read"):
        read_sweep(tmp_path)


@pytest.fixture
def shown_plots():
    """The map of a made-up sweep, and the walk beside it."""
    pn = pytest.importorskip("panel")
    from pdssjax.explore.widgets.sweep_tab import SweepTab

    tab = SweepTab(lambda point: None, lambda: None, lambda: None)
    tab.show(sweep_map(made_sweep()))
    return [pane.object for pane in tab.view.select(pn.pane.Bokeh)]


def test_the_map_names_its_record(shown_plots):
    assert "walk: average speed (µm/s); click a point" in [plot.title.text for plot in shown_plots]


def test_an_axis_at_equal_ratios_has_ticks_to_read(shown_plots):
    assert shown_plots[0].yaxis[0].ticker.ticks == [10.0, 20.0, 50.0]
    assert ticks_along(np.geomspace(5.0, 80.0, 9)) == [5.0, 10.0, 20.0, 50.0]
    assert ticks_along(np.geomspace(0.5, 2000.0, 9)) == [1.0, 10.0, 100.0, 1000.0]
