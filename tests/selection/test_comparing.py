"""Comparisons as a whole: failures stop nothing, what is done is kept and taken again, and what the answer says."""

import dataclasses
import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest
from compared_laws import Here, contact_study, made_up, write_contact
from matplotlib.figure import Figure

import pdssjax
from pdssjax import InputError
from pdssjax.cli.main import main
from pdssjax.report import figures
from pdssjax.report.text import format_selection
from pdssjax.selection import DiscriminatingRecord, candidate_fits, candidates_of, comparing, held_out
from pdssjax.selection.scores import common_noise

LEFT = {"coulomb": 0.03, "dahl": 0.0, "lugre": 0.0002}
"""By law, the misfit [N] that it leaves beside the noise."""


@pytest.fixture
def fits(monkeypatch):
    """Made-up fits, run in this thread; the names of those that were asked for, and what neighbours gave them."""
    asked: dict[str, dict] = {}

    def fit(task):
        asked[task.candidate.name] = {path: task.near.values[path] for path in task.near.free} if task.near else {}
        if task.candidate.name == "stribeck":
            raise RuntimeError("the processor is on fire")
        return made_up(task.candidate, LEFT.get(task.candidate.name, 0.05)), object()

    def finish(task):
        return dataclasses.replace(task.earlier, finished=True), None

    told = DiscriminatingRecord(("dahl", "lugre"), "slow", "friction", np.nan, np.nan, 1.0, 10.0, 250, 9.0, 3)
    monkeypatch.setattr(candidate_fits, "fit_candidate", fit)
    monkeypatch.setattr(candidate_fits, "finish", finish)
    monkeypatch.setattr(comparing, "most_discriminating_record", lambda *models: told)
    return asked


@pytest.fixture
def kept_estimates(monkeypatch):
    """In place of an identification's files one file with a word in it; figures are empty, which is quicker."""
    from pdssjax.files import comparison_folder

    for name in ("selection_figure", "residual_strips_figure"):
        monkeypatch.setitem(vars(figures), name, lambda found: Figure(figsize=(1.0, 1.0)))

    def write(estimate, folder):
        (folder / "estimate.json").write_text("{}")

    monkeypatch.setattr(comparison_folder, "write_essentials", write)


def compared(study, laws="coulomb,lugre", **more):
    return pdssjax.compare(study, friction=laws.split(","), executor=Here(), **more)


def test_the_simplest_law_that_predicts_as_well_is_chosen_and_each_begins_near_another(tmp_path, fits):
    found = compared(contact_study(tmp_path))
    assert [result.name for result in found.results] == ["coulomb", "dahl", "lugre"]
    assert found.chosen == "dahl" and found.groups[0] == ("dahl", "lugre") and found.ambiguous == ("lugre",)
    assert found["coulomb"].is_worse and not found["lugre"].is_worse
    assert fits == {
        "coulomb": {"friction.sigma0": 1.0, "friction.f_c": 1.0},
        "dahl": {},
        "lugre": {"friction.sigma0": 1.0, "friction.f_c": 1.0},
    }
    assert found.noise["slow"].told and found.noise["slow"].independent > 200
    assert found.to_dataframe().loc["coulomb", "worse"]


def test_a_model_that_fails_is_a_row_that_says_why_and_stops_no_other(tmp_path, fits):
    found = compared(contact_study(tmp_path), "coulomb,stribeck,lugre")
    assert found["stribeck"].fitted.failure == "RuntimeError: the processor is on fire"
    assert found.chosen == "dahl" and found["stribeck"].group == -1
    assert "stribeck: RuntimeError: the processor is on fire" in format_selection(found)


def test_where_all_fail_nothing_is_chosen(tmp_path, monkeypatch):
    def fit(task):
        raise RuntimeError("no")

    monkeypatch.setattr(candidate_fits, "fit_candidate", fit)
    found = compared(contact_study(tmp_path))
    assert found.chosen == "" and found.groups == ()
    assert "No model gave a fit" in format_selection(found)
    found.report(tmp_path / "page.html")
    with pytest.raises(InputError, match="found no model with a fit"):
        found.plot()


