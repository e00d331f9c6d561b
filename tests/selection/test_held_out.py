"""Parts that are held out are predicted as by real fits without them; two laws are told apart by real fits."""

import numpy as np
import pytest
from compared_laws import NOISE, Here, contact_study, contact_text, write_contact
from scipy.optimize import least_squares

import pdssjax
from pdssjax.selection import candidates_of, held_out
from pdssjax.selection.candidate_fits import fitted_candidate
from pdssjax.selection.comparing import most_discriminating_record
from pdssjax.selection.scores import common_noise

TRUTH = {"friction.sigma0": 8e5, "friction.f_c": 0.6}


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Two records of a Dahl contact, with noise."""
    folder, random = tmp_path_factory.mktemp("contact"), np.random.default_rng(5)
    empty = contact_study(folder)
    forces = [np.asarray(force) for force in empty.predict(TRUTH)]
    noisy = {r.name: f + NOISE * random.standard_normal(f.size) for r, f in zip(empty.records, forces, strict=True)}
    return pdssjax.load_study(write_contact(folder, contact_text(), noisy))


@pytest.fixture(scope="module")
def estimate(study):
    return pdssjax.identify(study)


@pytest.fixture(scope="module")
def fitted(study, estimate):
    dahl = next(c for c in candidates_of(study, friction=["coulomb"]) if c.name == "dahl")
    return fitted_candidate(dahl, estimate, "study")


def test_what_is_held_out_is_predicted_as_by_a_fit_without_it(study, estimate, fitted):
    """A block, and a whole record, against fits to what is left of the records."""
    parts = held_out.parts_of(study)
    found, refitted = held_out.held_out(study, fitted, parts)
    assert refitted == 0
    for number in (0, next(k for k, part in enumerate(parts) if part.kind == "record")):
        part = parts[number]
        problem, start = pdssjax.pose_problem(study.with_starts(estimate))
        used = [np.ones(record.time.size, bool) for record in study.records]
        used[part.record] = ~part.rows
        left = problem.fitted_to(used)
        refitted = least_squares(left.whitened, start, left.jacobian, left.bounds, x_scale="jac", xtol=1e-12).x
        motion = study.predict({path: float(x) for path, x in left.decode(refitted).items()})[part.record]
        expected = (study.records[part.record].measured - np.asarray(motion))[part.rows]
        seen = (estimate.records[part.record].residual)[part.rows]
        assert np.max(np.abs(found[number] - expected)) < 0.05 * np.max(np.abs(seen - expected)) + 1e-6


def test_a_step_that_is_not_believed_is_fitted_again(study, fitted, monkeypatch):
    monkeypatch.setattr(held_out, "MAX_CHI2_RISE", -np.inf)
    parts = held_out.parts_of(study)[:1]
    (again,), refitted = held_out.held_out(study, fitted, parts)
    assert refitted == 1
    monkeypatch.undo()
    (first,), _ = held_out.held_out(study, fitted, parts)
    np.testing.assert_allclose(again, first, atol=1e-4)


@pytest.mark.slow
def test_coulombs_law_is_worse_on_records_of_dahls(study):
    found = pdssjax.compare(study, friction=["coulomb", "simplified-lugre"], executor=Here())
    assert found.chosen == "dahl" and found["coulomb"].is_worse
    assert not found["simplified-lugre"].is_worse
    assert all(result.fitted.converged for result in found.results)


def test_the_record_that_tells_most_is_one_in_which_models_differ(study, estimate):
    """A damping shows the more the faster the motion; two equal models show nothing."""
    lugre, dahl = (
        next(c for c in candidates_of(study, friction=["simplified-lugre"]) if c.name == name)
        for name in ("simplified-lugre", "dahl")
    )
    values = {path: estimate.parameters[path].value for path in estimate.names}
    at = lambda name, numbers: pdssjax.selection.FittedCandidate(name, {}, tuple(numbers), values=numbers)
    damped = {"friction.sigma0": values["friction.sigma0"], "friction.f_ss": values["friction.f_c"]}
    one = (lugre.study, at("simplified-lugre", damped | {"friction.sigma1": 200.0}))
    two = (dahl.study, at("dahl", values))
    noises = [
        common_noise(r, r.measured - f.residual, 240.0) for r, f in zip(study.records, estimate.records, strict=True)
    ]
    told = most_discriminating_record(one, two, noises)
    assert told.speed == 10.0 and told.sigmas > 1.0 and told.tried == 3 and np.isnan(told.voltage)
    assert most_discriminating_record(two, two, noises) is None
