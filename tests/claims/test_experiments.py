"""Each experiment's calculation runs and its key numbers hold, maps among them; whole programs are slow."""

import json
import math

import numpy as np
import pytest
from quick_blocks import example_study
from scipy.optimize import least_squares
from scipy.signal import TransferFunction, lsim

from experiments import bands, common, map, mode_ratio, one_mode_error, step_responses
from pdssjax.files import EXAMPLE
from pdssjax.piezo import roots
from pdssjax.sweeps import execution


def test_tables_show_the_difference_and_are_kept_as_markdown(elsewhere, capsys):
    rows = [
        common.Row("speed", 2.0, 2.5, "um/s", "a | b"),
        common.Row("name", None, "fast"),
        common.Row("zero", 0.0, 1.0),
    ]
    text = common.print_table("Title", rows, "table", ["A note."])
    assert "+25 %" in capsys.readouterr().out
    assert "| speed [um/s] | 2 | 2.5 | +25 % | a \\| b |" in text
    assert "| name | - | fast | - |  |" in text and "| zero | 0 | 1 | - |  |" in text
    assert (elsewhere / "out/experiments/table.md").read_text(encoding="utf-8") == text + "\n"
    assert text.endswith("A note.")


def test_figure_4_4_the_gains_fall_far_faster_than_the_shapes():
    found = mode_ratio.calculate([1e-9, 24.7, 138.8, 1e5])
    limit = 1.0 / (math.pi * np.sqrt(found.mass_ratio))
    assert found.shape[0] == pytest.approx(1.0, abs=1e-6), "without a platform both modes are as high at the tip"
    assert found.gain[0] == pytest.approx(1.0 / 9.0, abs=1e-6), "and their gains are as 1 / p^2"
    np.testing.assert_allclose(found.shape[1:], [0.06464, 0.02706, limit[3]], rtol=2e-4)
    np.testing.assert_allclose(found.gain[1:], [3.297e-5, 1.062e-6, 2.0 / (math.pi**4 * 1e10)], rtol=5e-4)


def test_figure_4_7_one_mode_is_enough_by_the_rod_and_the_thesis_gains_explain_a_third_of_what_was_measured():
    found = one_mode_error.calculate([24.7, 138.77])
    np.testing.assert_allclose(found.rod, [1.666e-4, 5.363e-6], rtol=1e-3)
    np.testing.assert_allclose(found.equal, [0.2095, 0.0878], rtol=1e-3)
    np.testing.assert_allclose(found.program, [0.6034, 0.2529], rtol=1e-3)


def test_the_program_of_appendix_2_is_what_its_transfer_functions_give():
    mass_ratio, unit = 24.7, 6527.0 / 43.0
    p = np.asarray(roots(mass_ratio, 5)) / 0.02
    times = np.linspace(0.0, one_mode_error.TIMES[-1], 59 * 40 + 1)
    left_out = np.zeros(60)
    for pj in p[1:]:
        height = 2000.0 / 6527.0**2 * unit**2 * p[1] ** 2 * math.sin(0.02 * pj) / math.sin(0.02 * p[0])
        system = TransferFunction([height], [1.0, 0.2083 * unit * pj**2 / 43.0, (unit * pj) ** 2])
        left_out += lsim(system, np.ones_like(times), times)[1][::40]
    expected = 1e6 * math.sqrt(np.sum(left_out**2) / 1200.0)
    assert one_mode_error.program(mass_ratio) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("delay", [0, 1])
def test_peaks_find_the_system_that_made_a_finely_sampled_step(delay, monkeypatch):
    monkeypatch.setattr(step_responses, "PERIOD", 1e-7)
    truth = step_responses.CHAPTER_5
    times = 1e-7 * (np.arange(35000) - delay)
    found = step_responses.from_peaks(truth.step(48.2, times), 48.2)
    assert found.frequency == pytest.approx(truth.frequency, rel=1e-3)
    assert found.gain == pytest.approx(truth.gain, rel=3e-3)
    assert found.damping == pytest.approx(truth.damping, rel=3e-2), "its iteration ends at 0.5 %"


def test_figure_4_6_a_sample_of_delay_brings_the_frequency_of_chapter_5_to_that_of_chapter_4():
    results = step_responses.calculate()
    assert [r.voltage for r in results] == [75.4, 64.2, 48.2]
    for key, expected in {
        "chapter 4": (0.4364, 0.3728, 0.2808),
        "peaks": (0.0579, 0.0802, 0.0605),
        "late": (0.4535, 0.4328, 0.3214),
    }.items():
        np.testing.assert_allclose([r.error[key] for r in results], expected, rtol=2e-3)
    noise = json.loads((EXAMPLE / "truth.json").read_text(encoding="utf-8"))["noise_sd_um"]
    assert all(0.7 * noise < r.error["chapter 5"] < 1.5 * noise for r in results)
    assert np.mean([r.late.frequency for r in results]) == pytest.approx(6527.0, rel=0.01)
    assert np.mean([r.peaks.frequency for r in results]) == pytest.approx(6736.0, rel=0.01)