def test_the_answer_says_what_is_enough_what_is_worse_and_where(tmp_path, fits):
    text = format_selection(compared(contact_study(tmp_path)))
    assert "dahl is the simplest model that predicts held-out samples" in text
    assert "These records do not tell it from lugre." in text and "Significantly worse: coulomb." in text
    assert "coulomb: " in text.partition("What each other model leaves")[2]
    assert "measure the friction as in slow with the motion 10 times as fast" in " ".join(text.split())


def test_the_folder_has_text_figures_page_and_numbers(tmp_path, fits, kept_estimates):
    found = compared(contact_study(tmp_path), out=tmp_path / "out")
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {
        "comparison.txt",
        "comparison.png",
        "residuals.png",
        "comparison.html",
        "comparison.json",
        "candidates",
    }
    document = json.loads((tmp_path / "out/comparison.json").read_text())
    assert document["chosen"] == "dahl" and [m["name"] for m in document["models"]] == ["coulomb", "dahl", "lugre"]
    assert document["models"][0]["held_out_time"]["worse_by"] == pytest.approx(found["coulomb"].time.total)
    page = (tmp_path / "out/comparison.html").read_text()
    assert "dahl is the simplest model" in page and "friction.sigma0" in page and "numpy" in page
    with pytest.raises(InputError, match="found results already"):
        compared(contact_study(tmp_path), out=tmp_path / "out")


def test_what_is_done_is_taken_again_and_what_changed_is_fitted_anew(tmp_path, fits, kept_estimates):
    study, out = contact_study(tmp_path), tmp_path / "out"
    whole = compared(study, out=out)
    fits.clear()
    again = compared(study, out=out, resume=True)
    assert not fits and dataclasses.replace(again, seconds=0.0) == dataclasses.replace(whole, seconds=0.0)
    compared(study, "coulomb,lugre,bliman-sorine", out=out, resume=True)
    assert list(fits) == ["bliman-sorine"]
    fits.clear()
    bounded = dataclasses.replace(study.parameters["friction.f_c"], high=0.9)
    other = dataclasses.replace(study, parameters=study.parameters | {"friction.f_c": bounded})
    compared(other, out=out, resume=True)
    assert set(fits) == {"coulomb", "dahl", "lugre"}
    fits.clear()
    (out / "candidates/dahl/candidate.npz").write_bytes(b"PK cut")
    with pytest.warns(pdssjax.InputWarning, match="found no candidate that can be read"):
        compared(other, out=out, resume=True)
    assert set(fits) == {"dahl"}


def test_what_is_broken_off_keeps_what_is_done(tmp_path, fits, kept_estimates, monkeypatch):
    study, out = contact_study(tmp_path), tmp_path / "out"
    usual = candidate_fits.fit_candidate

    def interrupted(task):
        if task.candidate.name == "lugre":
            raise KeyboardInterrupt
        return usual(task)

    monkeypatch.setattr(candidate_fits, "fit_candidate", interrupted)
    with pytest.raises(KeyboardInterrupt):
        compared(study, out=out)
    assert {path.name for path in (out / "candidates").iterdir()} == {"dahl"}
    monkeypatch.setattr(candidate_fits, "fit_candidate", usual)
    fits.clear()
    assert compared(study, out=out, resume=True).chosen == "dahl"
    assert set(fits) == {"coulomb", "lugre"}


def test_a_disk_that_takes_nothing_stops_nothing(tmp_path, fits, monkeypatch):
    from pdssjax.files import comparison_folder

    def full(estimate, folder):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(comparison_folder, "write_essentials", full)
    with pytest.warns(pdssjax.InputWarning, match="No space left on device.*goes on in memory") as told:
        assert compared(contact_study(tmp_path), out=tmp_path / "out").chosen == "dahl"
    assert len(told) == 1


