"""The experiments on maps: they go on where they were, and say what their data say."""

import json

import numpy as np
import pytest
from quick_blocks import example_study

from experiments import bands, map
from pdssjax.sweeps import execution


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
