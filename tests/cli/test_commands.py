"""The command line: exit status, what it prints, what it writes and what it leaves alone."""

import json
import os
import time
import warnings
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import pdssjax
from pdssjax import InputError, InputWarning
from pdssjax.cli import console, main as cli
from pdssjax.cli.console import counter
from pdssjax.files import EXAMPLE, DrawsFile
from pdssjax.study.measurement.effector import Effector


def test_identify_reports_and_writes(calls, tmp_path, capsys):
    out = tmp_path / "out"
    assert cli.main(["identify", "rig.toml", "--out", str(out)]) == 0
    printed = capsys.readouterr()
    assert [str(path) for path in calls.studies] == ["rig.toml"]
    assert calls.methods == ["joint"]
    assert (out / "estimate.json").exists()
    assert "[[Rig, July]]" in printed.out
    assert printed.out.rstrip().endswith(str(out))
    assert printed.err.splitlines()[0] == "[1/2] joint"


def test_identify_takes_the_packaged_example_by_default(calls, tmp_path):
    assert cli.main(["identify", "--out", str(tmp_path)]) == 0
    assert calls.studies == [EXAMPLE / "study.toml"]
    assert calls.studies[0].exists()


def test_what_xla_logs_is_hidden_unless_it_was_asked_for(monkeypatch, capsys):
    monkeypatch.setitem(os.environ, "TF_CPP_MIN_LOG_LEVEL", "0")
    cli.main(["models"])
    assert os.environ["TF_CPP_MIN_LOG_LEVEL"] == "0"
    monkeypatch.delitem(os.environ, "TF_CPP_MIN_LOG_LEVEL")
    cli.main(["models"])
    assert os.environ["TF_CPP_MIN_LOG_LEVEL"] == "3"


def test_both_methods_are_compared_side_by_side(calls, tmp_path, capsys):
    assert cli.main(["identify", "--out", str(tmp_path), "--method", "both"]) == 0
    assert calls.methods == ["joint", "sequential"]
    assert (tmp_path / "joint" / "estimate.json").exists()
    assert (tmp_path / "sequential" / "estimate.json").exists()
    shown = capsys.readouterr()
    assert "[[Joint and sequential side by side]]" in shown.out
    assert "pdssjax: without peaks: rig.toml: found no step, expected one.\n" in shown.err
    assert (tmp_path / "comparison.txt").read_text() in shown.out
    assert (tmp_path / "comparison.png").read_bytes().startswith(b"\x89PNG")


def test_where_the_records_show_peaks_three_ways_are_compared(calls, tmp_path, capsys):
    calls.peaks = True
    arguments = ["identify", "--out", str(tmp_path), "--method", "both"]
    assert cli.main(arguments) == 0
    assert calls.methods == ["joint", "sequential", "peaks"]
    assert all((tmp_path / method / "estimate.json").exists() for method in calls.methods)
    shown = capsys.readouterr()
    assert "[[Joint, sequential and peaks side by side]]" in shown.out
    assert "without peaks" not in shown.err
    assert cli.main(arguments) == 2
    assert len(calls.methods) == 3, "nothing is fitted again"


@pytest.mark.parametrize(
    ("method", "intervals"), [("sequential", "profile"), ("sequential", "posterior"), ("peaks", "bootstrap")]
)
def test_intervals_that_a_method_has_not_are_refused_before_any_work(calls, tmp_path, capsys, method, intervals):
    arguments = ["identify", "--out", str(tmp_path / "out"), "--method", method, "--intervals", intervals]
    assert cli.main(arguments) == 2
    assert f'intervals: found "{intervals}" with method "{method}", expected' in capsys.readouterr().err
    assert calls.studies == [] and not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("option", "value", "note"),
    [
        ("--intervals", "profile", "the sequential method has none, and its intervals are linear."),
        ("--loss", "huber", "the sequential method has no robust loss, and glitches pull it as they do least squares."),
    ],
)
def test_of_several_methods_those_without_what_was_asked_for_say_so(calls, tmp_path, option, value, note):
    assert cli.main(["identify", "--out", str(tmp_path), "--method", "both", option, value]) == 0
    assert f"No {value}: {note}" in " ".join((tmp_path / "sequential" / "report.txt").read_text().split())
    assert f"No {value}" not in (tmp_path / "joint" / "report.txt").read_text()


def test_several_methods_broken_off_while_the_first_was_drawn_go_on_with_all(calls, tmp_path, capsys):
    arguments = ["identify", "--out", str(tmp_path), "--method", "both", "--intervals", "bootstrap", "--resume"]
    assert cli.main(arguments) == 2
    assert "draws.jsonl: there is no such file" in capsys.readouterr().err
    DrawsFile(tmp_path / "joint", resume=False).begin({"seed": 0})
    assert cli.main(arguments) == 0
    assert calls.methods == ["joint", "sequential"]
    begun, anew = (drawing.store.begun() for drawing in calls.drawings)
    assert begun["seed"] == 0 and anew is None


