"""One optimum, honest errors, a student's rig and the law of a record: experiments in small."""

import dataclasses
import json

import jax.numpy as jnp
import numpy as np
import pytest
from compared_laws import Here

import pdssjax
from experiments import student_rig, which_law
from pdssjax import Study
from pdssjax.files import EXAMPLE

pytestmark = pytest.mark.slow
TRUTH = {
    path: entry["value"]
    for path, entry in json.loads((EXAMPLE / "truth.json").read_text())["parameters"].items()
    if path not in ("piezo.mass", "effector.load")
}
"""Of what the study lists."""
SEEDS = range(20)
REALISATIONS = 100


@pytest.fixture(scope="module")
def example() -> Study:
    """The packaged example, the records that it fits alone."""
    study = pdssjax.load_study(EXAMPLE / "study.toml")
    return dataclasses.replace(study, records=tuple(r for r in study.records if r.role == "fit"))


def scattered(seed: int) -> dict[str, float]:
    """The truth times a factor of up to 2 either way, of up to 1.2 for the natural frequency."""
    random = np.random.default_rng(seed)
    widest = {path: 1.2 if path == "piezo.natural_frequency" else 2.0 for path in TRUTH}
    return {path: value * widest[path] ** random.uniform(-1.0, 1.0) for path, value in TRUTH.items()}


def test_starts_a_factor_of_two_off_lead_to_one_optimum_within_25_iterations(example):
    found = [pdssjax.identify(example.with_starts(scattered(seed))) for seed in SEEDS]
    chi2 = np.array([estimate.statistics.chi2 for estimate in found])
    assert np.sum(chi2 < chi2.min() + 0.5) >= 19
    assert np.median([estimate.statistics.iterations for estimate in found]) <= 25
    assert sum(estimate.converged for estimate in found) >= 19


def test_the_truth_lies_as_many_errors_away_as_it_should(example):
    random = np.random.default_rng(11)
    motions = [np.asarray(motion) for motion in example.predict({p: jnp.asarray(v) for p, v in TRUTH.items()})]
    scores, inside = [], []
    for _ in range(REALISATIONS):
        records = tuple(
            dataclasses.replace(
                record, measured=motion + random.uniform(0.0, 2e-6) + random.normal(0.0, record.noise, motion.size)
            )
            for record, motion in zip(example.records, motions, strict=True)
        )
        found = pdssjax.identify(dataclasses.replace(example, records=records).with_starts(TRUTH)).parameters
        free = [path for path in found if found[path].free]
        scores.append([(found[path].value - TRUTH[path]) / found[path].standard_error for path in free])
        inside.append([found[path].interval[0] < TRUTH[path] < found[path].interval[1] for path in free])
    scatter = np.std(scores, axis=0)
    np.testing.assert_allclose(scatter, 1.0, atol=0.25)
    assert np.sqrt(np.mean(scatter**2)) == pytest.approx(1.0, abs=0.12)
    assert abs(np.mean(scores, axis=0)).max() < 0.4
    assert 0.9 <= np.mean(inside) <= 0.99


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


def test_a_made_up_record_has_its_noise_and_its_contact_free():
    study = which_law.measured("lugre", 1, 2e-3)
    (record,) = study.records
    assert record.time.size == 100 and record.noise == which_law.NOISE
    free = {path for path, parameter in study.parameters.items() if parameter.free}
    assert free == {f"friction.{name}" for name in which_law.CONTACTS["lugre"]}


def test_dense_samples_tell_a_law_with_damping_from_coulombs():
    found = which_law.answered("lugre", 2, 5e-4, ["coulomb"], Here())
    assert found["coulomb"].is_worse and found.chosen == "lugre"
    assert which_law.row("lugre", 2, 5e-4, found).ours == "lugre"
