"""A fit is checked by another integrator: what it differs by, what is refused, what an interrupt leaves."""

import dataclasses
import json
import math

import equinox as eqx
import fabricated
import numpy as np
import pytest
from platform_study import PLATFORM, write_platform

import pdssjax
from pdssjax import Accuracy, FitInterrupted, InputError, OneStep
from pdssjax.cli.main import main
from pdssjax.files import estimate_text
from pdssjax.inference import quiet
from pdssjax.inference.integrator_check import check_accuracy, with_check
from pdssjax.integration import SOLVERS, Picard, accuracy_with, solver_name, step_method
from pdssjax.report.text import format_report
from pdssjax.study import IntegratorCheck

pytestmark = pytest.mark.usefixtures("undrawn")

TEXT = "\n".join(line for line in PLATFORM.splitlines() if '"friction.' not in line)


def test_a_study_is_checked_by_option_and_its_files_say_so(tmp_path, capsys):
    study, out = write_platform(tmp_path, TEXT), tmp_path / "out"
    assert main(["identify", str(study), "--check-with", "tsit5", "--out", str(out)]) == 0
    document = json.loads((out / "estimate.json").read_text())
    assert (document["solver"], document["minimiser"]) == ("taylor", "BoundedLevenbergMarquardt")
    check = document["check"]
    assert check["solver"] == "tsit5" and check["converged"]
    free = [path for path, parameter in document["parameters"].items() if parameter["free"]]
    assert list(check["differences"]) == free
    # A platform that is known in closed form is integrated by nobody.
    assert max(map(abs, check["differences"].values())) < 1e-6
    assert "check              = by tsit5: no parameter differs by more than" in (out / "report.txt").read_text()
    assert "fitting again by tsit5" in capsys.readouterr().err


def fitted(study):
    """The problem of a study, and the fit that it ends in."""
    problem, start = pdssjax.pose_problem(study)
    return problem, pdssjax.inference.joint(problem, problem.decode(start), quiet)


def test_differences_are_those_of_where_both_fits_lead(tmp_path):
    study = pdssjax.load_study(write_platform(tmp_path, TEXT))
    estimate = pdssjax.identify(study)
    problem, fit = fitted(study)
    gain = estimate.parameters["piezo.gain"]
    for shift in (0.004, 0.5):
        # A motion larger by a factor has a gain larger by it; so little that no step of a fit would be taken, or more.
        factor = 1.0 + shift * gain.standard_error / gain.value
        moved = eqx.tree_at(
            lambda p: p.residual.comparison.measured[0], problem, factor * problem.residual.comparison.measured[0]
        )
        checked = with_check(estimate, fit, moved, "joint", quiet)
        assert checked.check.converged
        assert checked.check.differences["piezo.gain"] == pytest.approx(shift, rel=2e-3)
        others = [number for path, number in checked.check.differences.items() if path != "piezo.gain"]
        assert np.abs(others).max() < 1e-3 * shift
        assert checked.check.largest == ("piezo.gain", checked.check.differences["piezo.gain"])
        notes = [note for note in checked.notes if "Another integrator finds other numbers" in note]
        assert len(notes) == (shift > 0.1)


def test_a_second_fit_that_cannot_start_and_a_first_one_that_failed_are_said(tmp_path):
    study = pdssjax.load_study(write_platform(tmp_path, TEXT))
    problem, fit = fitted(study)
    estimate = fabricated.estimate()
    unusable = eqx.tree_at(
        lambda p: p.residual.comparison.measured[0], problem, np.nan * problem.residual.comparison.measured[0]
    )
    parameters = dict.fromkeys(problem.residual.transform.paths, estimate.parameters["piezo.gain"])
    checked = with_check(dataclasses.replace(estimate, parameters=parameters), fit, unusable, "joint", quiet)
    assert checked.check.largest is None and not checked.check.converged
    assert "no difference is known: the actuator cannot be simulated at the start" in checked.notes[-1]
    failed = with_check(estimate, fit._replace(success=False), problem, "joint", quiet)
    assert failed.check is None and failed.notes[-1] == "No check by taylor: the fit did not converge."


def test_a_check_that_is_broken_off_leaves_the_fit(tmp_path):
    study = pdssjax.load_study(write_platform(tmp_path, TEXT))

    def tell(message):
        if message.startswith("check: all: iteration 0"):
            raise KeyboardInterrupt

    with pytest.raises(FitInterrupted) as broken:
        pdssjax.identify(study, check_with="kvaerno5", progress=tell)
    assert broken.value.estimate.converged and broken.value.estimate.check is None


@pytest.mark.parametrize(
    ("check_with", "solver", "says"),
    [
        ("taylor", "taylor", 'found "taylor", by which the fit itself integrates; expected one of bosh3'),
        ("dopri8", "dopri8", 'found "dopri8", by which the fit itself'),
        ("rk4", "taylor", 'solver: found "rk4"'),
    ],
)
def test_the_integrator_of_the_fit_and_what_is_none_are_refused_at_once(tmp_path, check_with, solver, says):
    study = pdssjax.load_study(write_platform(tmp_path, TEXT))
    with pytest.raises(InputError, match=f"check_with: .*{says}"):
        pdssjax.identify(study, solver=solver, check_with=check_with)


def test_every_solver_has_its_name():
    assert [solver_name(step_method(name)) for name in SOLVERS] == list(SOLVERS)
    assert solver_name(Picard()) == "picard"
    assert check_accuracy(None, Accuracy()) is None
    assert check_accuracy("tsit5", accuracy_with("dopri8")) == Accuracy(method=OneStep(), max_steps=16384)


def test_the_report_names_what_is_not_usual():
    usual = fabricated.estimate()
    assert "solver  " not in format_report(usual) and "check" not in json.loads(estimate_text(usual))
    check = IntegratorCheck("tsit5", {"piezo.gain": -0.25, "effector.load": math.nan}, False, "stalled")
    other = dataclasses.replace(usual, solver="kvaerno5", minimiser="Dogleg", check=check)
    text = format_report(other)
    assert "    solver             = kvaerno5\n    minimiser          = Dogleg\n" in text
    said = "by tsit5: no parameter differs by more than 0.25 standard errors (piezo.gain); that fit did not converge"
    assert f"    check              = {said}: stalled\n" in text
    written = json.loads(estimate_text(other))["check"]
    assert written == vars(check) | {"differences": {"piezo.gain": -0.25, "effector.load": None}}
