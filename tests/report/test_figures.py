"""Figures show what they claim, also where there is little to show."""

import dataclasses
import itertools

import fabricated
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from pdssjax import InputError
from pdssjax.metrics import guess_record, lack_of_fit
from pdssjax.report.figures import (
    amplification_figure,
    comparison_figure,
    correlation_figure,
    draws_figure,
    error_figure,
    guess_figure,
    has_loops,
    loop_figure,
    multistart_figure,
    profile_figure,
    record_figure,
    residual_split_figure,
    save_figure,
)


def drawn(figure: Figure) -> Figure:
    """The figure after it has been laid out, which is when matplotlib complains; a bare canvas draws nothing."""
    figure.draw_without_rendering()
    return figure


@pytest.mark.parametrize("figure_of", [record_figure, residual_split_figure])
def test_a_file_is_drawn_once_and_looks_as_if_twice(figure_of, tmp_path, monkeypatch):
    record = fabricated.estimate().records[1]
    figure_of(record).savefig(tmp_path / "twice.png")
    drawings, draw = [], Figure.draw
    monkeypatch.setattr(Figure, "draw", lambda figure, renderer: drawings.append(draw(figure, renderer)))
    save_figure(figure_of(record), tmp_path / "once.png")
    assert len(drawings) == 1
    once, twice = (imread(tmp_path / f"{name}.png") for name in ("once", "twice"))
    np.testing.assert_array_equal(once, twice)


@pytest.mark.parametrize(("index", "corners"), [(0, [0.0]), (1, range(200, 1800, 200))])
def test_the_enlarged_panel_shows_a_slip_or_the_onset_of_a_step(index, corners):
    record = fabricated.estimate().records[index]
    near = drawn(record_figure(record)).axes[1]
    milliseconds, measured = near.lines[0].get_data()
    assert any(milliseconds[0] < corner < milliseconds[-1] for corner in corners)
    assert np.ptp(milliseconds) < 100 * np.ptp(record.time)
    np.testing.assert_allclose(measured, np.interp(milliseconds, 1e3 * record.time, 1e6 * record.measured))


def test_residuals_are_drawn_in_micrometres_below():
    record = fabricated.estimate().records[1]
    residual = record_figure(record).axes[2]
    np.testing.assert_allclose(residual.lines[0].get_ydata(), 1e6 * (record.measured - record.predicted))
    assert "± 2 noise" in residual.get_ylabel()


def test_the_label_of_residuals_is_within_the_figure():
    # Ticks at 0.02 um fit before the layout has made room for caption and labels, and at 0.025 um after it.
    record = fabricated.record("forward", "fit", "effector", np.linspace(0.0, 0.3, 1500), np.zeros(1500))
    measured = record.predicted + 1e-8 * np.clip(1e8 * (record.measured - record.predicted), -1.0, 1.0)
    measured[[300, 310]] = record.predicted[[300, 310]] + [3.8e-8, -3.34e-8]
    panels = drawn(record_figure(dataclasses.replace(record, measured=measured, reduced_chi2=1.01))).axes
    assert min(panel.yaxis.label.get_window_extent().x0 for panel in panels) >= 0.0


def test_a_failed_simulation_and_an_unknown_noise_are_no_trouble():
    record = dataclasses.replace(fabricated.estimate().records[3], noise=float("nan"))
    figure = drawn(record_figure(record))
    assert "the simulation failed" in figure.get_suptitle()
    assert "noise" not in figure.axes[2].get_ylabel()


def test_chi_square_is_in_the_caption_where_a_noise_was_given():
    record = fabricated.estimate().records[0]
    assert "chi-square" not in record_figure(record).get_suptitle()
    judged = dataclasses.replace(record, reduced_chi2=4.6)
    assert "chi-square per sample 4.6" in drawn(record_figure(judged)).get_suptitle()


@pytest.mark.parametrize("figure_of", [record_figure, residual_split_figure])
@pytest.mark.parametrize("samples", [2, 5])
def test_a_record_of_few_samples_can_be_drawn(samples, figure_of):
    time = np.linspace(0.0, 1.0, samples)
    drawn(figure_of(fabricated.record("short", "fit", "platform", time, 1e-6 * time)))