def test_peaks_alone_are_a_method_of_their_own(calls, tmp_path, capsys):
    assert cli.main(["identify", "--out", str(tmp_path), "--method", "peaks"]) == 0
    assert calls.methods == ["peaks"]
    assert "peaks fit converged" in capsys.readouterr().out
    assert '"naive_standard_error": 0.4' in (tmp_path / "estimate.json").read_text()


def test_a_fit_that_did_not_converge_is_written_and_gives_status_3(calls, tmp_path, capsys):
    calls.converged = False
    assert cli.main(["identify", "--out", str(tmp_path)]) == 3
    assert '"converged": false' in (tmp_path / "estimate.json").read_text()
    assert "pdssjax: warning: the joint fit did not converge" in capsys.readouterr().err


def test_so_does_one_that_does_not_explain_its_records(calls, tmp_path, capsys):
    calls.explained = False
    assert cli.main(["identify", "--out", str(tmp_path / "joint")]) == 3
    shown = capsys.readouterr()
    assert "joint fit CONVERGED, BUT DOES NOT EXPLAIN ITS RECORDS: " in shown.out
    assert "pdssjax: warning: the joint fit converged, but does not explain its records" in shown.err
    document = json.loads((tmp_path / "joint" / "estimate.json").read_text())
    assert (document["converged"], document["explained"]) == (True, False)
    # Side by side only the joint fit has to: peaks are compared because they may not.
    assert cli.main(["identify", "--out", str(tmp_path / "both"), "--method", "both"]) == 3
    assert capsys.readouterr().err.count("does not explain its records") == 1


def test_results_are_not_overwritten_unasked(calls, tmp_path, capsys):
    arguments = ["identify", "--out", str(tmp_path)]
    assert cli.main(arguments) == 0
    assert cli.main(arguments) == 2
    assert len(calls.methods) == 1
    assert cli.main([*arguments, "--overwrite"]) == 0
    assert "found results already" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("raised", "status", "told"),
    [(InputError('key "tilt": unknown'), 2, 'error: key "tilt": unknown'), (KeyboardInterrupt(), 130, "interrupted")],
)
def test_input_at_fault_and_an_interrupt_give_a_status_one_line_and_no_file(
    monkeypatch, tmp_path, capsys, raised, status, told
):
    def fails(path):
        raise raised

    monkeypatch.setitem(vars(pdssjax), "load_study", fails)
    assert cli.main(["identify", "rig.toml", "--out", str(tmp_path / "out")]) == status
    assert capsys.readouterr().err == f"pdssjax: {told}\n"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("arguments", [["identify"], ["identify", "--method", "guess", "--out", "x"], ["frobnicate"]])
def test_a_wrong_command_line_gives_status_2_and_one_line(arguments, capsys):
    assert cli.main(arguments) == 2
    error = capsys.readouterr().err
    assert error.startswith("pdssjax: error: ")
    assert error.count("\n") == 1


def test_suspicious_input_warns_in_one_line_and_goes_on(calls, monkeypatch, tmp_path, capsys):
    load_study = pdssjax.load_study

    def warns(path):
        warnings.warn("5 Hz A: the record is shorter than a period", InputWarning, stacklevel=2)
        return load_study(path)

    monkeypatch.setitem(vars(pdssjax), "load_study", warns)
    assert cli.main(["identify", "--out", str(tmp_path)]) == 0
    assert "pdssjax: warning: 5 Hz A: the record is shorter than a period\n" in capsys.readouterr().err


def recorded(name: str, offset: float | None, noise: float | None) -> SimpleNamespace:
    """A measured record of a ramp, shifted by 3 um."""
    time = np.linspace(0.0, 1.0, 101)
    return SimpleNamespace(
        drive=None,
        file=Path("ramp.csv"),
        excitation="",
        name=name,
        role="fit",
        measures="effector",
        measurement=Effector(),
        time=time,
        measured=1e-5 * time + 3e-6,
        offset=offset,
        noise=noise,
        motion=None,
    )


