"""A sweep that is interrupted goes on where it stopped, and ends as if it had not been."""

import contextlib
import errno
import json
import shutil
import warnings
from collections import namedtuple

import numpy as np
import pytest
import xarray
import zarr
from lock_holder import holding
from quick_blocks import OVER, found_at, planned, quick as quick, study as study, written

import pdssjax
from pdssjax import InputError, InputWarning
from pdssjax.cli.main import main
from pdssjax.files import SweepStore, read_sweep, write_sweep
from pdssjax.files.sweep_store import DONE, PENDING
from pdssjax.sweeps import POINT_FAILURES, execution, sweeping
from pdssjax.sweeps.blocks import NOT_COMPUTED

pytestmark = pytest.mark.usefixtures("undrawn")


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


def test_blocks_that_failed_are_told_with_the_reason_and_tried_again(tmp_path, study, quick, monkeypatch):
    works = execution.compute_block

    def compute_block(function, points):
        if points[0, 1] > 25.0:
            raise MemoryError("no room")
        return works(function, points)

    monkeypatch.setattr(execution, "compute_block", compute_block)
    store = SweepStore(tmp_path / "s.zarr")
    with pytest.warns(InputWarning, match=r"a block of \d+ points cannot be computed \(MemoryError: no room\)"):
        data = pdssjax.sweep(study, OVER, store=store)
    assert set(np.asarray(store._group["status"])) == {DONE, PENDING} and np.isnan(data.net_step).any()
    monkeypatch.setattr(execution, "compute_block", works)
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
        many.setattr(sweeping, "default_lanes", lambda: 192)
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


def flip_a_bit(place):
    """Of a number in the second block, as a disk may: the chunk can be read as before."""
    array = zarr.open_group(place)["found"]
    rows = np.asarray(array[64:128])
    rows.view(np.uint64)[5, 1] ^= np.uint64(1) << np.uint64(62)
    array[64:128] = rows


def exchange(place):
    chunks = place / "found" / "c"
    (chunks / "1").rename(chunks / "x")
    (chunks / "2").rename(chunks / "1")
    (chunks / "x").rename(chunks / "2")


def of_another_sweep(place):
    shutil.copytree(
        place.with_name("other.zarr") / "found" / "c" / "1", place / "found" / "c" / "1", dirs_exist_ok=True
    )


def remove(name):
    return lambda place: shutil.rmtree(place / name)


def change_metadata(name, **changes):
    def change(place):
        file = place / name / "zarr.json"
        file.write_text(json.dumps(json.loads(file.read_text()) | changes))

    return change


DAMAGE = {
    "cut": (lambda place: [c.write_bytes(c.read_bytes()[:30]) for c in (place / "found" / "c" / "1").iterdir()], 1),
    "gone": (remove("found/c/1"), 1),
    "a bit": (flip_a_bit, 1),
    "exchanged": (exchange, 2),
    "of another sweep": (of_another_sweep, 1),
    "a digest gone": (remove("digest/c/1"), 1),
    "bytes": (
        change_metadata(
            "found",
            codecs=[
                {"name": "bytes", "configuration": {"endian": "big"}},
                {"name": "zstd", "configuration": {"level": 0, "checksum": False}},
            ],
        ),
        7,
    ),
}


@pytest.mark.parametrize(("damage", "blocks"), DAMAGE.values(), ids=DAMAGE.keys())
def test_a_block_that_was_damaged_on_the_disk_is_computed_again(tmp_path, study, quick, damage, blocks):
    whole = pdssjax.sweep(study, OVER, store=SweepStore(tmp_path / "s.zarr"))
    if damage is of_another_sweep:
        further = OVER | {"drive.frequency": OVER["drive.frequency"] + 1.0}
        pdssjax.sweep(study, further, store=SweepStore(tmp_path / "other.zarr"))
    damage(tmp_path / "s.zarr")
    quick.clear()
    listed = "1, 2" if damage is exchange else "1" if blocks == 1 else "0, 1, 2, 3, 4, 5, 6"
    with pytest.warns(InputWarning, match=rf"s\.zarr: blocks? {listed}: found results that do not match their digest"):
        resumed = pdssjax.sweep(study, OVER, store=SweepStore(tmp_path / "s.zarr", resume=True))
    xarray.testing.assert_identical(resumed, whole)
    assert len(quick) == blocks
    again = pdssjax.sweep(study, OVER, store=SweepStore(tmp_path / "s.zarr", resume=True))
    xarray.testing.assert_identical(again, whole)


def test_every_bit_of_a_chunk_is_watched(tmp_path, study, quick):
    whole = pdssjax.sweep(study, OVER, store=SweepStore(tmp_path / "s.zarr"))
    (chunk,) = (tmp_path / "s.zarr" / "found" / "c" / "1").iterdir()
    sound = chunk.read_bytes()
    for at in np.random.default_rng(1).integers(len(sound), size=4):
        chunk.write_bytes(sound[:at] + bytes([sound[at] ^ 1 << at % 8]) + sound[at + 1 :])
        store = SweepStore(tmp_path / "s.zarr", resume=True)
        with warnings.catch_warnings():
            # A bit of the compression that means nothing is no damage.
            warnings.simplefilter("ignore", InputWarning)
            xarray.testing.assert_identical(pdssjax.sweep(study, OVER, store=store), whole)


