"""What a sweep found is told and drawn so that the extremes, their places and what failed can be read off."""

import itertools
import json

import numpy as np
import pytest
import xarray

from pdssjax import InputError
from pdssjax.files import read_sweep, write_sweep
from pdssjax.report.figures import directions_figure, sweep_figure
from pdssjax.report.text import format_sweep
from pdssjax.sweeps import GRAZING, POINT_FAILURES

UNITS = {"speed": "m/s", "net_step": "m", "efficiency": "1", "stroke": "m", "back_slip": "m"}
AXES = {
    "drive_voltage": ([20.0, 40.0, 60.0], "V", "drive.voltage"),
    "drive_frequency": ([10.0, 20.0, 40.0, 80.0], "Hz", "drive.frequency"),
    "drive_direction": ([1.0, -1.0], "1", "drive.direction"),
}


def swept(*names, bands=False):
    """A sweep over some of the `AXES` in which small voltages drive the end-effector backward."""
    shape = tuple(len(AXES[name][0]) for name in names)
    walk = np.linspace(-3e-6, 2e-6, int(np.prod(shape, dtype=int))).reshape(shape)
    numbers = dict.fromkeys(UNITS, walk) | {"efficiency": 1e5 * walk, "stroke": np.full(shape, 7e-6)}
    data = {
        name: (names, values, {"units": UNITS[name], "long_name": name.replace("_", " ")})
        for name, values in numbers.items()
    }
    if bands:
        for name, values in numbers.items():
            half = 0.1 * np.abs(values)
            ends = {"sd": half / 2.0, "low": values - half, "high": values + half}
            data |= {f"{name}_{end}": (names, found, {"units": UNITS[name]}) for end, found in ends.items()}
    data["failure"] = (names, np.zeros(shape, np.int8), {"meanings": ""})
    axes = {n: (n, np.array(AXES[n][0]), dict(units=AXES[n][1], long_name=AXES[n][2])) for n in names}
    return xarray.Dataset(data, axes, {"title": "a rig", "record": "5 Hz"})


def rows_of(text, name):
    """The words of the rows of a metric."""
    lines = text.splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith(f"    {name} "))
    return [line.split() for line in lines[first : first + 2]]


def test_each_extreme_has_its_own_band_and_place():
    """The larger magnitude is backward: its place had stood beside the value forward."""
    most, least = rows_of(format_sweep(swept("drive_voltage", "drive_frequency", bands=True)), "efficiency")
    assert most == ["efficiency", "%", "most", "20", "2", "60", "80"]
    assert least == ["least", "-30", "3", "20", "10"]


def test_what_is_the_same_everywhere_has_one_row():
    text = format_sweep(swept("drive_voltage", "drive_frequency"))
    same, following = rows_of(text, "stroke")
    assert same == ["stroke", "um", "7", "everywhere"] and following[0] == "back"
    assert rows_of(format_sweep(swept("drive_voltage").isel(drive_voltage=[1])), "stroke")[0][-1] == "40"
    assert rows_of(format_sweep(swept()), "stroke")[0] == ["stroke", "um", "7"]


def test_a_direction_is_told_in_words():
    most, least = rows_of(format_sweep(swept("drive_voltage", "drive_direction")), "speed")
    assert (most[-1], least[-1]) == ("backward", "forward")


def test_of_a_sweep_that_failed_whole_no_place_is_named():
    data = swept("drive_voltage")
    data["speed"][:] = np.nan
    assert rows_of(format_sweep(data), "speed")[0] == ["speed", "um/s", "-", "nowhere"]


def test_failures_that_occur_are_counted_each_and_no_others():
    data = swept("drive_voltage", "drive_frequency")
    data.failure[0, :3], data.failure[1, 0], data.failure[2, :2] = 3, 2, GRAZING
    text = format_sweep(data)
    assert "At 2 points a reversal of its cycle grazes" in text and "4 points failed:\n" in text
    told = [line.strip() for line in text.splitlines() if "with failure" in line]
    assert told == [f"1 with failure 2: {POINT_FAILURES[2]}", f"3 with failure 3: {POINT_FAILURES[3]}"]
    assert POINT_FAILURES[1][:20] not in text


