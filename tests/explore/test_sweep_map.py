"""A sweep as points on a map."""

import json

import numpy as np
import pytest
import xarray
from walking_study import made_sweep, write_made_sweep

from pdssjax import InputError
from pdssjax.explore.sweep_map import is_grid, sweep_map, ticks_along, tiles_along
from pdssjax.files import read_sweep


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