def test_what_is_damaged_after_it_was_computed_is_left_out_and_said(tmp_path, study, quick):
    store = SweepStore(tmp_path / "s.zarr")
    document, plan = planned(study)
    plan, numbers = store.open(document, plan)
    for number in numbers:
        store.keep(number, found_at(plan.values[plan.place(number)]))
    flip_a_bit(tmp_path / "s.zarr")
    with pytest.warns(InputWarning, match="block 1: found results that do not match their digest; they are left out"):
        rows = store.read()
    store.close()
    assert np.flatnonzero(rows[:, -1] == NOT_COMPUTED).tolist() == list(range(64, 128))


REFUSED = [
    (change_metadata("found", data_type="int64", fill_value=0), "found: int64 of shape"),
    (change_metadata("found", data_type="float32"), "found: float32 of shape"),
    (change_metadata("found", shape=[300, 6]), r"of shape \(300, 6\)"),
    (change_metadata("status", data_type="no"), "damaged"),
    (change_metadata("", attributes={"lanes": 64, "points": 400}), "found no store of a sweep"),
    (change_metadata("values", fill_value="x"), "damaged"),
    *((remove(name), r"found a damaged store.*--overwrite") for name in ("found", "values", "status", "digest")),
]


def test_a_store_of_other_arrays_or_without_some_is_refused(tmp_path, study, quick):
    pdssjax.sweep(study, OVER, store=SweepStore(tmp_path / "s.zarr"))
    for number, (damage, said) in enumerate(REFUSED):
        place = shutil.copytree(tmp_path / "s.zarr", tmp_path / f"{number}.zarr")
        damage(place)
        with pytest.raises(InputError, match=said) as refused:
            pdssjax.sweep(study, OVER, store=SweepStore(place, resume=True))
        assert "\n" not in str(refused.value)


def test_a_store_with_other_attributes_gives_no_wrong_numbers(tmp_path, study, quick):
    whole = pdssjax.sweep(study, OVER, store=SweepStore(tmp_path / "s.zarr"))
    document = json.loads((tmp_path / "s.zarr" / "zarr.json").read_text())
    changes = [*({"points": points} for points in (0, 399, 401, 10**9)), *({"lanes": n} for n in (0, 64.5, 32))]
    for number, changed in enumerate(changes):
        place = shutil.copytree(tmp_path / "s.zarr", tmp_path / f"{number}.zarr")
        text = json.dumps(document | {"attributes": document["attributes"] | changed})
        (place / "zarr.json").write_text(text)
        with warnings.catch_warnings(), contextlib.suppress(InputError):
            warnings.simplefilter("ignore", InputWarning)
            found = pdssjax.sweep(study, OVER, store=SweepStore(place, resume=True))
            xarray.testing.assert_identical(found, whole)


def test_two_processes_have_no_store_at_once(tmp_path, study, quick):
    with holding(tmp_path / ".s.zarr.lock") as other:
        with pytest.raises(InputError, match=r"s\.zarr: found another pdssjax at work in it"):
            pdssjax.sweep(study, OVER, store=SweepStore(tmp_path / "s.zarr", overwrite=True))
        other.communicate("")
    (tmp_path / ".unfinished-s.zarr-x").mkdir()
    pdssjax.sweep(study, OVER, store=SweepStore(tmp_path / "s.zarr", overwrite=True))
    assert [path.name for path in tmp_path.iterdir()] == ["s.zarr"]


@pytest.mark.parametrize("store", ["netcdf", "zarr"])
def test_a_dataset_that_was_changed_on_the_disk_is_refused(tmp_path, study, quick, store):
    data = pdssjax.sweep(study, OVER)
    write_sweep(data, tmp_path, store)
    xarray.testing.assert_equal(read_sweep(tmp_path), data)
    if store == "netcdf":
        changed = xarray.open_dataset(tmp_path / "sweep.nc", engine="scipy").load()
        changed["net_step"][3, 4] += 1e-9
        changed.to_netcdf(tmp_path / "sweep.nc", engine="scipy")
    else:
        array = zarr.open_group(tmp_path / "sweep.zarr")["net_step"]
        array[3, 4] = np.asarray(array[3, 4]) + 1e-9
    with pytest.raises(
        InputError, match=f"sweep.{'nc' if store == 'netcdf' else store}: found numbers that do not match"
    ):
        read_sweep(tmp_path)


def test_too_many_points_for_the_disk_are_refused_before_any_work(tmp_path, study, quick, monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda place: namedtuple("Usage", "total used free")(1, 1, 10_000))
    with pytest.raises(InputError, match=r"found 0\.01 MB free for 400 points, expected 0\.2"):
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


def test_a_sweep_whose_every_point_failed_is_no_success(tmp_path, capsys, study, monkeypatch):
    def compute_block(function, points):
        found = np.full((len(points), 6), np.nan)
        found[:, -1] = 1.0
        return found

    monkeypatch.setattr(execution, "compute_block", compute_block)
    command = ["sweep", str(written(tmp_path, study)), "--voltage", "20:80:3", "--out", str(tmp_path / "out")]
    assert main(command) == 3
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert said == f"pdssjax: error: none of the 3 points has a value; of most the failure is: {POINT_FAILURES[1]}"
    assert (tmp_path / "out" / "sweep.nc").exists()


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