def test_simulate_writes_each_record_with_its_own_zero(calls, tmp_path, capsys, monkeypatch):
    calls.study.records = (recorded("free", None, None), recorded("given", 1e-6, 1e-8), recorded("lost", None, 1e-8))
    ramp = 1e-5 * np.linspace(0.0, 1.0, 101)
    calls.study.values, calls.study.predictor, calls.study.accuracy = lambda but=(): {}, None, None
    calls.study.predict = lambda: [ramp, ramp, np.full(101, np.nan)]
    monkeypatch.setattr(pdssjax.study, "failure_cause", lambda *what: 'in "lost" the cause')
    assert cli.main(["simulate", "rig.toml", "--out", str(tmp_path)]) == 0
    free, given, failed = (
        np.genfromtxt(tmp_path / "predictions" / f"{name}.csv", delimiter=",", names=True)["residual_um"]
        for name in ("free", "given", "lost")
    )
    np.testing.assert_allclose(free, 0.0, atol=1e-9)
    np.testing.assert_allclose(given, 2.0, atol=1e-9)
    assert np.isnan(failed).all()
    printed = capsys.readouterr()
    assert "simulation failed" in printed.out and 'rig.toml: in "lost" the cause.' in printed.err
    assert cli.main(["simulate", "rig.toml", "--out", str(tmp_path)]) == 2


def test_the_example_is_copied_for_the_user_to_edit(tmp_path, capsys):
    folder = tmp_path / "mine"
    assert cli.main(["example", str(folder)]) == 0
    assert {path.name for path in folder.iterdir()} == {path.name for path in EXAMPLE.iterdir()}
    assert f"pdssjax identify {folder / 'study.toml'}" in capsys.readouterr().out
    assert cli.main(["example", str(folder)]) == 2
    assert "expected an empty folder" in capsys.readouterr().err


@pytest.mark.parametrize(
    "command", [["example"], ["new", "--files", str(EXAMPLE / "step_48p2V.csv")]], ids=["example", "new"]
)
def test_a_folder_without_permission_is_refused_before_anything_is_made(monkeypatch, tmp_path, capsys, command):
    monkeypatch.setattr(os, "access", lambda *given: False)
    assert cli.main([command[0], str(tmp_path / "mine"), *command[1:]]) == 2
    assert f"{tmp_path / 'mine'}: found no permission to write to {tmp_path}, expected" in capsys.readouterr().err
    assert not (tmp_path / "mine").exists()


def test_channels_lists_every_file_that_can_be_read(tmp_path, capsys):
    (tmp_path / "a.csv").write_text(
        "Zeit;Weg;Bemerkung\ns;µm;\n0,0;1,5;\n0,1;x;\n0,2;-2,5;\n0,3;1,5;\n0,4;1,5;\n", encoding="cp1252"
    )
    (tmp_path / "b.tdms").write_bytes(b"TDSm")
    files = [str(tmp_path / name) for name in ("b.tdms", "a.csv", "none.csv")]
    assert cli.main(["channels", *files]) == 2
    printed = capsys.readouterr()
    rows = [line.split() for line in printed.out.splitlines()]
    assert rows[0] == [f"[[{files[1]},", "delimited", "text]]"]
    assert rows[2] == ["1", "Zeit", "s", "5", "0", "0.4", "0.1", "s", "increases"]
    assert rows[3] == ["2", "Weg", "µm", "5", "-2.5", "1.5", "1", "without", "a", "number"]
    errors = printed.err.splitlines()
    assert [line.partition(".")[0] for line in errors] == [
        f"pdssjax: error: {tmp_path}/{name}" for name in ("b", "none")
    ]


def test_version_is_told(capsys):
    with pytest.raises(SystemExit) as ended:
        cli.main(["--version"])
    assert ended.value.code == 0
    assert capsys.readouterr().out.startswith("pdssjax 0.")


def test_a_file_at_fault_does_not_silence_characterise_for_the_others(tmp_path, capsys):
    (tmp_path / "bad.csv").write_text("time_s,displacement_um\n0,1\n0,2\n")
    files = [str(tmp_path / "bad.csv"), str(EXAMPLE / "sawtooth_5Hz_A.csv"), str(tmp_path / "none.csv")]
    assert cli.main(["characterise", *files, "--out", str(tmp_path / "out")]) == 2
    printed = capsys.readouterr()
    assert "average speed" in printed.out and f"Results are in {tmp_path / 'out'}" in printed.out
    assert [line.split(":")[2].strip() for line in printed.err.splitlines()] == [files[0], files[2]]
    assert (tmp_path / "out" / "characterise.json").exists()


def test_a_count_gives_a_sign_of_life_before_the_first_is_done(capsys, monkeypatch):
    """Not at once: what was asked for may be refused, in a line."""
    with counter("points") as tell:
        tell(5, 10)
    assert capsys.readouterr().err.startswith("5 of 10 points")
    monkeypatch.setattr(console, "QUIET_S", 0.0)
    said, begun = "", time.monotonic()
    with counter("points") as tell:
        while not said and time.monotonic() < begun + 10.0:
            time.sleep(0.01)
            said = capsys.readouterr().err
        tell(5, 10)
    assert said == "compiling what computes the points\n"
    assert capsys.readouterr().err.startswith("5 of 10 points")
