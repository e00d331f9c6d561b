"""A sweep that a signal ends, at any moment, keeps what it has computed and goes on from there."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import quick_blocks
import xarray
import zarr
from quick_blocks import study as study, written

from pdssjax.files.sweep_store import DONE

PROGRAM = """
import hashlib, itertools, signal, sys
from quick_blocks import found_at
from pdssjax.cli.main import run
from pdssjax.sweeps import execution

# Tests that run in the background of a shell inherit that it is ignored.
signal.signal(signal.SIGINT, signal.default_int_handler)
quick = int(sys.argv.pop(1))
counted = itertools.count()

def compute_block(function, points):
    if next(counted) >= quick:
        print("deaf", file=sys.stderr, flush=True)
        hashlib.pbkdf2_hmac("sha256", b"", b"", 300_000_000)  # minutes
    return found_at(points)

execution.compute_block = compute_block
sys.exit(run())
"""
"""The command line, whose blocks after so many hear no signal, as while a compiler works."""


@pytest.mark.parametrize(("signum", "quick", "status"), [(signal.SIGINT, 0, 130), (signal.SIGTERM, 3, 143)])
def test_a_signal_ends_a_sweep_at_once_and_keeps_its_blocks(tmp_path, study, signum, quick, status):
    axes = ["--voltage", "20:80:20", "--frequency", "2:50:20"]
    command = [str(quick), "sweep", str(written(tmp_path, study)), *axes, "--out", str(tmp_path / "out")]
    paths = os.pathsep.join([str(Path(quick_blocks.__file__).parent), *sys.path])
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM, *command],
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": paths},
    ) as process:
        assert process.stderr is not None
        assert any("deaf" in line for line in process.stderr)
        time.sleep(0.5)  # until all blocks before are stored
        process.send_signal(signum)
        try:
            told = process.communicate(timeout=20)[1]
        finally:
            process.kill()
    assert process.returncode == status and told.endswith("go on with --resume\npdssjax: interrupted\n")
    group = zarr.open_group(tmp_path / "out" / "points.zarr", mode="r")
    assert list(np.asarray(group["status"])).count(DONE) == quick


@pytest.mark.slow
def test_a_sweep_that_was_killed_at_ten_random_moments_ends_as_if_it_had_not_been(tmp_path, study):
    arguments = ["sweep", str(written(tmp_path, study)), "--voltage", "20:80:128", "--frequency", "20:50:128"]
    command = [sys.executable, "-m", "pdssjax", *arguments, "--workers", "1", "--resume", "--out"]
    place, rng, stored = tmp_path / "killed", np.random.default_rng(13), [0]
    for turn in range(10):
        killed = subprocess.Popen([*command, str(place)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        computes = turn % 2 == 1
        # While it begins, or while it computes: a block more is stored then.
        while computes and blocks_done(place / "points.zarr") == stored[-1]:
            assert killed.poll() is None
            time.sleep(0.02)
        time.sleep(rng.uniform(0.0, 0.2 if computes else 2.0))
        killed.send_signal(signal.SIGKILL)
        assert killed.wait() == -signal.SIGKILL
        stored.append(blocks_done(place / "points.zarr"))
    # Nothing that was stored is lost, and there was something to lose and something left.
    assert stored == sorted(stored) and len(set(stored)) >= 5 and 0 < stored[-1] < 256, stored
    assert not (place / "sweep.nc").exists()
    for folder in ("killed", "whole"):
        subprocess.run(
            [*command, str(tmp_path / folder)], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
    found, whole = (xarray.open_dataset(tmp_path / n / "sweep.nc", engine="scipy").load() for n in ("killed", "whole"))
    xarray.testing.assert_identical(found, whole)


def blocks_done(place):
    """How many blocks a store holds; none where there is no store yet."""
    if not place.exists():
        return 0
    return int((np.asarray(zarr.open_group(place, mode="r")["status"]) == DONE).sum())