def test_correlations_are_written_into_their_cells():
    estimate = fabricated.estimate()
    axes = drawn(correlation_figure(estimate)).axes[0]
    texts = [text.get_text() for text in axes.texts]
    assert texts[0] == f"{estimate.correlation[1, 0]:.2f}"
    assert texts.count("×") == 7
    assert "no information" in axes.get_title("left")


def test_the_amplification_is_written_into_its_cells():
    axes = drawn(amplification_figure(fabricated.amplification())).axes[0]
    assert [text.get_text() for text in axes.texts][:4] == ["-12", "0.31", "0.02", "99"]
    assert [label.get_text() for label in axes.get_yticklabels()][1] == "friction.sigma1_a"


def test_what_moves_nothing_and_what_nothing_moves_is_left_out():
    whole = fabricated.amplification()
    wider = np.zeros((4, 5))
    wider[:3, :3] = whole.matrix
    wider[2, 4] = -1e-9
    both = dataclasses.replace(
        whole,
        later=(*whole.later, "drive.rise_time@a"),
        earlier=(*whole.earlier, "drive.rise_time@b", "sensor.delay"),
        matrix=wider,
    )
    seen = both.visible()
    assert (seen.later, seen.earlier) == (whole.later, whole.earlier)
    np.testing.assert_array_equal(seen.matrix, whole.matrix)
    texts = [text.get_text() for text in drawn(amplification_figure(both)).axes[0].texts]
    assert len(texts) == 9 and "-0" not in texts and not any("0.001" in text for text in texts)
    nothing = dataclasses.replace(both, matrix=np.zeros((4, 5)))
    assert nothing.visible().matrix.shape == (4, 5)


def test_ways_are_compared_by_their_distance_from_the_joint_fit():
    ways = [fabricated.estimate(method) for method in ("joint", "sequential", "peaks")]
    path = "friction.sigma1_a"
    moved = dataclasses.replace(ways[2].parameters[path], value=1.1 * 54.4)
    ways[2] = dataclasses.replace(ways[2], parameters=ways[2].parameters | {path: moved})
    figure = drawn(comparison_figure(ways))
    panel = next(axes for axes in figure.axes if axes.get_title("left") == path)
    dots = [line.get_xdata()[0] for line in panel.lines if line.get_marker() == "o"]
    np.testing.assert_allclose(dots, [0.0, 0.0, 10.0], atol=1e-9)
    assert [label.get_text() for label in figure.axes[0].get_yticklabels()] == ["joint", "sequential", "peaks"]
    shown = {axes.get_title("left") for axes in figure.axes} - {""}
    assert shown == {"piezo.gain", "piezo.natural_frequency", "piezo.damping_ratio", path} | {
        "friction.sigma0_a",
        "friction.f_ss_a",
    }, "neither what is zero nor what has no error"


def test_naive_intervals_are_on_the_scale_that_whole_ones_are_on():
    """Drawn symmetric beside intervals of a logarithm they had stuck out of them on one side."""
    ways = [fabricated.estimate(method) for method in ("joint", "sequential")]
    path = "friction.sigma1_a"
    value = ways[0].parameters[path].value
    log = lambda error: (value * np.exp(-1.96 * error), value * np.exp(1.96 * error))
    found = dataclasses.replace(ways[1].parameters[path], interval=log(0.2), naive_standard_error=0.1 * value)
    ways[1] = dataclasses.replace(ways[1], parameters=ways[1].parameters | {path: found})
    figure = drawn(comparison_figure(ways))
    panel = next(axes for axes in figure.axes if axes.get_title("left") == path)
    (bar,) = panel.collections
    ends = bar.get_segments()[0][:, 0]
    np.testing.assert_allclose(ends, 100.0 * (np.array(log(0.1)) / value - 1.0), rtol=1e-3)


def test_a_fit_of_which_nothing_is_known_can_be_drawn():
    nothing = dataclasses.replace(fabricated.estimate(), names=())
    drawn(comparison_figure([nothing, nothing]))
    drawn(error_figure(dataclasses.replace(nothing, parameters={})))


