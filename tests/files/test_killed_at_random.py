"""Commands that are killed at random moments, and pairs of them on one folder: nothing is lost, nothing is mixed.

The commands are forked, which is possible since none of them computes with JAX: a run costs milliseconds.
"""

import json
import os
import signal
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import pytest

from pdssjax import InputError
from pdssjax.files import DrawsFile, SweepStore, reserved_folder
from pdssjax.files.draws_file import DRAWS
from pdssjax.files.file_lock import LOCK, UNFINISHED
from pdssjax.files.results_folder import staging_folder
from pdssjax.sweeps import BlockPlan

pytestmark = [pytest.mark.slow, pytest.mark.skipif(sys.platform != "linux", reason="forks")]

KILLS, PAIRS, ENTRIES, BLOCKS, LANES = 50, 20, 30, 12, 4


def forked(command, *arguments):
    """The process that runs a command, whose exit status is 0, 2 where it is refused, or that of a traceback."""
    process = os.fork()
    if process:
        return process
    status = 1
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            command(*arguments)
        status = 0
    except InputError:
        status = 2
    finally:
        os._exit(status)


def draw(folder: Path, study: int):
    """As `identify --intervals bootstrap --resume`: draws that tell study and number, then results made of them."""
    with reserved_folder(folder, overwrite=True):
        resume = (folder / DRAWS).exists()
        file = DrawsFile(folder, resume)
        if resume and file.begun()["study"] != study:
            raise InputError("the draws of another study")
        if not resume:
            file.begin({"study": study})
        there = {entry["number"] for entry in file.kept()}
        for number in range(ENTRIES):
            if number not in there:
                time.sleep(0.002)
                file.keep({"number": number, "free": [study + number / 7.0]})
        put(folder, study, sorted((entry["number"], entry["free"][0]) for entry in file.kept()))


def sweep(folder: Path, study: int):
    """As `sweep --resume`: blocks that tell study and point."""
    document = {"metrics": ["speed"], "study": study}
    values = np.arange(1.0 * BLOCKS * LANES)[:, None]
    plan = BlockPlan(values, np.arange(len(values)), LANES)
    with reserved_folder(folder, overwrite=True):
        store = SweepStore(folder / "points.zarr", resume=True)
        plan, due = store.open(document, plan)
        for number in due:
            time.sleep(0.002)
            rows = plan.values[plan.place(number)]
            store.keep(number, np.column_stack([study + rows / 7.0, 0.0 * rows]))
        found = store.read()
        store.close()
        put(folder, study, found[:, 0].tolist())


def put(folder: Path, study: int, found: object):
    with staging_folder(folder) as staging:
        (staging / "predictions").mkdir()
        (staging / "predictions" / f"{study}.csv").write_text(f"{study}")
        (staging / "report.txt").write_text(f"{study}")
        (staging / "estimate.json").write_text(json.dumps({"study": study, "found": found}))


def expected(command, study: int):
    """What a command finds that nothing disturbs."""
    if command is draw:
        return [[number, study + number / 7.0] for number in range(ENTRIES)]
    return [study + number / 7.0 for number in range(BLOCKS * LANES)]


def is_whole(folder: Path, command) -> int:
    """Of which study the results are, all of them, with nothing besides."""
    document = json.loads((folder / "estimate.json").read_text())
    study = document["study"]
    assert document["found"] == expected(command, study)
    assert (folder / "report.txt").read_text() == f"{study}"
    assert [path.name for path in (folder / "predictions").iterdir()] == [f"{study}.csv"]
    kept = {draw: DRAWS, sweep: "points.zarr"}[command]
    assert {path.name for path in folder.iterdir()} == {"estimate.json", "report.txt", "predictions", kept}
    return study


@pytest.mark.parametrize("command", [draw, sweep])
def test_what_is_killed_at_random_moments_ends_as_if_it_had_not_been(tmp_path, command):
    random, killed, folders = np.random.default_rng(17), 0, 0
    while killed < KILLS:
        folder, folders = tmp_path / f"{folders}", folders + 1
        while killed < KILLS:
            process = forked(command, folder, 1)
            time.sleep(random.uniform(0.0, 0.12))
            os.kill(process, signal.SIGKILL)
            ended = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
            assert ended in (0, -signal.SIGKILL)
            killed += ended != 0
            if ended == 0:
                break
        assert os.waitstatus_to_exitcode(os.waitpid(forked(command, folder, 1), 0)[1]) == 0
        assert is_whole(folder, command) == 1


@pytest.mark.parametrize("command", [draw, sweep])
def test_two_commands_on_one_folder_mix_nothing(tmp_path, command):
    random = np.random.default_rng(19)
    for number in range(PAIRS):
        folder = tmp_path / f"{number}"
        first = forked(command, folder, 1)
        time.sleep(random.uniform(0.0, 0.05))
        second = forked(command, folder, 2)
        ended = [os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) for process in (first, second)]
        # Refused is the one that finds the other at work, or what the other has kept.
        assert sorted(ended) == [0, 2]
        assert is_whole(folder, command) == 1 + ended.index(0)
        assert not list(folder.glob(f"{UNFINISHED}*")) and not (folder / LOCK).exists()
