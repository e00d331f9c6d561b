"""A study by another integrator or another minimiser: by key, by option, by argument."""

import dataclasses

import diffrax
import numpy as np
import optimistix
import pytest
from platform_study import PLATFORM, write_platform

import pdssjax
from pdssjax import Accuracy, InputError, OneStep, Taylor
from pdssjax.integration import SOLVERS, accuracy_with, step_method

pytestmark = pytest.mark.usefixtures("undrawn")

TEXT = "\n".join(line for line in PLATFORM.splitlines() if '"friction.' not in line)


def differences(estimate, other):
    free = [path for path, p in estimate.parameters.items() if p.free]
    by = estimate.parameters
    return np.array([(other.parameters[path].value - by[path].value) / by[path].standard_error for path in free])


@pytest.mark.slow
def test_a_study_is_identified_by_another_integrator_and_minimiser(tmp_path):
    study = pdssjax.load_study(write_platform(tmp_path, TEXT))
    usual = pdssjax.identify(study)
    assert np.abs(differences(usual, pdssjax.identify(study, solver="tsit5"))).max() < 0.01
    dogleg = optimistix.Dogleg(rtol=1e-10, atol=1e-10)
    found = pdssjax.identify(study, minimiser=dogleg)
    assert found.converged, found.message
    assert np.abs(differences(usual, found)).max() < 0.01


def test_every_name_is_a_step_method():
    assert [type(step_method(name)) for name in SOLVERS] == [Taylor] + [OneStep] * (len(SOLVERS) - 1)
    assert type(accuracy_with("kvaerno5").method.solver) is diffrax.Kvaerno5
    assert step_method(diffrax.Dopri5()).solver == diffrax.Dopri5()
    assert accuracy_with("taylor") == Accuracy()


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ("tsit", 'found "tsit"; .*tsit5'),
        (diffrax.Euler(), "`solver` must estimate its error, but Euler does not"),
        (5, "found 5, expected one of taylor, "),
    ],
)
def test_what_is_no_solver_is_refused(given, says):
    with pytest.raises(InputError, match=says):
        accuracy_with(given)


def test_a_study_names_its_solver(tmp_path):
    path = write_platform(tmp_path, TEXT.replace("[actuator]", 'solver = "kvaerno5"\n\n[actuator]'))
    study = pdssjax.load_study(path)
    problem, _ = pdssjax.pose_problem(study)
    assert type(problem.residual.accuracy.method.solver) is diffrax.Kvaerno5
    assert dataclasses.replace(study, solver="taylor").accuracy == Accuracy()
    path.write_text(path.read_text().replace("kvaerno5", "rk4"))
    with pytest.raises(InputError, match='key "solver": found "rk4"'):
        pdssjax.load_study(path)


def test_a_solver_beside_an_accuracy_and_what_is_no_minimiser_are_refused(tmp_path):
    study = pdssjax.load_study(write_platform(tmp_path, TEXT))
    with pytest.raises(InputError, match="solver: found one beside an accuracy"):
        pdssjax.identify(study, accuracy=Accuracy(), solver="tsit5")
    with pytest.raises(InputError, match="minimiser: found 'dogleg', expected a least-squares solver of optimistix"):
        pdssjax.identify(study, minimiser="dogleg")
