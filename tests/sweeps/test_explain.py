"""`pdssjax sweep --explain` prints what a sweep takes, and computes none of it."""

from quick_blocks import example_study

from pdssjax.cli.main import main


def test_points_blocks_and_room_are_printed_and_nothing_is_made(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("pdssjax.cli.sweep.study_of", lambda options: example_study())
    axes = ["--vary", "drive.frequency=5:20:3", "--vary", "drive.fall_time=1 ms:100 ms:40"]
    assert main(["sweep", "study.toml", "--out", str(tmp_path / "out"), *axes, "--explain"]) == 0
    lines = capsys.readouterr().out.split("\n")
    assert lines[1].split() == ["points", "120", "28", "of", "them", "skipped"]
    assert lines[2].split()[:4] == ["blocks", "2", "of", "64"]
    assert lines[3].split()[-3:] == ["MB", "at", "most"]
    assert not (tmp_path / "out").exists()