@pytest.mark.parametrize("over", [{"point": 40}, {"drive_voltage": 5, "point": 3}])
def test_a_sample_is_shown_and_told_by_its_points(over):
    """Its dimension has no values of its own."""
    import xarray

    from pdssjax.report.figures import sweep_figure
    from pdssjax.report.text import format_sweep

    shape, dims = tuple(over.values()), tuple(over)
    value = np.linspace(0.0, 1e-6, int(np.prod(shape))).reshape(shape)
    metric = lambda unit: (dims, value, {"units": unit, "long_name": "a metric"})
    units = {"net_step": "m", "speed": "m/s", "efficiency": "1", "stroke": "m", "back_slip": "m"}
    failure = {"failure": (dims, np.zeros(shape, int), {"meanings": ""})}
    along = lambda name, unit: ("point", np.linspace(1.0, 2.0, over["point"]), {"units": unit, "long_name": name})
    coordinates = {"drive_frequency": along("drive.frequency", "Hz"), "effector_load": along("effector.load", "N")}
    if "drive_voltage" in over:
        coordinates["drive_voltage"] = ("drive_voltage", np.arange(5.0), {"units": "V", "long_name": "drive.voltage"})
    data = xarray.Dataset(
        {n: metric(u) for n, u in units.items()} | failure, coordinates, {"title": "t", "record": "r"}
    )
    assert len(sweep_figure(data).axes) >= 4
    most = next(line for line in format_sweep(data).splitlines() if " most " in line).split()
    assert most[5:7] == ["2", "2"], "the frequency and the load of the last point"


def repeating(misfit: float):
    """A record of eight cycles whose prediction lacks a part that every cycle repeats [m]."""
    plain = fabricated.estimate().records[1]
    off = misfit * np.sin(2 * np.pi * 5.0 * plain.time) ** 3
    residual = plain.measured - plain.predicted + off
    found = lack_of_fit(residual, plain.time, 5.0)
    return dataclasses.replace(plain, predicted=plain.measured - residual, frequency=5.0, lack_of_fit=found)


def test_the_split_shows_what_repeats_and_the_autocorrelation_of_the_rest():
    record = repeating(3e-8)
    cycle, correlation = drawn(residual_split_figure(record)).axes
    phase, mean = next(line for line in cycle.lines if line.get_label() == "mean of the cycles").get_data()
    np.testing.assert_allclose(mean, 0.03 * np.sin(2 * np.pi * (phase - 0.5 / 200)) ** 3, atol=0.02)
    assert correlation.lines[0].get_label() == "white noise"
    assert "misfit" in cycle.figure.get_suptitle()


@pytest.mark.parametrize("frequency", [None, 5.0])
def test_residuals_are_drawn_as_they_are_reported_whatever_a_fit_without_outliers_would_leave(frequency):
    record = repeating(3e-8)
    measured = record.measured.copy()
    measured[[100, 700]] += 6e-6
    undisturbed = record.predicted + 1e-5 * np.sin(record.time)
    record = dataclasses.replace(
        record, measured=measured, frequency=frequency, outliers=np.array([100, 700]), undisturbed=undisturbed
    )
    figure = drawn(residual_split_figure(record))
    np.testing.assert_allclose(figure.axes[0].lines[0].get_ydata(), 1e6 * (record.measured - record.predicted))
    low, high = figure.axes[0].get_ylim()
    assert -0.3 < low < high < 0.3, "the axis is that of the other samples"
    assert f"samples that stand out: 2, by up to {record.largest_error * 1e6:.4g}"[:34] in figure.get_suptitle()
    if frequency:
        mean = next(line for line in figure.axes[0].lines if line.get_label() == "mean of the cycles").get_ydata()
        assert np.max(np.abs(mean)) < 0.1, "of the cycles without the samples that stand out"


def test_what_repeats_as_chance_has_it_is_called_so():
    record = repeating(0.0)
    assert record.lack_of_fit is not None and record.lack_of_fit.misfit > 0.0
    assert "as chance has it, no misfit" in drawn(residual_split_figure(record)).get_suptitle()
    assert "(misfit)" in drawn(residual_split_figure(repeating(3e-8))).get_suptitle()