def test_figures_are_drawn_and_shown(tmp_path, fits):
    found = compared(contact_study(tmp_path))
    assert len(found.plot().axes) == 2 and len(found.plot("residuals").axes) == 3
    assert "dahl is the simplest" in found._repr_html_() and "dahl" in repr(found)
    with pytest.raises(InputError, match='plot: found "scores", expected "residuals"'):
        found.plot("scores")


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        ({"effort": "lazy"}, 'effort: found "lazy"'),
        ({"executor": 3}, "executor: found 3, expected an Executor"),
        ({"resume": True}, "out: found none, expected a folder"),
        ({"out": "nowhere", "resume": True}, "found nothing to resume"),
    ],
)
def test_what_is_asked_wrongly_is_refused(tmp_path, monkeypatch, asked, told):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=told):
        pdssjax.compare(contact_study(tmp_path), **asked)
    assert not (tmp_path / "nowhere").exists()


def test_a_pool_that_forks_and_a_study_of_nothing_fitted_are_refused(tmp_path):
    study = contact_study(tmp_path)
    with ProcessPoolExecutor(1, mp_context=get_context("fork")) as pool, pytest.raises(InputError, match="are forked"):
        pdssjax.compare(study, executor=pool)
    records = tuple(dataclasses.replace(record, role="validate") for record in study.records)
    with pytest.raises(InputError, match='found no record with role "fit"'):
        pdssjax.compare(dataclasses.replace(study, records=records))
    with pytest.raises(InputError, match=r"study: found 'study\.toml', expected a Study"):
        pdssjax.compare("study.toml")


def test_the_command_answers_on_the_console_and_ends_with_0(tmp_path, fits, kept_estimates, monkeypatch, capsys):
    workers = candidate_fits.workers
    monkeypatch.setattr(candidate_fits, "workers", lambda executor, most: workers(Here(), most))
    file, out = write_contact(tmp_path), tmp_path / "out"
    assert main(["compare", str(file), "--friction", "coulomb,lugre", "--out", str(out)]) == 0
    shown = capsys.readouterr()
    assert "dahl is the simplest model" in shown.out and f"Results are in {out}" in shown.out
    assert "3 of 3 models done; lugre: done" in shown.err
    assert "pdssjax " in (out / "comparison.html").read_text()
    assert main(["compare", str(file), "--friction", "coulomb,lugre", "--out", str(out)]) == 2
    assert "found results already" in capsys.readouterr().err
    fits.clear()
    assert main(["compare", str(file), "--friction", "coulomb,lugre", "--out", str(out), "--resume"]) == 0
    assert not fits


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--friction", "coulomb,"], 'found "coulomb,", expected names with commas'),
        (["--piezo", "second-order"], "found one model to compare"),
        (["--feedback", "maybe"], "option --feedback: invalid choice"),
    ],
)
def test_wrong_options_are_one_line_and_lose_nothing(tmp_path, capsys, options, told):
    out = tmp_path / "out"
    assert main(["compare", str(write_contact(tmp_path)), *options, "--out", str(out)]) == 2
    (line,) = [text for text in capsys.readouterr().err.splitlines() if "error" in text]
    assert told in line
    assert not out.exists()


PARENT = """
import multiprocessing, time
from pdssjax.selection import candidate_fits
if __name__ == "__main__":
    with candidate_fits.workers(None, 1) as submit:
        submit(time.sleep, 0).result()
        print(multiprocessing.active_children()[0].pid, flush=True)
        submit(time.sleep, 600)
        time.sleep(600)
"""


