"""Results show themselves: as tables of HTML with units, as figures, as tables of pandas and xarray."""

import dataclasses
import html.parser

import fabricated
import jax.numpy as jnp
import numpy as np
import pytest
import xarray

import pdssjax
from pdssjax.files import EXAMPLE
from pdssjax.report.figures import record_figure
from pdssjax.simulation import TRAJECTORY_UNITS, Trajectory
from pdssjax.sweeps import register_plot


@pytest.fixture(scope="module")
def study():
    return pdssjax.load_study(EXAMPLE / "study.toml")


def run(message: int = 0) -> Trajectory:
    """A made-up run of a platform that rises by 2 um and an end-effector that follows it."""
    time = jnp.linspace(0.0, 0.1, 21)
    rise = 2e-6 * time / time[-1]
    count = jnp.asarray(7)
    return Trajectory(
        time, 64.0 + 0 * time, rise, 0.5 * rise, 0 * rise, 0 * rise, 0.1 + 0 * time,
        count, count, count, jnp.asarray(False), jnp.asarray(message),
    )  # fmt: skip


class Tables(html.parser.HTMLParser):
    """The cells of all rows of all tables; complains of what is not closed."""

    def __init__(self, text: str):
        super().__init__()
        self.rows: list[list[str]] = []
        self.open: list[str] = []
        self.tables = 0
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.open.append(tag)
        self.tables += tag == "table"
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] in ("td", "th"):
            self.rows[-1][-1] += data


def row(text: str, first: str) -> list[str]:
    """The row of a table that begins with this cell."""
    return next(cells for cells in Tables(text).rows if cells and cells[0] == first)


def test_an_estimate_shows_values_errors_and_units():
    shown = fabricated.estimate()._repr_html_()
    assert Tables(shown).tables == 2
    assert row(shown, "piezo.gain")[1:5] == ["0.1007020", "0.0000070", "0.00695 %", "µm/V"]
    assert row(shown, "friction.sigma0_a")[4] == "N/µm"
    assert row(shown, "effector.mass") == ["effector.mass", "86", "", "", "g", "", "fixed"]
    assert row(shown, "drive.fall_time")[-1] == "at bound"
    assert row(shown, "effector.load")[-1] == "no information"


def test_what_a_study_calls_its_records_is_escaped():
    estimate = fabricated.estimate()
    records = (dataclasses.replace(estimate.records[0], name="<b>5 V</b>"), *estimate.records[1:])
    shown = dataclasses.replace(estimate, records=records, title="a < b")._repr_html_()
    assert "<b>5 V" not in shown and "a &lt; b" in shown
    assert row(shown, "<b>5 V</b>")[1] == "fitted"


def test_an_estimate_says_in_one_line_what_it_is():
    assert repr(fabricated.estimate()).endswith("8 free of 9 parameters, 4 records)")
    assert "did not converge" in repr(fabricated.estimate(converged=False))
    assert "DID NOT CONVERGE" in fabricated.estimate(converged=False)._repr_html_()


def test_a_study_shows_models_parameters_and_records(study):
    shown = study._repr_html_()
    assert row(shown, "effector.mass") == ["effector.mass", "fixed", "86", "g", ""]
    assert row(shown, "piezo.gain")[1:3] == ["free", "found in the data"]
    assert row(shown, "5 Hz A")[1:4] == ["effector", "fit", "sawtooth, 64.2 V, 5 Hz"]
    assert "anisotropic-lugre (deflection state)" in shown
    assert "9 free of 11 parameters" in repr(study) and len(repr(study)) < 200


def test_a_trajectory_shows_ranges_in_units_that_people_read():
    shown = run()._repr_html_()
    assert row(shown, "platform") == ["platform", "0", "2", "2", "µm"]
    assert "7 steps" in shown
    assert "shape (3, 21)" in run()._replace(time=jnp.zeros((3, 21)), effector=jnp.zeros((3, 21)))._repr_html_()


def test_a_trajectory_that_failed_says_why():
    assert run(1).message in run(1)._repr_html_()


