"""A sweep that is interrupted goes on where it stopped, and ends as if it had not been."""

import errno
import shutil
from collections import namedtuple

import numpy as np
import pytest
import xarray
from quick_blocks import OVER, example_study, planned, written
from quick_blocks import quick as quick

import pdssjax
from pdssjax import InputError
from pdssjax.cli.main import main
from pdssjax.files import SweepStore
from pdssjax.files.sweep_store import DONE, FAILED
from pdssjax.sweeps import execution, sweeping


@pytest.fixture(scope="module")
def study():
    return example_study()


def stop_after(blocks):
    """Interrupts a sweep once so many blocks are done."""

    def progress(done, count):
        if done >= 64 * blocks:
            raise KeyboardInterrupt

    return progress


def test_a_sweep_that_was_interrupted_ends_as_if_it_had_not_been(tmp_path, study, quick):
    whole = pdssjax.sweep(study, OVER)
    quick.clear()
    with pytest.raises(KeyboardInterrupt):
        pdssjax.sweep(study, OVER, workers=1, store=SweepStore(tmp_path / "s.zarr"), progress=stop_after(3))
    store = SweepStore(tmp_path / "s.zarr", resume=True)
    before = len(quick)
    told = []
    resumed = pdssjax.sweep(study, OVER, store=store, progress=lambda done, count: told.append(done))
    xarray.testing.assert_identical(resumed, whole)
    # No block is computed again that was stored, and those are counted as done.
    assert before >= 3 and told[0] > 64 * 3 and len(told) == 4
    again = pdssjax.sweep(study, OVER, store=SweepStore(tmp_path / "s.zarr", resume=True))
    xarray.testing.assert_identical(again, whole)
    assert len(quick) == before + 4


def test_blocks_that_failed_have_a_reason_and_are_tried_again(tmp_path, study, quick, monkeypatch):
    works = execution.computed_block

    def computed_block(function, points):
        if points[0, 1] > 25.0:
            raise MemoryError("no room")
        return works(function, points)

    monkeypatch.setattr(execution, "computed_block", computed_block)
    store = SweepStore(tmp_path / "s.zarr")
    data = pdssjax.sweep(study, OVER, store=store)
    assert store.reasons() and set(store.reasons().values()) == {"MemoryError: no room"}
    assert set(np.asarray(store._group["status"])) == {DONE, FAILED} and np.isnan(data.net_step).any()
    monkeypatch.setattr(execution, "computed_block", works)
    resumed = pdssjax.sweep(study, OVER, store=SweepStore(tmp_path / "s.zarr", resume=True))
    xarray.testing.assert_identical(resumed, pdssjax.sweep(study, OVER))


@pytest.mark.parametrize(
    ("change", "essential"),
    [
        (dict(values={"friction.f_ss_a": 0.5}), "parameters.friction.f_ss_a: 0.7964, not 0.5"),
        (dict(cycles=3), "cycles: 4, not 3"),
        (dict(over={"drive.voltage": [30.0], "drive.frequency": [5.0]}), "400 points, not all of them among these 1"),
        (
            dict(over=OVER | {"drive.frequency": OVER["drive.frequency"] + 1.0}),
            "400 points, not all of them among these 400",
        ),
    ],
)
def test_the_store_of_another_sweep_is_refused_before_any_work(tmp_path, study, quick, change, essential):
    pdssjax.sweep(study, OVER, store=SweepStore(tmp_path / "s.zarr"))
    quick.clear()
    other = study.with_values(change.get("values", {}))
    with pytest.raises(InputError, match="found the store of another sweep") as refused:
        store = SweepStore(tmp_path / "s.zarr", resume=True)
        pdssjax.sweep(other, change.get("over", OVER), cycles=change.get("cycles", 4), store=store)
    assert essential in str(refused.value) and not quick


def test_axes_can_be_extended_later(tmp_path, study, quick):
    pdssjax.sweep(study, OVER, store=SweepStore(tmp_path / "s.zarr"))
    quick.clear()
    more = {path: np.append(values, [values[-1] + 1.0, values[-1] + 2.0]) for path, values in OVER.items()}
    extended = pdssjax.sweep(study, more, store=SweepStore(tmp_path / "s.zarr", resume=True))
    # 84 new points; with them 16 of a block that was not full.
    assert len(quick) == 2 and len(np.unique(np.concatenate(quick), axis=0)) == 100
    xarray.testing.assert_identical(extended, pdssjax.sweep(study, more))
    quick.clear()
    again = pdssjax.sweep(study, more, store=SweepStore(tmp_path / "s.zarr", resume=True))
    xarray.testing.assert_identical(again, extended)
    assert not quick


def test_an_extension_that_was_interrupted_leaves_the_sweep_as_it_was(tmp_path, study, quick):
    whole = pdssjax.sweep(study, OVER, store=SweepStore(tmp_path / "s.zarr"))
    more = {path: np.append(values, values[-1] + 1.0) for path, values in OVER.items()}
    store = SweepStore(tmp_path / "s.zarr", resume=True)
    store.open(*planned(study, more))
    # All that an extension does but to say how many points there are.
    store._group.attrs["points"] = 400
    resumed = pdssjax.sweep(study, OVER, store=SweepStore(tmp_path / "s.zarr", resume=True))
    xarray.testing.assert_identical(resumed, whole)