@pytest.mark.skipif(os.name != "posix", reason="no SIGKILL")
def test_processes_end_with_a_parent_that_was_killed(tmp_path):
    file = tmp_path / "parent.py"
    file.write_text(PARENT, encoding="utf-8")
    with subprocess.Popen([sys.executable, str(file)], stdout=subprocess.PIPE, text=True) as parent:
        worker = int(parent.stdout.readline())
        parent.kill()
    state = lambda: subprocess.run(["ps", "-o", "stat=", "-p", str(worker)], capture_output=True, text=True).stdout
    for _ in range(300):
        if not state().strip() or state().startswith("Z"):  # gone, or ended and seen by nobody
            return
        time.sleep(0.1)
    os.kill(worker, signal.SIGKILL)
    raise AssertionError(f"{worker} is still there")


def rounds(study, monkeypatch, ends, laws=("coulomb", "lugre")):
    """What is fitted where, as (round, law, start), where the fits end `ends[law, round or start]`, and the results.

    An end is (deviance, whether it explains the records); laws differ in the number of their parameters.
    """
    asked = []

    def once(task, posed, start, most=None):
        name = task.candidate.name
        asked.append(("once", name, start))
        deviance, explained = ends.get((name, start), ends[name])
        return dataclasses.replace(
            made_up(task.candidate, 0.0), deviance=deviance, explained=explained, start=start
        ), None

    def compared(task):
        name = task.candidate.name
        asked.append(("compared", name, ""))
        deviance, explained = ends.get((name, "compared"), ends[name])
        found = dataclasses.replace(task.earlier, deviance=deviance, explained=explained, compared=True)
        return found, None

    monkeypatch.setattr(candidate_fits, "_fit_once", once)
    monkeypatch.setattr(candidate_fits, "compare_starts", compared)
    monkeypatch.setattr(candidate_fits, "held_out", lambda study, fitted, parts: ((), 0))
    candidates = candidates_of(study, friction=laws)
    return asked, candidate_fits.fit_all(candidates, (), "quick", Here(), None, lambda told: None)


def test_where_the_own_model_is_right_the_others_begin_at_its_optimum_and_nothing_is_searched(tmp_path, monkeypatch):
    ends = {"coulomb": (900.0, False), "dahl": (100.0, True), "lugre": (100.0, True)}
    asked, done = rounds(contact_study(tmp_path), monkeypatch, ends)
    assert asked == [("once", "dahl", "study"), ("once", "lugre", "dahl"), ("once", "coulomb", "dahl")]
    assert all(found.finished for found in done.values()) and done["coulomb"].start == "dahl"


def test_where_another_model_is_right_those_with_more_parameters_begin_at_its_optimum(tmp_path, monkeypatch):
    laws = ("coulomb", "lugre", "elastoplastic")
    ends = {"coulomb": (900.0, False), "dahl": (800.0, False), "lugre": (100.0, True), "elastoplastic": (99.0, True)}
    asked, done = rounds(contact_study(tmp_path), monkeypatch, ends, laws)
    assert [start for _, name, start in asked if name == "elastoplastic"] == ["lugre"]
    assert done["elastoplastic"].finished


def test_a_fit_that_was_cut_short_is_brought_to_its_end(tmp_path, monkeypatch):
    usual = candidate_fits.fit_candidate

    def cut(task):
        fitted, estimate = usual(task)
        return dataclasses.replace(fitted, converged=task.candidate.name != "lugre"), estimate

    monkeypatch.setattr(candidate_fits, "fit_candidate", cut)
    ends = {"coulomb": (900.0, False), "dahl": (150.0, True), "lugre": (150.0, True)}
    asked, _ = rounds(contact_study(tmp_path), monkeypatch, ends)
    assert asked.count(("once", "lugre", "dahl")) == 2 and len(asked) == 4


