"""Draws in a file, where its disk takes no more of them."""

import contextlib
import json

import pytest

from pdssjax import InputWarning
from pdssjax.files import DrawsFile
from pdssjax.files.draws_file import DRAWS

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


@pytest.mark.parametrize(("room", "on_disk"), [(240, 5), (20, None)])
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
        assert len((tmp_path / DRAWS).read_bytes()) == room
        return
    assert list(DrawsFile(tmp_path, resume=True).kept()) == ENTRIES[:on_disk]
    assert json.loads((tmp_path / DRAWS).read_text().splitlines()[-1]) == ENTRIES[on_disk - 1]
