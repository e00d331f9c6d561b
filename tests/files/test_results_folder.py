"""Results reach their folder whole or not at all, and never over others unasked."""

import contextlib
import dataclasses
import json
import os
from pathlib import Path

import fabricated
import numpy as np
import pytest

from pdssjax import InputError
from pdssjax.files import check_free, results_folder, write_estimate, write_predictions
from pdssjax.report import figures


@pytest.fixture(scope="module")
def results(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("deep") / "er" / "out"
    write_estimate(fabricated.estimate("sequential"), folder)
    return folder


def standard_json(folder: Path) -> dict:
    """The estimate in `folder`; fails on NaN and Infinity, which JSON does not know."""
    return json.loads((folder / "estimate.json").read_text(encoding="utf-8"), parse_constant=pytest.fail)


def test_the_folder_holds_report_estimate_plots_and_predictions(results):
    stems = {"step_48.2_V", "5_Hz_A", "20_Hz_A", "lost_run"}
    assert {path.name for path in results.iterdir()} == {"report.txt", "estimate.json", "plots", "predictions"}
    assert {path.stem for path in (results / "predictions").iterdir()} == stems
    drawn = {path.stem for path in (results / "plots").iterdir()}
    assert drawn == stems | {"amplification", "correlations", "standard_errors"}
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in (results / "plots").rglob("*.png"))
    assert "DID NOT" not in (results / "report.txt").read_text(encoding="utf-8")


def test_the_estimate_keeps_to_its_format(results):
    document = standard_json(results)
    assert document["format"] == "pdssjax-estimate/1"
    assert document["method"] == "sequential"
    assert document["converged"] is True
    gain = document["parameters"]["piezo.gain"]
    assert gain["value"] == pytest.approx(1.00702e-7)
    assert gain["interval"] == pytest.approx([1.00702e-7 - 1.4e-11, 1.00702e-7 + 1.4e-11])
    assert gain["unit"] == "m/V"
    assert gain["free"] is True
    assert document["parameters"]["friction.sigma1_a"]["naive_standard_error"] == 0.4
    assert len(document["correlation"]["matrix"]) == len(document["correlation"]["names"]) == 8
    required = {"name", "role", "samples", "r2", "error_index", "rmse", "noise", "offset"}
    assert all(required <= set(record) for record in document["records"])
    assert {"chi2", "reduced_chi2", "aic", "bic", "evaluations", "iterations"} <= set(document["statistics"])


def test_what_has_no_number_is_null(results):
    document = standard_json(results)
    mass, load = (document["parameters"][f"effector.{name}"] for name in ("mass", "load"))
    assert mass["standard_error"] is None
    assert mass["interval"] == [None, None]
    assert load["standard_error"] is None
    assert document["records"][3]["r2"] is None
    assert document["correlation"]["matrix"][-1][-1] is None


def test_a_joint_fit_has_no_naive_errors(undrawn, tmp_path):
    write_estimate(fabricated.estimate("joint"), tmp_path)
    assert "naive_standard_error" not in standard_json(tmp_path)["parameters"]["piezo.gain"]


def test_predictions_are_in_micrometres(results):
    table = np.genfromtxt(results / "predictions" / "5_Hz_A.csv", delimiter=",", names=True)
    record = fabricated.estimate().records[1]
    assert table.dtype.names == ("time_s", "measured_um", "predicted_um", "residual_um")
    np.testing.assert_allclose(table["time_s"], record.time, rtol=1e-9)
    np.testing.assert_allclose(table["predicted_um"], 1e6 * record.predicted, atol=1e-6)
    np.testing.assert_allclose(table["residual_um"], 1e6 * (record.measured - record.predicted), atol=1e-6)


def test_records_of_like_and_of_any_names_keep_their_own_files(undrawn, tmp_path):
    time = np.linspace(0.0, 1.0, 50)
    names = ["a b", "a/b", "A_b", "../correlations", "µ", "µ" * 300, "µ" * 300 + "2"]
    write_predictions([fabricated.record(n, "fit", "effector", time, 1e-6 * time) for n in names], {}, tmp_path)
    files = {path.name for path in (tmp_path / "predictions").iterdir()}
    long = "µ" * 60
    assert files == {"a_b.csv", "a_b-2.csv", "A_b-3.csv", "correlations-2.csv", "µ.csv", f"{long}.csv", f"{long}-2.csv"}
    assert len(list((tmp_path / "plots").glob("*.png"))) == 7