def test_a_sweep_begun_where_blocks_are_larger_goes_on_in_those(tmp_path, study, quick, monkeypatch):
    whole = pdssjax.sweep(study, OVER)
    with monkeypatch.context() as many:
        many.setattr(sweeping, "lanes_here", lambda: 192)
        SweepStore(tmp_path / "s.zarr").open(*planned(study))
    quick.clear()
    resumed = pdssjax.sweep(study, OVER, store=SweepStore(tmp_path / "s.zarr", resume=True))
    xarray.testing.assert_identical(resumed, whole)
    assert [len(points) for points in quick] == [192, 192, 192]


def test_a_store_that_is_there_is_neither_resumed_nor_replaced_unasked(tmp_path, study, quick):
    pdssjax.sweep(study, OVER, store=SweepStore(tmp_path / "s.zarr"))
    with pytest.raises(InputError, match="expected --resume"):
        pdssjax.sweep(study, OVER, store=SweepStore(tmp_path / "s.zarr"))
    (tmp_path / "no.zarr").mkdir()
    with pytest.raises(InputError, match="found no store of a sweep"):
        pdssjax.sweep(study, OVER, store=SweepStore(tmp_path / "no.zarr", resume=True))


@pytest.mark.parametrize(
    "damage", [lambda chunk: chunk.write_bytes(chunk.read_bytes()[:30]), lambda chunk: chunk.unlink()]
)
def test_a_block_that_was_damaged_on_the_disk_is_computed_again(tmp_path, study, quick, damage):
    whole = pdssjax.sweep(study, OVER, store=SweepStore(tmp_path / "s.zarr"))
    damage(tmp_path / "s.zarr" / "found" / "c" / "2" / "0")
    quick.clear()
    resumed = pdssjax.sweep(study, OVER, store=SweepStore(tmp_path / "s.zarr", resume=True))
    xarray.testing.assert_identical(resumed, whole)
    assert len(quick) == 1


@pytest.mark.parametrize("gone", ["found", "values", "status"])
def test_a_store_of_which_something_is_gone_is_refused(tmp_path, study, quick, gone):
    pdssjax.sweep(study, OVER, store=SweepStore(tmp_path / "s.zarr"))
    shutil.rmtree(tmp_path / "s.zarr" / gone)
    with pytest.raises(InputError, match=r"found a damaged store.*--overwrite"):
        pdssjax.sweep(study, OVER, store=SweepStore(tmp_path / "s.zarr", resume=True))


def test_too_many_points_for_the_disk_are_refused_before_any_work(tmp_path, study, quick, monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda place: namedtuple("Usage", "total used free")(1, 1, 10_000))
    with pytest.raises(InputError, match=r"found 0\.01 MB free for 400 points, expected 0\.1"):
        pdssjax.sweep(study, OVER, store=SweepStore(tmp_path / "s.zarr"))
    assert not quick and not (tmp_path / "s.zarr").exists()


def test_an_old_zarr_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.metadata.version", lambda name: "3.1.5")
    with pytest.raises(InputError, match=r"found zarr 3\.1\.5, expected 3\.1\.6 or later"):
        SweepStore(tmp_path / "s.zarr")


def test_the_command_resumes(tmp_path, quick, capsys, study):
    arguments = ["sweep", str(written(tmp_path, study)), "--voltage", "20:80:20", "--frequency", "2:50:20"]
    out = tmp_path / "out"
    assert main([*arguments, "--out", str(out)]) == 0
    once = xarray.open_dataset(out / "sweep.nc", engine="scipy").load()
    quick.clear()
    assert main([*arguments, "--out", str(out)]) == 2
    assert main([*arguments, "--out", str(out), "--resume"]) == 0 and not quick
    assert main([*arguments[:-1], "2:50:22", "--out", str(out), "--resume"]) == 2
    assert "found the store of another sweep" in capsys.readouterr().err
    xarray.testing.assert_identical(xarray.open_dataset(out / "sweep.nc", engine="scipy").load(), once)
    assert main([*arguments[:-1], "2:50:22", "--out", str(out), "--overwrite"]) == 0


def test_a_disk_that_fills_up_ends_the_sweep_with_a_line_and_nothing_that_was_done_is_lost(
    tmp_path, quick, capsys, study, monkeypatch
):
    command = ["sweep", str(written(tmp_path, study)), "--voltage", "20:80:20", "--frequency", "2:50:20"]
    keep, room = SweepStore.keep, [3]

    def full(store, number, found):
        if not room[0]:
            raise OSError(errno.ENOSPC, "No space left on device")
        room[0] -= 1
        keep(store, number, found)

    monkeypatch.setattr(SweepStore, "keep", full)
    assert main([*command, "--out", str(tmp_path / "out")]) == 4
    told = capsys.readouterr().err.strip().splitlines()[-1]
    assert "cannot be written (No space left on device)" in told and "go on with --resume" in told
    monkeypatch.setattr(SweepStore, "keep", keep)
    quick.clear()
    assert main([*command, "--out", str(tmp_path / "out"), "--resume"]) == 0 and len(quick) == 4
    assert main([*command, "--out", str(tmp_path / "whole")]) == 0
    found, whole = (xarray.open_dataset(tmp_path / n / "sweep.nc", engine="scipy").load() for n in ("out", "whole"))
    xarray.testing.assert_identical(found, whole)


def test_a_folder_that_takes_no_store_is_told_in_a_line(tmp_path, quick, capsys, study):
    (tmp_path / "file").write_text("")
    command = ["sweep", str(written(tmp_path, study)), "--voltage", "20:80:20"]
    assert main([*command, "--out", str(tmp_path / "file" / "out")]) in (2, 4)
    assert len(capsys.readouterr().err.strip().splitlines()) == 1 and not quick
