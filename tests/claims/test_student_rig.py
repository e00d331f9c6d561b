"""The experiment on a student project's rig, with a shorter walk to predict."""

import pytest

import pdssjax
from experiments import student_rig

pytestmark = pytest.mark.slow  # two minutes


def test_from_files_of_20_samples_a_cycle_to_parameters_and_a_walk_that_was_not_fitted(tmp_path):
    study = pdssjax.load_study(student_rig.write_study(tmp_path, student_rig.write_walks(tmp_path, predicted=2.0)))
    estimate = pdssjax.identify(study)
    *fitted, predicted = estimate.records
    assert estimate.converged and estimate.explained
    assert all(record.rmse < 1.1 * student_rig.NOISE for record in fitted)
    assert predicted.role == "validate" and predicted.rmse < 1.15 * student_rig.NOISE
    found = {path: p.value for path, p in estimate.parameters.items()}
    assert found["piezo.gain"] == pytest.approx(student_rig.STACK["gain"], rel=0.02)
    assert found["piezo.natural_frequency"] == pytest.approx(student_rig.STACK["natural_frequency"], rel=0.01)
    by_mass = student_rig.POSED_MASS / student_rig.MASS
    assert found["friction.sigma0"] == pytest.approx(by_mass * student_rig.CONTACT["sigma0"], rel=0.05)
    assert student_rig.draw(estimate).axes