def test_no_record_takes_the_place_of_another_figure(undrawn, tmp_path):
    time = np.linspace(0.0, 1.0, 50)
    names = ["amplification", "Draws", "multistart", "profiles", "standard errors", "correlations"]
    written = fabricated.estimate().records
    named = [fabricated.record(name, "fit", "effector", time, 1e-6 * time) for name in names]
    write_estimate(dataclasses.replace(fabricated.estimate(), records=(*written, *named)), tmp_path)
    plots = {path.stem for path in (tmp_path / "plots").glob("*.png")}
    assert {f"{name.replace(' ', '_')}-2" for name in names} | {"correlations", "standard_errors"} <= plots


def test_residuals_that_are_more_than_noise_are_drawn_under_the_names_of_their_records(undrawn, tmp_path):
    time = np.linspace(0.0, 1.0, 50)
    roles = {"a b": "validate", "a/b": "fit", "explained": "fit"}
    records = [fabricated.record(n, role, "effector", time, 1e-6 * time) for n, role in roles.items()]
    for place in (0, 1):
        missed = records[place].predicted + 1e-7 * np.sin(6.0 * time)
        records[place] = dataclasses.replace(records[place], predicted=missed)
    records = tuple(records)
    write_estimate(dataclasses.replace(fabricated.estimate(), records=records), tmp_path)
    assert [path.name for path in (tmp_path / "plots" / "residuals").iterdir()] == ["a_b-2.png"]


def test_predictions_keep_small_numbers_and_late_times(undrawn, tmp_path):
    time = 1e5 + 1e-6 * np.arange(50)
    record = fabricated.record("quiet", "fit", "effector", time, 1e-13 * np.sin(time * 1e5))
    write_predictions([record], {}, tmp_path)
    table = np.genfromtxt(tmp_path / "predictions" / "quiet.csv", delimiter=",", names=True)
    np.testing.assert_array_equal(table["time_s"], np.round(time, 6))
    np.testing.assert_allclose(table["predicted_um"], 1e6 * record.predicted, rtol=1e-8)


def test_a_folder_with_results_is_refused_unless_overwriting(results):
    with pytest.raises(InputError, match=r"results already.*estimate\.json.*--overwrite"):
        check_free(results, overwrite=False)
    check_free(results, overwrite=True)


def test_a_folder_of_other_things_is_free_and_keeps_them(undrawn, tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    check_free(tmp_path, overwrite=False)
    write_predictions(fabricated.estimate().records[:1], {}, tmp_path)
    write_predictions(fabricated.estimate().records[1:2], {}, tmp_path)
    assert (tmp_path / "notes.txt").read_text() == "mine"
    assert [path.name for path in (tmp_path / "predictions").iterdir()] == ["5_Hz_A.csv"]


def test_a_place_that_cannot_hold_results_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    for folder in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(InputError, match="found a file at"):
            check_free(folder, overwrite=True)
    assert not (tmp_path / "new").exists()
    check_free(tmp_path / "new" / "deep", overwrite=False)
    assert not (tmp_path / "new").exists()


def test_a_folder_without_permission_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(InputError, match="no permission"):
        check_free(tmp_path / "out", overwrite=False)


def test_an_interrupted_write_leaves_the_older_results_whole(undrawn, tmp_path, monkeypatch):
    write_predictions(fabricated.estimate().records[:2], {}, tmp_path)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("pdssjax.files.estimate_results.write_records", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_estimate(fabricated.estimate(), tmp_path)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


def test_no_caption_says_that_what_was_only_predicted_was_fitted(tmp_path, monkeypatch):
    captions = []
    monkeypatch.setattr(figures, "save_figure", lambda figure, _: captions.append(figure.get_suptitle()))
    write_predictions(fabricated.estimate().records[:2], {}, tmp_path)
    assert len(captions) >= 2
    assert all("not fitted" in caption for caption in captions if "against the voltage" not in caption)


@pytest.mark.parametrize("broken_off", range(5))
def test_a_command_killed_while_results_move_leaves_the_old_or_the_new_estimate_whole(
    tmp_path, monkeypatch, broken_off
):
    names = ("plots", "report.txt", "estimate.json")
    for name in names[1:]:
        (tmp_path / name).write_text("old")
    (tmp_path / "plots").mkdir()
    strokes = []

    def stroke(act):
        def counted(*args, **how):
            if len(strokes) == broken_off:
                raise KeyboardInterrupt
            strokes.append(act)
            return act(*args, **how)

        return counted

    monkeypatch.setattr(results_folder, "remove", stroke(results_folder.remove))
    monkeypatch.setattr(Path, "replace", stroke(Path.replace))
    with contextlib.suppress(KeyboardInterrupt), results_folder.staging_folder(tmp_path, names) as staging:
        (staging / "estimate.json").write_text("new")
        (staging / "report.txt").write_text("new")
    found = (tmp_path / "estimate.json").read_text()
    assert found in ("old", "new")
    if (tmp_path / "report.txt").exists():
        assert (tmp_path / "report.txt").read_text() == found