def test_a_trajectory_becomes_a_dataset_with_units():
    data = run().to_xarray()
    assert {name: data[name].attrs["units"] for name in data} == TRAJECTORY_UNITS
    assert data.time.attrs["units"] == "s" and data.sizes == {"time": 21}
    np.testing.assert_array_equal(data.platform, run().platform)


def test_runs_side_by_side_are_refused():
    several = run()._replace(time=jnp.zeros((3, 21)), effector=jnp.zeros((3, 21)))
    for show in (several.plot, several.to_xarray):
        with pytest.raises(pdssjax.InputError, match=r"found runs of shape \(3, 21\), expected a single one"):
            show()


def test_parameters_become_a_table_of_pandas():
    table = fabricated.estimate().to_dataframe()
    assert list(table.index) == list(fabricated.estimate().parameters)
    assert table.loc["piezo.gain", "value"] == 1.00702e-7 and table.loc["piezo.gain", "unit"] == "m/V"
    assert table.loc["piezo.gain", "low"] == pytest.approx(1.00702e-7 - 14e-12)
    assert np.isnan(table.loc["effector.mass", "standard_error"]) and not table.loc["effector.mass", "free"]


def test_errors_of_other_models_have_columns_of_their_own():
    estimate = fabricated.estimate()
    told = {
        "white": pdssjax.study.ParameterError(1.0, (0.0, 2.0)),
        "coloured": pdssjax.study.ParameterError(3.0, (0.0, 6.0)),
    }
    path = "piezo.gain"
    changed = {path: dataclasses.replace(estimate.parameters[path], errors=told)}
    table = dataclasses.replace(estimate, parameters=estimate.parameters | changed).to_dataframe()
    assert table.loc[path, "standard_error (coloured)"] == 3.0
    assert np.isnan(table.loc["effector.mass", "standard_error (coloured)"])


def test_every_result_is_drawn(study):
    for figure, lines in [
        (fabricated.estimate().plot(), {"measured", "predicted"}),
        (study.plot(), {"measured"}),
        (run().plot(), {"platform", "end-effector"}),
    ]:
        figure.draw_without_rendering()
        assert {line.get_label() for axes in figure.axes for line in axes.lines} >= lines


def test_the_overview_has_a_row_a_record_in_its_unit():
    estimate = fabricated.estimate()
    axes = estimate.plot().axes
    assert len(axes) == 2 * len(estimate.records)
    np.testing.assert_allclose(axes[0].lines[0].get_ydata(), 1e6 * estimate.records[0].measured)


def test_parts_of_an_estimate_are_drawn_by_name():
    estimate = fabricated.estimate()
    name = estimate.records[1].name
    assert estimate.plot(name).get_suptitle() == record_figure(estimate.records[1]).get_suptitle()
    assert estimate.plot("errors").axes[0].get_xlabel() == "standard error (% of the value)"
    assert len(estimate.plot("correlations").axes) == 2
    with pytest.raises(pdssjax.InputError, match='plot: found "profiles", expected one of errors, correlations'):
        estimate.plot("profiles")
    alone = dataclasses.replace(estimate, names=estimate.names[:1])
    with pytest.raises(pdssjax.InputError, match='plot: found "correlations", expected one of errors'):
        alone.plot("correlations")


def test_a_sweep_is_drawn_through_its_accessor():
    register_plot()
    speeds = ("drive_voltage", [1e-6, 2e-6], {"units": "m/s", "long_name": "speed"})
    data = xarray.Dataset(
        dict.fromkeys(("speed", "net_step", "efficiency", "back_slip"), speeds),
        {"drive_voltage": ("drive_voltage", [20.0, 40.0], {"units": "V", "long_name": "drive.voltage"})},
        {"title": "a rig", "record": "5 Hz"},
    ).assign(failure=("drive_voltage", [0, 0]))
    np.testing.assert_allclose(data.pdssjax.plot().axes[0].lines[0].get_ydata(), [1.0, 2.0])