@pytest.mark.parametrize("change", [{"frequency": None, "lack_of_fit": None}, {"frequency": 0.5, "lack_of_fit": None}])
def test_a_record_that_does_not_repeat_is_shown_over_time(change):
    figure = drawn(residual_split_figure(dataclasses.replace(repeating(0.0), **change)))
    assert "cannot be told apart" in figure.get_suptitle()
    assert figure.axes[0].get_xlabel() == "time (s)"


def test_residuals_of_zero_have_no_autocorrelation_and_are_no_trouble():
    record = repeating(0.0)
    drawn(residual_split_figure(dataclasses.replace(record, predicted=record.measured)))


def test_errors_by_every_model_are_drawn():
    axes = drawn(error_figure(fabricated.with_errors(fabricated.estimate()))).axes[0]
    labels = [line.get_label() for line in axes.lines]
    assert labels == ["standard error (white)", "coloured", "with misfit"]
    first, second = (np.asarray(line.get_xdata()) for line in axes.lines[:2])
    np.testing.assert_allclose(second, 2.0 * first)


@pytest.mark.parametrize("count", [1, 9])
def test_no_key_of_the_errors_stands_on_a_row(count):
    whole = fabricated.with_errors(fabricated.estimate())
    figure = drawn(error_figure(dataclasses.replace(whole, parameters=dict(list(whole.parameters.items())[:count]))))
    (key,) = figure.legends
    assert not key.get_window_extent().overlaps(figure.axes[0].get_window_extent())


def test_profiles_stand_beside_their_parabolas_with_the_verdict():
    parameters = fabricated.estimate().parameters
    profiles = fabricated.profiles(parameters)
    figure = drawn(profile_figure(profiles, parameters))
    for axes, profile in zip(figure.axes, profiles, strict=True):
        parabola, curve, computed = axes.lines[:3]
        np.testing.assert_allclose(parabola.get_ydata(), profile.linear)
        np.testing.assert_allclose(curve.get_ydata(), profile.excess)
        assert len(computed.get_xdata()) == profile.computed.sum()
        assert axes.get_title(loc="left") == f"{profile.path}\n{profile.verdict}"
        assert axes.get_ylim()[1] > profile.threshold
    assert figure.axes[0].lines[1].get_xdata()[0] == pytest.approx(1e6 * profiles[0].value[0])


@pytest.mark.parametrize("kind, count", [("bootstrap", "40 draws"), ("posterior", "4 chains of 25 draws")])
def test_draws_stand_beside_the_linear_model(kind, count):
    estimate = fabricated.estimate()
    draws = fabricated.draws(estimate.parameters, kind)
    figure = drawn(draws_figure(dataclasses.replace(estimate, draws=draws)))
    first, unused, both, second = figure.axes
    assert [axes.get_visible() for axes in figure.axes] == [True, False, True, True]
    assert (first.get_title(loc="left"), second.get_title(loc="left")) == ("piezo\ngain", "friction\nsigma1_a")
    points, ellipse, centre = both.lines
    np.testing.assert_allclose(points.get_xdata(), 1e6 * draws.values[:, :, 0].ravel())
    np.testing.assert_allclose(points.get_ydata(), draws.values[:, :, 1].ravel())
    # As wide as the 95 % of two normal numbers.
    error = estimate.parameters["piezo.gain"].standard_error
    assert np.ptp(ellipse.get_xdata()) == pytest.approx(2e6 * error * np.sqrt(-2.0 * np.log(0.05)), rel=2e-3)
    assert both.get_xlabel() == "gain\n[µm/V]" and not unused.get_visible() and len(centre.get_xdata()) == 1
    assert figure.legends[0].get_title().get_text() == f"{kind}: {count}"


def legend_of(figure):
    """The legend, which lies within the figure and beside what it explains."""
    (legend,) = figure.legends
    box = legend.get_window_extent()
    assert figure.bbox.x0 <= box.x0 and box.x1 <= figure.bbox.x1
    assert figure.bbox.y0 <= box.y0 and box.y1 <= figure.bbox.y1
    assert not any(box.overlaps(axes.get_window_extent()) for axes in figure.axes if axes.get_visible())
    return legend


