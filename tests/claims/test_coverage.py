"""Any sensible start leads to the same optimum, and errors cover the truth as often as they claim."""

import dataclasses
import json

import jax.numpy as jnp
import numpy as np
import pytest

import pdssjax
from pdssjax import Study
from pdssjax.files import EXAMPLE

pytestmark = pytest.mark.slow

TRUTH = {
    path: entry["value"]
    for path, entry in json.loads((EXAMPLE / "truth.json").read_text())["parameters"].items()
    if path != "piezo.mass"
}
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
                record,
                measured=motion + random.uniform(0.0, 2e-6) + random.normal(0.0, record.noise, motion.size),
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
