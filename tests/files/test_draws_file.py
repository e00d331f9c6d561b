"""Draws in a file, where its disk takes no more of them."""

import contextlib
import json

import pytest

from pdssjax import InputError, InputWarning
from pdssjax.files import DrawsFile
from pdssjax.files.draws_file import DRAWS, FORMAT

ENTRIES = [{"number": number, "free": [0.125, 0.5]} for number in range(9)]


@contextlib.contextmanager
def no_file_above(size):
    """The system takes no byte of any file beyond `size`, as a disk that is full, in the middle of a line."""
    resource = pytest.importorskip("resource")
    usual = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, usual[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, usual)


@pytest.mark.parametrize(("room", "on_disk"), [(650, 6), (20, None)])
def test_a_full_disk_costs_no_draws_and_is_said_once(tmp_path, room, on_disk):
    file = DrawsFile(tmp_path, resume=False)
    with pytest.warns(InputWarning, match=rf"{DRAWS}: cannot be written to .* in memory alone") as told:
        with no_file_above(room):
            file.begin({"seed": 0})
            for entry in ENTRIES:
                file.keep(entry)
        file.keep({"number": 9})  # there is room again, after a line that was cut
    assert len(told) == 1
    assert list(file.kept()) == [*ENTRIES, {"number": 9}]
    if on_disk is None:
        assert list(tmp_path.iterdir()) == []
        return
    assert list(DrawsFile(tmp_path, resume=True).kept()) == ENTRIES[:on_disk]
    assert json.loads((tmp_path / DRAWS).read_text().splitlines()[-1])["number"] == on_disk - 1


def run_of(folder, what, entries=ENTRIES):
    """A file of draws as a run leaves it, and its lines."""
    file = DrawsFile(folder, resume=False)
    file.begin(what)
    for entry in entries:
        file.keep(entry)
    return file, (folder / DRAWS).read_text().splitlines(keepends=True)


def resumed(folder):
    """What a run goes on with, and the warning about what it leaves out."""
    with pytest.warns(InputWarning) as told:
        entries = list(DrawsFile(folder, resume=True).kept())
    assert len(told) == 1
    # That is said once: the file is then what was kept.
    assert list(DrawsFile(folder, resume=True).kept()) == entries
    return entries, str(told[0].message)


DAMAGE = {
    "a digit": lambda line: line.replace("0.125", "0.126"),
    "a number": lambda line: line.replace('"number": 3', '"number": 8'),
    "NaN": lambda line: line.replace("0.125", "NaN"),
    "infinity": lambda line: line.replace("0.125", "Infinity"),
    "too large": lambda line: line.replace("0.125", "1e999"),
    "no digest": lambda line: json.dumps(ENTRIES[3]) + "\n",
    "no object": lambda line: "7\n",
    "no JSON": lambda line: line[:20] + "\n",
    "a bit": lambda line: line[:20] + chr(ord(line[20]) ^ 1) + line[21:],
    "an empty line": lambda line: "\n",
}


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE.keys())
def test_a_line_that_is_not_what_was_written_is_left_out(tmp_path, damage):
    _, lines = run_of(tmp_path, {"seed": 0})
    assert damage(lines[4]) != lines[4]
    (tmp_path / DRAWS).write_text("".join([*lines[:4], damage(lines[4]), *lines[5:]]))
    entries, told = resumed(tmp_path)
    assert entries == [*ENTRIES[:3], *ENTRIES[4:]]
    assert "found 1 lines that are damaged or of another run (line 5)" in told


def test_a_byte_that_is_no_text_costs_its_line_alone(tmp_path):
    _, lines = run_of(tmp_path, {"seed": 0})
    (tmp_path / DRAWS).write_bytes("".join(lines).encode().replace(b'"number": 3', b'"num\xffer": 3'))
    assert resumed(tmp_path)[0] == [*ENTRIES[:3], *ENTRIES[4:]]


def test_lines_of_another_run_are_left_out(tmp_path):
    for name, what in (("a", {"seed": 0, "free": [1.0]}), ("b", {"seed": 0, "free": [1.0000000000000002]})):
        (tmp_path / name).mkdir()
        run_of(tmp_path / name, what)
    first, second = ((tmp_path / name / DRAWS).read_text().splitlines(keepends=True) for name in "ab")
    # Two processes at once, where the disk knows no locks: a second head, and lines of both.
    (tmp_path / "a" / DRAWS).write_text("".join([*first[:3], *second, *first[3:]]))
    entries, told = resumed(tmp_path / "a")
    assert entries == ENTRIES and "found 10 lines" in told


def test_a_head_that_is_not_what_was_written_is_refused(tmp_path):
    _, lines = run_of(tmp_path, {"seed": 0})
    (tmp_path / DRAWS).write_text("".join([lines[0].replace('"seed": 0', '"seed": 1'), *lines[1:]]))
    with pytest.raises(InputError, match="line 1: found content that does not match its digest"):
        DrawsFile(tmp_path, resume=True)


def test_a_file_that_is_removed_while_a_run_goes_on_costs_no_draws_and_is_said(tmp_path):
    file, _ = run_of(tmp_path, {"seed": 0}, ENTRIES[:4])
    (tmp_path / DRAWS).unlink()
    with pytest.warns(InputWarning, match="kept in memory alone"):
        file.keep(ENTRIES[4])
    assert list(file.kept()) == ENTRIES[:5] and not (tmp_path / DRAWS).exists()


def test_numbers_that_are_not_finite_are_null(tmp_path):
    run_of(tmp_path, {"low": float("-inf")}, [{"free": [float("nan"), float("inf"), 1.0]}])
    again = DrawsFile(tmp_path, resume=True)
    assert list(again.kept()) == [{"free": [None, None, 1.0]}]
    assert again.begun() == {"format": FORMAT, "low": float("-inf")}