@pytest.mark.parametrize("count", [1, 2])
def test_the_legend_of_draws_hides_none_and_names_each_thing_once(count):
    estimate = fabricated.estimate()
    draws = fabricated.draws(estimate.parameters, "bootstrap")
    fewer = dataclasses.replace(
        draws, names=draws.names[:count], values=draws.values[:, :, :count], parameters=draws.parameters[:count]
    )
    legend = legend_of(drawn(draws_figure(dataclasses.replace(estimate, draws=fewer))))
    assert [text.get_text() for text in legend.texts] == ["draws", "linear model", "95 % interval", "estimate"]


@pytest.mark.parametrize("count", [1, 2, 3])
def test_the_legend_of_profiles_is_whole(count):
    parameters = fabricated.estimate().parameters
    figure = drawn(profile_figure(fabricated.profiles(parameters)[:count], parameters))
    assert len(legend_of(figure).texts) == 4
    assert figure.axes[0].get_xlabel() == "[µm/V]"


def test_the_times_of_a_file_do_not_run_into_each_other():
    time = np.linspace(-0.01, 0.03, 2001)
    guess = guess_record(time, 9e-6 * (time > 0), np.where(time > 0, 40.0, -20.0))
    figure = drawn(guess_figure("step", guess))
    labels = [label.get_window_extent() for label in figure.axes[2].get_xticklabels() if label.get_text()]
    assert len(labels) > 3
    # A blank apart, at least.
    assert all(left.x1 + 3.0 < right.x0 for left, right in itertools.pairwise(labels))


def test_draws_are_shown_only_where_there_are_any():
    with pytest.raises(InputError, match="found an estimate without draws"):
        draws_figure(fabricated.estimate())


def test_starts_are_sorted_by_chi_square_and_their_optima_compared():
    multistart = fabricated.multistart(fabricated.estimate().parameters)
    above, below = drawn(multistart_figure(multistart)).axes
    labels = [line.get_label() for line in above.lines]
    assert [name for name in labels if not name.startswith("_")] == [
        "not converged",
        "optimum 1",
        "optimum 2",
        "optimum 3",
    ]
    assert [line.get_xdata().size for line in above.lines[1:]] == [1, 12, 4, 2]
    assert "1 could not be simulated" in above.get_xlabel()
    np.testing.assert_allclose(below.lines[-1].get_xdata(), 0.0, atol=1e-9)
    assert len(below.lines) == multistart.distinct == 3


def test_loops_are_drawn_against_the_voltage_with_the_largest_residual():
    plain = fabricated.estimate().records[0]
    volts = 10.0 * np.sin(2.0 * np.pi * np.linspace(0.0, 3.0, plain.samples))
    record = dataclasses.replace(plain, voltage=volts)
    motion, left = drawn(loop_figure(record)).axes
    np.testing.assert_allclose(motion.lines[0].get_data(), [volts, 1e6 * record.measured])
    np.testing.assert_allclose(left.lines[0].get_data(), [volts, 1e6 * (record.measured - record.predicted)])
    assert record.largest_error == np.abs(record.measured - record.predicted).max()
    assert f"largest {1e6 * record.largest_error:.3g} µm" in motion.figure.get_suptitle()


def test_a_step_and_a_record_without_a_voltage_have_no_loops():
    plain = fabricated.estimate().records[0]
    assert not has_loops(plain)
    assert not has_loops(dataclasses.replace(plain, voltage=np.where(plain.time < 0.0, 0.0, 50.0)))
    assert has_loops(dataclasses.replace(plain, voltage=np.linspace(0.0, 50.0, plain.samples)))
    with pytest.raises(ValueError, match="but it has none"):
        loop_figure(plain)


def test_a_caption_wider_than_its_figure_goes_on_in_the_next_line():
    record = dataclasses.replace(fabricated.estimate().records[1], name="5 Hz, the second surface, " * 8)
    figure = drawn(record_figure(record))
    (caption,) = [text for text in figure.texts if text.get_text() == figure.get_suptitle()]
    assert caption.get_window_extent().x1 <= figure.bbox.x1