@pytest.mark.parametrize(("names", "drawn"), [([], []), (["drive_direction"], ["sweep.png"])])
def test_a_point_without_an_axis_is_kept_and_told_without_figures_that_need_one(tmp_path, names, drawn):
    data = swept(*names).assign_attrs(parameters=json.dumps({}))
    assert "speed" in format_sweep(data)
    write_sweep(data, tmp_path / "out", "netcdf")
    assert sorted(file.name for file in (tmp_path / "out").glob("*.png")) == drawn
    kept = read_sweep(tmp_path / "out")
    assert kept.attrs.pop("digest")
    xarray.testing.assert_identical(kept, data)


def test_a_single_point_cannot_be_drawn():
    with pytest.raises(InputError, match="found a single point, expected an axis"):
        sweep_figure(swept())


def legend_of(figure):
    """What the figure's legend explains."""
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


def test_the_legend_of_a_map_explains_its_border_and_the_cells_that_failed():
    data = swept("drive_voltage", "drive_frequency")
    data["efficiency"][1, 2] = 0.0
    assert legend_of(sweep_figure(data)) == ["border of the dead zone (step efficiency of 1 %, either way)"]
    data["speed"][0, 0] = np.nan
    data["efficiency"][:] = 0.5
    assert legend_of(sweep_figure(data)) == ["failed"]


def test_contours_of_a_map_carry_their_numbers():
    panel = sweep_figure(swept("drive_voltage", "drive_frequency")).axes[0]
    levels = [float(text.get_text().replace("\N{MINUS SIGN}", "-")) for text in panel.texts]
    assert len(levels) >= 3 and all(-3.0 <= level <= 2.0 for level in levels)


def test_the_legend_of_directions_explains_borders_and_what_is_grey():
    data = swept("drive_voltage", "drive_frequency", "drive_direction")
    border = "border of the dead zone (efficiency of 1 %)"
    told = legend_of(directions_figure(data))
    assert told == [border, "that of forward", "that of backward", "moves the wrong way"]
    data["speed"][0, 0, 0] = np.nan
    assert legend_of(directions_figure(data))[-1] == "moves the wrong way or failed"


def test_what_is_held_is_named_by_its_path():
    """It was named drive_frequency, and a direction by its number."""
    held = sweep_figure(swept("drive_voltage", "drive_frequency", "drive_direction")).get_suptitle()
    assert held.endswith("drive.direction = forward")
    cut = swept("drive_direction", "drive_voltage", "drive_frequency").isel(drive_frequency=[1])
    assert "drive.frequency = 20 Hz" in sweep_figure(cut).get_suptitle()


@pytest.mark.parametrize("alone", ["drive_voltage", "drive_frequency"])
def test_an_axis_of_one_value_is_held_and_the_other_drawn(alone):
    """Cells of a single row have no height: the map was as grey as if all had failed."""
    data = swept("drive_voltage", "drive_frequency", "drive_direction").isel({alone: [1]})
    other = {"drive_voltage": "drive_frequency", "drive_frequency": "drive_voltage"}[alone]
    figure = sweep_figure(data.isel(drive_direction=0))
    np.testing.assert_array_equal(figure.axes[0].lines[0].get_xdata(), data[other].values)
    assert f"{data[alone].attrs['long_name']} = " in figure.get_suptitle()
    both = directions_figure(data)
    assert len(both.axes) == 2
    np.testing.assert_array_equal(both.axes[0].lines[0].get_xdata(), data[other].values)


@pytest.mark.parametrize(
    ("low", "high", "most", "ticks"),
    [
        (0.5, 2000.0, 4, []),
        (1e-6, 1e6, 8, []),
        (4.0, 64.0, 9, ["5", "10", "20", "50"]),
        (20.0, 80.0, 9, ["20", "40"]),
    ],
)
def test_a_logarithmic_axis_has_ticks_to_read_that_do_not_touch(low, high, most, ticks):
    data = swept("drive_voltage", "drive_frequency")
    places = data.drive_frequency.copy(data=np.geomspace(low, high, 4))
    figure = sweep_figure(data.assign_coords(drive_frequency=places))
    figure.draw_without_rendering()
    assert figure.axes[0].get_xscale() == "log"
    labels = [label for label in figure.axes[0].get_xticklabels() if low <= label.get_position()[0] <= high]
    boxes = [label.get_window_extent() for label in labels]
    assert 2 <= len(labels) <= most and set(ticks) <= {label.get_text() for label in labels}
    assert len(labels) >= 3 or ticks
    assert all(left.x1 < right.x0 for left, right in itertools.pairwise(boxes) if left.width and right.width)