def test_least_squares_has_no_trouble_where_peaks_on_a_coarse_grid_have():
    found = step_responses.result(48.2)
    times = step_responses.PERIOD * np.arange(step_responses.WINDOW)

    def misfit(logs):
        gain, frequency, damping = np.exp(logs)
        ring = frequency * math.sqrt(1.0 - damping**2)
        wave = np.cos(ring * times) + damping * frequency / ring * np.sin(ring * times)
        return 1e6 * (48.2 * gain * (1.0 - np.exp(-damping * frequency * times) * wave) - found.displacement)

    peaks = found.peaks
    fitted = np.exp(least_squares(misfit, np.log([peaks.gain, peaks.frequency, peaks.damping])).x)
    np.testing.assert_allclose(fitted, [1.007e-7, 6736.0, 0.1772], rtol=3e-3)
    assert abs(peaks.frequency / 6736.0 - 1.0) > 0.01


@pytest.mark.slow
@pytest.mark.parametrize("experiment", [mode_ratio, one_mode_error, step_responses], ids=lambda module: module.NAME)
def test_experiments_write_their_table_and_their_figure(experiment, elsewhere):
    experiment.main()
    out = elsewhere / "out/experiments"
    assert (out / f"{experiment.NAME}.png").read_bytes().startswith(b"\x89PNG")
    assert "| thesis | ours | difference | why |" in (out / f"{experiment.NAME}.md").read_text(encoding="utf-8")


@pytest.fixture
def known(tmp_path):
    """The example, and an estimate.json of it in which two parameters are known to 1 and 2 %."""
    study = example_study()
    values, names = study.values(), ["piezo.gain", "friction.f_ss_a"]
    errors = np.array([0.01, 0.02]) * [values[name] for name in names]
    document = {"format": "pdssjax-estimate/1", "converged": True}
    document |= {"parameters": {path: {"value": value} for path, value in values.items()}}
    document |= {"covariance": {"names": names, "matrix": np.diag(errors**2).tolist()}}
    file = tmp_path / "estimate.json"
    file.write_text(json.dumps(document))
    return study, file


@pytest.fixture
def blocks(monkeypatch):
    """The net step is 0.1 um a volt and the gain's share above a border that rises with the frequency."""
    seen = []

    def compute_block(function, points):
        seen.append(len(points))
        of = lambda path: points[:, function.paths.index(path)] if path in function.paths else function.numbers[path]
        way = of("drive.direction") if "drive.direction" in function.paths else 1.0
        net = np.maximum(of("drive.voltage") - 8.0 - 0.02 * of("drive.frequency"), 0.0) * of("piezo.gain")
        stroke, ones = of("drive.voltage") * of("piezo.gain"), np.ones(len(points))
        found = (way * net, way * net * of("drive.frequency"), net / stroke, way * stroke, way * (stroke - net))
        return np.column_stack([*found, ones, 0.0 * ones, 0.0 * ones])

    monkeypatch.setattr(execution, "compute_block", compute_block)
    return seen


def test_the_map_goes_on_where_it_was_and_answers_the_question(known, blocks, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    grids = dict(grid=(np.linspace(2, 150, 8), np.geomspace(2, 400, 9)), coarse=(np.linspace(2, 150, 4),) * 2)
    both, banded = map.calculate(*known, **grids)
    seen = len(blocks)
    again, _ = map.calculate(*known, **grids)
    assert len(blocks) == seen
    np.testing.assert_array_equal(again.speed, both.speed)
    text = map.answer(*known, both, banded)
    # 30 - 8 - 1.6 V at 0.1007 um/V and 80 Hz, known to 1 % as the gain is.
    speed, half = 20.4 * 0.1007 * 80, 1.96 * 0.01 * 20.4 * 0.1007 * 80
    assert f"{speed:.2f} +/- {half:.2f}" in text and "| 9.6" in text
    panels = map.draw(both, banded).axes
    assert [panel.get_title(loc="left").split()[0] for panel in panels[:3]] == ["speed", "speed", "how"]


def test_bands_of_what_is_nearly_linear_agree_and_the_figure_shows_both(known, blocks, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    cuts = {"frequency": {"drive.voltage": np.array([30.0]), "drive.frequency": np.geomspace(2.0, 400.0, 4)}}
    cuts["voltage"] = {"drive.voltage": np.linspace(4.0, 40.0, 5), "drive.frequency": np.array([80.0])}
    found = bands.calculate(*known, cuts, 400)
    seen = len(blocks)
    bands.calculate(*known, cuts, 400)
    assert len(blocks) == seen
    rows = bands.compare(found)
    low, high = (float(part) for part in str(rows[1].ours).split(" to "))
    assert 0.9 < low <= high < 1.1
    assert len(bands.draw(found).axes) == 4


@pytest.mark.slow
@pytest.mark.parametrize("experiment", [map, bands])
def test_the_experiments_run_as_they_are(experiment, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PDSSJAX_FIGURES", raising=False)
    experiment.main()
    assert (tmp_path / "out/experiments" / f"{experiment.NAME}.png").read_bytes().startswith(b"\x89PNG")
