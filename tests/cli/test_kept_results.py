"""What was computed is not lost where its folder, or even the standard output, takes nothing more."""

import errno
import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from platform_study import PLATFORM, write_platform

from pdssjax.cli import main as cli
from pdssjax.files import EXAMPLE


@pytest.fixture
def full(monkeypatch):
    """Fills the disks below the given folders: nothing can be written there any more."""
    folders: list[Path] = []
    write_text = Path.write_text

    def refuse(self, text, **how):
        if any(self.is_relative_to(folder) for folder in folders):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self))
        return write_text(self, text, **how)

    monkeypatch.setattr(Path, "write_text", refuse)
    return folders


@pytest.fixture
def temporary(tmp_path, monkeypatch):
    """The folder for temporary files."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def test_the_report_is_printed_before_anything_is_written(calls, tmp_path, monkeypatch, capsys):
    printed = []
    monkeypatch.setattr("pdssjax.files.write_estimate", lambda *given: printed.append(capsys.readouterr().out))
    assert cli.main(["identify", "--out", str(tmp_path / "out")]) == 0
    assert "[[Rig, July]]" in printed[0]


def test_a_full_disk_sends_the_results_elsewhere_and_says_where(calls, tmp_path, full, temporary, capsys):
    full.append(tmp_path / "out")
    assert cli.main(["identify", "--out", str(tmp_path / "out")]) == 4
    printed = capsys.readouterr()
    assert "[[Rig, July]]" in printed.out and "Results are in" not in printed.out
    assert f"{tmp_path / 'out'}: cannot be written to (No space left on device)" in printed.err
    told = re.search(r"the results are in (\S+) instead", printed.err)
    assert told is not None and Path(told[1]).parent == temporary
    assert json.loads((Path(told[1]) / "estimate.json").read_text())["converged"] is True
    assert (Path(told[1]) / "plots").is_dir()
    assert not (tmp_path / "out").exists()


def test_where_no_disk_takes_it_the_estimate_is_printed(calls, tmp_path, full, temporary, capsys):
    full += [tmp_path / "out", temporary]
    assert cli.main(["identify", "--out", str(tmp_path / "out")]) == 4
    printed = capsys.readouterr()
    assert "the estimate is printed here" in printed.err
    document = json.loads(printed.out[printed.out.index("\n{") :])
    assert document["format"] == "pdssjax-estimate/1"
    assert list(temporary.iterdir()) == [] and not (tmp_path / "out").exists()


def test_a_simulation_is_kept_elsewhere_too(tmp_path, full, temporary, capsys):
    study = write_platform(tmp_path, PLATFORM)
    full.append(tmp_path / "out")
    assert cli.main(["simulate", str(study), "--guess", "--out", str(tmp_path / "out")]) == 4
    assert "[[Records" in capsys.readouterr().out
    (kept,) = temporary.iterdir()
    assert {path.name for path in kept.iterdir()} == {"parameters.json", "predictions", "plots"}


def test_a_write_that_is_broken_off_still_leaves_the_estimate(calls, tmp_path, monkeypatch, capsys):
    def interrupted(*given):
        raise KeyboardInterrupt

    monkeypatch.setattr("pdssjax.files.estimate_results.write_records", interrupted)
    assert cli.main(["identify", "--out", str(tmp_path)]) == 130
    assert {path.name for path in tmp_path.iterdir()} == {"estimate.json", "report.txt"}
    assert f"the estimate is in {tmp_path / 'estimate.json'}, without plots" in capsys.readouterr().err


PROGRAM = """
import sys
sys.path[:0] = [{tests!r}]
import dataclasses, fabricated, pdssjax
from pdssjax.cli import main as cli
from pdssjax.files import EXAMPLE
whole = fabricated.estimate()
vars(pdssjax)["load_study"] = lambda path: None
vars(pdssjax)["identify"] = lambda *given, **how: dataclasses.replace(whole, records=whole.records[:1])
sys.exit(cli.main(["identify", "--out", {out!r}]))
"""


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full on this system")
def test_a_standard_output_that_takes_nothing_costs_no_results(tmp_path):
    program = PROGRAM.format(tests=str(Path(__file__).parents[1] / "helpers"), out=str(tmp_path / "out"))
    with open("/dev/full", "w") as nowhere:
        ended = subprocess.run([sys.executable, "-c", program], stdout=nowhere, stderr=subprocess.PIPE, text=True)
    assert ended.returncode == 0
    assert "cannot print any further (No space left on device)" in ended.stderr
    assert (tmp_path / "out" / "estimate.json").exists() and (tmp_path / "out" / "plots").is_dir()


def unread_pipe() -> int:
    """The end to write to of a pipe whose other end is closed."""
    reader, writer = os.pipe()
    os.close(reader)
    return writer


def full_disk() -> int:
    """A file on a disk without room."""
    if not os.path.exists("/dev/full"):
        pytest.skip("no /dev/full on this system")
    return os.open("/dev/full", os.O_WRONLY)


@pytest.mark.parametrize("opened", [unread_pipe, full_disk])
def test_nor_does_a_standard_error_that_takes_nothing(calls, tmp_path, monkeypatch, capsys, opened):
    calls.converged = False  # so that progress and a warning are told
    with os.fdopen(opened(), "w", buffering=1) as nowhere:
        monkeypatch.setattr(sys, "stderr", nowhere)
        assert cli.main(["identify", "--out", str(tmp_path / "out")]) == 3
    assert f"Results are in {tmp_path / 'out'}" in capsys.readouterr().out
    assert (tmp_path / "out" / "estimate.json").exists() and (tmp_path / "out" / "plots").is_dir()


@pytest.mark.parametrize("opened", [unread_pipe, full_disk])
def test_the_exit_status_does_not_depend_on_who_reads_the_standard_error(opened):
    command = [sys.executable, "-m", "pdssjax", "channels", "none.csv", str(EXAMPLE / "sawtooth_5Hz_A.csv")]
    with os.fdopen(opened(), "w") as nowhere:
        ended = subprocess.run(command, stdout=subprocess.PIPE, stderr=nowhere, text=True)
    assert ended.returncode == 2
    assert "sawtooth_5Hz_A.csv" in ended.stdout


def test_a_standard_error_closed_from_the_start_leaves_the_results_alone(calls, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "stderr", None)
    assert cli.main(["channels", "none.csv", str(EXAMPLE / "sawtooth_5Hz_A.csv")]) == 2
    assert capsys.readouterr().out.startswith("[[")
