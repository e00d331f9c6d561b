"""One process at a time works on a folder of results, and a killed one leaves nothing that is in the way."""

import os
import signal
from pathlib import Path

import pytest
from lock_holder import holding

from pdssjax import InputError, InputWarning
from pdssjax.files import check_empty, file_lock, reserved_folder
from pdssjax.files.file_lock import LOCK, UNFINISHED, folder_lock
from pdssjax.files.results_folder import staging_folder


@pytest.fixture
def holder(tmp_path):
    """A process that has the lock of `tmp_path / "out"`."""
    with holding(tmp_path / "out" / LOCK) as process:
        yield process


def test_a_folder_that_another_process_has_is_refused_until_that_ends(tmp_path, holder):
    out = tmp_path / "out"
    taken = rf"out: found another pdssjax at work in it \(process {holder.pid}\)"
    with pytest.raises(InputError, match=taken), reserved_folder(out, overwrite=True):
        pytest.fail("two at once")
    # By whatever name.
    (tmp_path / "link").symlink_to(out)
    with pytest.raises(InputError, match="another pdssjax"), folder_lock(tmp_path / "link"):
        pytest.fail("two at once")
    assert (out / LOCK).exists()
    holder.communicate("")
    assert not out.exists()
    with reserved_folder(out, overwrite=False):
        assert (out / LOCK).read_text() == f"{os.getpid()}\n"
    assert not out.exists()


def test_what_a_killed_process_leaves_is_no_lock_and_is_cleared_away(tmp_path, holder):
    out = tmp_path / "out"
    (out / f"{UNFINISHED}x" / "plots").mkdir(parents=True)
    (out / f"{UNFINISHED}draws.jsonl").write_text("half")
    (out / "notes.txt").write_text("mine")
    holder.send_signal(signal.SIGKILL)
    holder.wait()
    assert (out / LOCK).exists()
    with reserved_folder(out, overwrite=False):
        assert {path.name for path in out.iterdir()} == {LOCK, "notes.txt"}
    assert {path.name for path in out.iterdir()} == {"notes.txt"}


def test_what_is_left_of_a_killed_command_is_nothing_in_the_way_of_another(tmp_path):
    (tmp_path / f"{UNFINISHED}x").mkdir()
    (tmp_path / LOCK).write_text("123\n")
    check_empty(tmp_path)
    (tmp_path / "check").mkdir()
    with pytest.raises(InputError, match="found something there already"):
        check_empty(tmp_path)


def test_a_process_may_take_a_lock_several_times(tmp_path):
    with folder_lock(tmp_path), folder_lock(tmp_path):
        with folder_lock(tmp_path):
            assert (tmp_path / LOCK).exists()
        assert (tmp_path / LOCK).exists()
    assert not (tmp_path / LOCK).exists() and tmp_path.exists()


def test_folders_that_were_made_for_a_lock_go_with_it_unless_something_is_in_them(tmp_path):
    with folder_lock(tmp_path / "a" / "b"):
        assert (tmp_path / "a" / "b").exists()
    assert not (tmp_path / "a").exists()
    with folder_lock(tmp_path / "a" / "b"):
        (tmp_path / "a" / "found").write_text("")
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["found"]


def test_a_folder_that_was_removed_under_a_command_is_locked_anew(tmp_path):
    out = tmp_path / "out"
    with reserved_folder(out, overwrite=False):
        (out / LOCK).unlink()
        out.rmdir()
        with staging_folder(out) as staging:
            (staging / "estimate.json").write_text("new")
            assert (out / LOCK).exists()
    assert [path.name for path in out.iterdir()] == ["estimate.json"]


def test_results_that_came_from_elsewhere_meanwhile_are_not_replaced(tmp_path):
    with reserved_folder(tmp_path, overwrite=False):
        for text in ("first", "second"):  # its own it replaces
            with staging_folder(tmp_path) as staging:
                (staging / "estimate.json").write_text(text)
        with pytest.raises(FileExistsError, match="other results"), staging_folder(tmp_path) as staging:
            (staging / "estimate.json").write_text("third")
            (tmp_path / "report.txt").write_text("of another command, where the disk knows no locks")
    assert {path.name: path.read_text()[:6] for path in tmp_path.iterdir()} == {
        "estimate.json": "second",
        "report.txt": "of ano",
    }


def test_results_that_were_written_before_the_lock_was_had_are_seen(tmp_path, monkeypatch):
    taken = file_lock._take

    def late(place, about, unfinished):
        (tmp_path / "estimate.json").write_text("of a command that has just ended")
        taken(place, about, unfinished)

    monkeypatch.setattr(file_lock, "_take", late)
    with pytest.raises(InputError, match="found results already"), reserved_folder(tmp_path, overwrite=False):
        pytest.fail("replaced")


def test_a_disk_without_locks_is_said_and_used(tmp_path, monkeypatch):
    def refuse(descriptor):
        raise OSError(38, "Function not implemented")

    monkeypatch.setattr(file_lock, "_lock", refuse)
    told = pytest.warns(InputWarning, match=r"cannot be locked \(Function not implemented\)")
    with told, reserved_folder(tmp_path / "out", overwrite=False), staging_folder(tmp_path / "out") as staging:
        (staging / "estimate.json").write_text("new")
    assert (tmp_path / "out" / "estimate.json").exists()


def test_a_lock_file_that_is_removed_while_it_is_opened_is_made_again(tmp_path, monkeypatch):
    lock, count = file_lock._lock, []

    def removed(descriptor):
        count.append(0)
        if len(count) < 3:
            (tmp_path / LOCK).unlink()
        lock(descriptor)

    monkeypatch.setattr(file_lock, "_lock", removed)
    with folder_lock(tmp_path):
        assert len(count) == 3 and Path(tmp_path / LOCK).exists()