def test_a_fit_that_leaves_much_more_than_the_best_is_soon_broken_off(tmp_path, monkeypatch):
    study, asked = contact_study(tmp_path), []

    def once(task, posed, start, most=None):
        asked.append(most)
        return dataclasses.replace(made_up(task.candidate, 0.0), deviance=1e4 - most, converged=False), None

    monkeypatch.setattr(candidate_fits, "_fit_once", once)
    (lugre,) = [c for c in candidates_of(study, friction=["lugre"]) if c.name == "lugre"]
    for best, fits in (
        (100.0, [candidate_fits.EARLY]),
        (9990.0, [candidate_fits.EARLY, candidate_fits.FIRST - candidate_fits.EARLY]),
        (np.inf, [candidate_fits.FIRST]),
    ):
        asked.clear()
        candidate_fits.fit_candidate(candidate_fits.Task(lugre, "quick", best=best))
        assert asked == fits


def test_a_model_that_leaves_much_more_is_judged_by_what_it_leaves_in_its_fit(tmp_path, monkeypatch):
    study = contact_study(tmp_path)
    coulomb, parts = candidates_of(study, friction=["coulomb"])[0], held_out.parts_of(study)
    fitted = dataclasses.replace(made_up(coulomb, 0.05), deviance=1e4, converged=False)
    monkeypatch.setattr(candidate_fits, "held_out", None)
    monkeypatch.setattr(candidate_fits, "_fit_once", None)
    found, estimate = candidate_fits.finish(candidate_fits.Task(coulomb, "quick", None, fitted, parts, 100.0))
    assert found.finished and not found.failure and estimate is None
    for part, left in zip(parts, found.held_out, strict=True):
        np.testing.assert_array_equal(left, fitted.residuals[part.record][part.rows])


def test_a_right_law_in_a_wrong_optimum_is_found_from_a_richer_ones(tmp_path, monkeypatch):
    ends = {"coulomb": (900.0, False), "dahl": (800.0, False), "lugre": (100.0, True), ("dahl", "lugre"): (101.0, True)}
    asked, done = rounds(contact_study(tmp_path), monkeypatch, ends)
    assert ("once", "dahl", "lugre") in asked and done["dahl"].explained and done["dahl"].start == "lugre"


def test_one_that_explains_less_than_its_neighbour_is_tried_from_the_studys_starts(tmp_path, monkeypatch):
    ends = {
        "coulomb": (500.0, False),
        "dahl": (100.0, True),
        ("dahl", "coulomb"): (700.0, False),
        "lugre": (99.0, True),
    }
    asked, done = rounds(contact_study(tmp_path), monkeypatch, ends)
    assert ("once", "dahl", "study") in asked and done["dahl"].start == "study"


def test_where_none_explains_the_records_the_best_are_searched_until_that_helps_no_more(tmp_path, monkeypatch):
    poor = {"coulomb": (900.0, False), "dahl": (800.0, False), "lugre": (700.0, False)}
    asked, done = rounds(contact_study(tmp_path), monkeypatch, poor)
    assert [law for kind, law, _ in asked if kind == "compared"] == ["lugre", "dahl", "coulomb"]
    asked, done = rounds(contact_study(tmp_path), monkeypatch, poor | {("lugre", "compared"): (100.0, True)})
    assert [law for kind, law, _ in asked if kind == "compared"] == ["lugre", "dahl"]
    assert ("once", "dahl", "lugre") in asked and done["lugre"].explained


def test_a_misfit_is_found_where_it_is(tmp_path):
    study = contact_study(tmp_path)
    dahl = candidates_of(study, friction=["coulomb"])[1]
    best = made_up(dahl, 0.0)
    there = (study.records[1].time > 0.5) & (study.records[1].time < 0.6)
    bent = best.residuals[1] + 0.1 * there
    model = dataclasses.replace(best, residuals=(best.residuals[0], bent))
    noises = [common_noise(r, r.measured - e, 200.0) for r, e in zip(study.records, best.residuals, strict=True)]
    found = comparing.misfit_beside(study, model, best, noises)
    assert found.record == "wide" and 0.5 <= found.begin < found.end <= 0.61 and not found.by_phase
    assert found.rms > found.best_rms and found.share > 0.5
    assert comparing.misfit_beside(study, best, best, noises) is None
