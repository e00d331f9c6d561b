"""A fit that is broken off, by Ctrl-C or by SIGTERM, leaves the best point it has come to."""

import dataclasses
import json
import re
import signal
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from platform_study import GAIN, write_platform

import pdssjax
from pdssjax.cli.main import Terminated, exit_status, main, requests_to_end
from pdssjax.files import EXAMPLE, estimate_text
from pdssjax.inference.least_squares import INTERRUPTED
from pdssjax.inference.search.multistart import BestPoint
from pdssjax.study.measurement.effector import Effector
from pdssjax.study.measurement.platform import Platform

PROGRAM = """
import contextlib, sys, time
from pdssjax.cli import main as cli; from pdssjax.cli import identify as commands

@contextlib.contextmanager
def progress():
    def tell(message):
        print(message, file=sys.stderr, flush=True)
        if "iteration 1" in message:
            time.sleep(60)  # until the signal comes
    yield tell

commands.progress = progress
sys.exit(cli.main(sys.argv[1:]))
"""
"""The command line, which waits within its fit."""


@pytest.mark.parametrize(
    ("signum", "status"), [pytest.param(signal.SIGINT, 130, marks=pytest.mark.slow), (signal.SIGTERM, 143)]
)
def test_a_signal_leaves_the_best_point_so_far_and_no_litter(tmp_path, signum, status):
    out = tmp_path / "out"
    command = [sys.executable, "-c", PROGRAM, "identify", str(write_platform(tmp_path)), "--out", str(out)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        for line in process.stderr:
            if "iteration 1" in line:
                process.send_signal(signum)
                break
        printed, told = process.communicate()
    assert process.returncode == status, told
    assert f"the best point so far is in {out / 'estimate.json'}\n" in told
    assert told.endswith("pdssjax: interrupted\n") and f" --estimate {out / 'estimate.json'} goes on" in told
    assert f"joint fit DID NOT CONVERGE: {INTERRUPTED}" in printed
    document = json.loads((out / "estimate.json").read_text())
    assert document["converged"] is False and document["message"] == INTERRUPTED
    assert document["parameters"]["piezo.gain"]["value"] == pytest.approx(GAIN, rel=0.1)
    assert {path.name for path in out.iterdir()} == {"estimate.json", "report.txt"}


def interrupting(*when: str, told=None):
    """A progress that breaks the fit off, once, where messages with each of `when` in them have come, in order.

    What comes is `told`.
    """
    left = list(when)

    def tell(message):
        if told is not None:
            told.append(message)
        if left and left[0] in message:
            left.pop(0)
            if not left:
                raise KeyboardInterrupt

    return tell


def test_python_gets_the_best_point_with_the_interrupt(tmp_path):
    study, told = pdssjax.load_study(write_platform(tmp_path)), []
    with pytest.raises(KeyboardInterrupt) as broken:
        pdssjax.identify(study, progress=interrupting("iteration 1", told=told))
    # Nothing more than is needed: a process that is ended is killed soon after.
    assert told[-1] == "predicting every record"
    assert isinstance(broken.value, pdssjax.FitInterrupted)
    found = broken.value.estimate
    assert found is not None and not found.converged
    assert np.isfinite(found.statistics.chi2) and found.statistics.iterations > 0
    assert found.records[0].simulated and found.parameters["piezo.gain"].standard_error > 0


def test_a_fit_goes_on_from_where_another_was_broken_off(tmp_path, capsys):
    study, file = write_platform(tmp_path), tmp_path / "estimate.json"
    with pytest.raises(pdssjax.FitInterrupted) as broken:
        pdssjax.identify(pdssjax.load_study(study), progress=interrupting("iteration 1"))
    assert broken.value.estimate is not None
    file.write_text(estimate_text(broken.value.estimate))
    assert main(["identify", str(study), "--estimate", str(file), "--out", str(tmp_path / "out")]) == 0
    begun = float(re.search(r"iteration 0, chi-square (\S+)", capsys.readouterr().err)[1])
    assert begun == pytest.approx(broken.value.estimate.statistics.chi2, rel=1e-4)
    found, kept = (json.loads(f.read_text()) for f in (tmp_path / "out" / "estimate.json", file))
    starts = {path: p["start"] for path, p in found["parameters"].items() if p["free"]}
    assert found["converged"] and starts == {path: kept["parameters"][path]["value"] for path in starts}
    assert found["notes"][0] == (
        f"Of the 4 free parameters 4 started at the numbers of: estimate {file} (not converged)."
    )


def test_a_fit_that_was_done_stays_done(tmp_path):
    study = pdssjax.load_study(write_platform(tmp_path))
    with pytest.raises(pdssjax.FitInterrupted) as broken:
        pdssjax.identify(study, progress=interrupting("predicting every record"))
    assert broken.value.estimate is not None and broken.value.estimate.converged


def test_before_the_first_iteration_there_is_nothing_to_keep(tmp_path, capsys, monkeypatch):
    study = write_platform(tmp_path)
    with pytest.raises(pdssjax.FitInterrupted) as broken:
        pdssjax.identify(pdssjax.load_study(study), progress=interrupting("finding starts"))
    assert broken.value.estimate is None
    monkeypatch.setattr("pdssjax.inference.identification.best_fit", lambda *given: interrupting("")("now"))
    assert main(["identify", str(study), "--out", str(tmp_path / "out")]) == 130
    told = "pdssjax: interrupted while searching for starts; nothing is written\npdssjax: interrupted\n"
    assert capsys.readouterr().err.endswith(told)
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
@pytest.mark.parametrize("method", ["joint", "sequential"])
def test_a_fit_broken_off_in_its_first_stage_is_told_of_all_records(method):
    study = pdssjax.load_study(EXAMPLE / "study.toml")
    with pytest.raises(pdssjax.FitInterrupted) as broken:
        pdssjax.identify(study, method, progress=interrupting("searching", "piezo: iteration 0"))
    found = broken.value.estimate
    assert found is not None and not found.converged
    assert found.statistics.samples == 5605
    # Chi-square is that of all fitted records at this point.
    squares = [np.sum((r.measured - r.predicted) ** 2) / r.noise**2 for r in found.records if r.role == "fit"]
    assert found.statistics.chi2 == pytest.approx(np.sum(squares), rel=1e-6)
    assert not any("say nothing" in note for note in found.notes)


def point(chi2: float):
    """What a run tells of a point with this sum of squares."""
    return SimpleNamespace(chi2=chi2)


@dataclasses.dataclass(frozen=True)
class Posed:
    """As much of a problem as is looked at."""

    noise: np.ndarray
    records: tuple = (SimpleNamespace(measurement=Platform()), SimpleNamespace(measurement=Effector()))

    def _replace(self, watch):
        return self


BOTH, PLATFORM_ONLY, EFFECTOR_ONLY = np.array([True, True]), np.array([True, False]), np.array([False, True])


@pytest.mark.parametrize(
    ("told", "kept"),
    [
        ([(BOTH, 9.0, 1.0), (BOTH, 4.0, 1.0), (BOTH, 7.0, 1.0)], 4.0),
        ([(PLATFORM_ONLY, 1.0, 1.0), (BOTH, 9.0, 1.0), (PLATFORM_ONLY, 0.5, 1.0)], 9.0),
        ([(PLATFORM_ONLY, 1.0, 1.0), (EFFECTOR_ONLY, 5.0, 1.0)], 5.0),
        ([(BOTH, 4.0, 1.0), (BOTH, np.inf, 1.0), (BOTH, np.nan, 1.0)], 4.0),
        # The noise was estimated anew: chi-square before and after cannot be compared.
        ([(BOTH, 4.0, 1.0), (PLATFORM_ONLY, 1.0, 0.1), (BOTH, 50.0, 0.1), (BOTH, 60.0, 0.1)], 50.0),
    ],
)
def test_the_best_point_is_that_of_most_records_then_of_least_chi_square(told, kept):
    best = BestPoint()
    for used, chi2, noise in told:
        best.note(Posed(np.full(2, noise)), used, point(chi2))
    assert best.point is not None and best.point.fit.chi2 == kept


def test_requests_to_end_interrupt_and_give_the_status_of_their_signal():
    with requests_to_end() as received:
        with pytest.raises(Terminated):
            signal.raise_signal(signal.SIGTERM)
        assert exit_status(received) == 143 and exit_status([]) == 130
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


def test_a_signal_that_is_ignored_stays_ignored(monkeypatch):
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with requests_to_end():
            signal.raise_signal(signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)
