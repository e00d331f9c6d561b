"""Which models a study is compared under, and how held-out parts judge them."""

import dataclasses

import numpy as np
import pytest
from compared_laws import NOISE, Here, contact_study, contact_text, write_contact
from scipy.optimize import least_squares
from study_files import write_study

import pdssjax
from pdssjax import InputError
from pdssjax.core import members
from pdssjax.selection import candidates_of, held_out
from pdssjax.selection.candidate_fits import fitted_candidate
from pdssjax.selection.candidates import neighbours, starting_near
from pdssjax.selection.comparing import most_discriminating_record
from pdssjax.selection.scores import common_noise


@pytest.fixture
def study(tmp_path):
    return contact_study(tmp_path)


def named(study, **asked):
    return {candidate.name: candidate for candidate in candidates_of(study, **asked)}


def test_every_law_is_compared_where_nothing_is_asked_for_the_simplest_first(study):
    found = candidates_of(study)
    assert {candidate.name for candidate in found} == set(members("friction"))
    counts = [len(candidate.free) for candidate in found]
    assert counts == sorted(counts) and found[0].name == "coulomb"


def test_the_studys_own_model_stays_as_it_is_and_is_always_there(study):
    found = named(study, friction=["coulomb"])
    assert list(found) == ["coulomb", "dahl"]
    assert found["dahl"].study.parameters == study.parameters


def test_a_new_law_has_its_parameters_free_and_keeps_what_both_have(study):
    bounded = dataclasses.replace(study.parameters["friction.f_c"], low=0.1, high=0.9, start=0.5)
    study = dataclasses.replace(study, parameters=study.parameters | {"friction.f_c": bounded})
    lugre = named(study, friction=["lugre"])["lugre"].study
    assert lugre.parameters["friction.f_c"] == bounded
    assert set(lugre.parameters) == {f"friction.{name}" for name in ("sigma0", "sigma1", "f_c", "f_s", "v_s")}
    assert all(p.free and p.start is None for path, p in lugre.parameters.items() if path != "friction.f_c")


def test_each_begins_at_the_optimum_of_the_simpler_model_that_shares_most_with_it(study):
    found = candidates_of(study, friction=["coulomb", "simplified-lugre", "anisotropic-lugre", "lugre"])
    near = neighbours(found)
    assert near["coulomb"] is None and near["dahl"] == "coulomb"
    assert near["simplified-lugre"] == "dahl" and near["anisotropic-lugre"] == "simplified-lugre"


def test_what_laws_share_by_meaning_begins_at_the_same_number(study):
    found = named(study, friction=["simplified-lugre", "anisotropic-lugre"])
    values = {"friction.sigma0": 2e6, "friction.f_c": 0.7}
    parameters = starting_near(found["simplified-lugre"], values).parameters
    assert (parameters["friction.sigma0"].start, parameters["friction.f_ss"].start) == (2e6, 0.7)
    assert parameters["friction.sigma1"].start is None
    parameters = starting_near(found["anisotropic-lugre"], values).parameters
    assert parameters["friction.sigma0_b"].start == 2e6 and parameters["friction.f_ss_a"].start == 0.7
    back = {"friction.sigma0_a": 1e6, "friction.sigma0_b": 4e6, "friction.f_ss_a": 0.5, "friction.f_ss_b": 0.5}
    assert starting_near(found["simplified-lugre"], back).parameters["friction.sigma0"].start == pytest.approx(2e6)


def test_a_start_beyond_a_bound_is_moved_to_it(study):
    bounded = dataclasses.replace(study.parameters["friction.f_c"], low=0.1, high=0.4)
    study = dataclasses.replace(study, parameters=study.parameters | {"friction.f_c": bounded})
    dahl = named(study, friction=["coulomb"])["dahl"]
    assert starting_near(dahl, {"friction.f_c": 0.7}).parameters["friction.f_c"].start == 0.4


def test_readings_of_a_law_and_of_the_feedback_have_names_of_their_own(tmp_path):
    study = pdssjax.load_study(write_study(tmp_path))
    found = named(study, friction=["anisotropic-lugre", "anisotropic-lugre:force"])
    assert found["anisotropic-lugre:force"].study.friction_state == "force"
    assert found["anisotropic-lugre:force"].folder == "anisotropic-lugre-force"
    both = named(study, feedback=[True])
    assert set(both) == {"feedback", "no feedback"} and "piezo.mass" in both["feedback"].study.parameters


def test_a_model_that_cannot_be_posed_is_refused_with_the_reason(tmp_path):
    study = pdssjax.load_study(write_study(tmp_path))
    found = named(study, piezo=["static"], feedback=[True])
    assert "which no force moves" in found["static, feedback"].refused
    assert not found["static, no feedback"].refused and "static, feedback" not in neighbours(list(found.values()))
    text = contact_text(parameters='"friction.sigma0" = {}\n"friction.f_c" = {}\n"friction.f_c@wet" = {}')
    text = text.replace('name = "wide"', 'name = "wide"\nconditions = ["wet"]')
    wet = pdssjax.load_study(write_contact(tmp_path, text))
    found = named(wet, friction=["generalized-maxwell-slip", "lugre"])
    assert "friction.f_c@wet under a condition" in found["generalized-maxwell-slip"].refused
    assert "friction.f_c@wet" in found["lugre"].study.parameters


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        ({"friction": ["dhal"]}, r'friction: found the unknown name "dhal"; did you mean "dahl"\?'),
        (
            {"friction": ["anisotropic-lugre:forc"]},
            r'found the reading "forc" of anisotropic-lugre; did you mean "forc',
        ),
        ({"friction": ["dahl:force"]}, "dahl has one reading"),
        ({"friction": "dahl"}, r'friction: found the text "dahl", expected a list of names'),
        ({"friction": ["dahl"]}, r"found one model to compare \(second-order, dahl, no feedback\), expected another"),
        ({"piezo": ["second-ordre"]}, 'piezo: found the unknown name "second-ordre"; did you mean "second-order"'),
        ({"piezo": ["static:play"]}, 'found "static:play", expected "static" without a colon'),
        ({"piezo": ["composed:nonsense"]}, "expected a variant such as"),
        ({"feedback": [False]}, "found one model to compare"),
    ],
)
def test_what_is_asked_wrongly_is_refused_in_a_line(study, asked, told):
    with pytest.raises(InputError, match=told) as raised:
        candidates_of(study, **asked)
    assert "\n" not in str(raised.value)


def test_a_law_with_both_forces_keeps_the_static_one_above_coulombs(study):
    stated = {c.name: [constraint.text for constraint in c.study.constraints] for c in candidates_of(study)}
    assert stated["lugre"] == stated["stribeck"] == ["friction.f_s >= friction.f_c"]
    assert stated["dahl"] == stated["coulomb"] == []


TRUTH = {"friction.sigma0": 8e5, "friction.f_c": 0.6}


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    """Two records of a Dahl contact, with noise."""
    folder, random = tmp_path_factory.mktemp("contact"), np.random.default_rng(5)
    empty = contact_study(folder)
    forces = [np.asarray(force) for force in empty.predict(TRUTH)]
    noisy = {r.name: f + NOISE * random.standard_normal(f.size) for r, f in zip(empty.records, forces, strict=True)}
    return pdssjax.load_study(write_contact(folder, contact_text(), noisy))


@pytest.fixture(scope="module")
def estimate(rig):
    return pdssjax.identify(rig)


@pytest.fixture(scope="module")
def fitted(rig, estimate):
    dahl = next(c for c in candidates_of(rig, friction=["coulomb"]) if c.name == "dahl")
    return fitted_candidate(dahl, estimate, "study")


def test_what_is_held_out_is_predicted_as_by_a_fit_without_it(rig, estimate, fitted):
    """A block, and a whole record, against fits to what is left of the records."""
    parts = held_out.parts_of(rig)
    found, refitted = held_out.held_out(rig, fitted, parts)
    assert refitted == 0
    for number in (0, next(k for k, part in enumerate(parts) if part.kind == "record")):
        part = parts[number]
        problem, start = pdssjax.pose_problem(rig.with_starts(estimate))
        used = [np.ones(record.time.size, bool) for record in rig.records]
        used[part.record] = ~part.rows
        left = problem.fitted_to(used)
        refitted = least_squares(left.whitened, start, left.jacobian, left.bounds, x_scale="jac", xtol=1e-12).x
        motion = rig.predict({path: float(x) for path, x in left.decode(refitted).items()})[part.record]
        expected = (rig.records[part.record].measured - np.asarray(motion))[part.rows]
        seen = (estimate.records[part.record].residual)[part.rows]
        assert np.max(np.abs(found[number] - expected)) < 0.05 * np.max(np.abs(seen - expected)) + 1e-6


def test_a_step_that_is_not_believed_is_fitted_again(rig, fitted, monkeypatch):
    monkeypatch.setattr(held_out, "MAX_CHI2_RISE", -np.inf)
    parts = held_out.parts_of(rig)[:1]
    (again,), refitted = held_out.held_out(rig, fitted, parts)
    assert refitted == 1
    monkeypatch.undo()
    (first,), _ = held_out.held_out(rig, fitted, parts)
    np.testing.assert_allclose(again, first, atol=1e-4)


@pytest.mark.slow
def test_coulombs_law_is_worse_on_records_of_dahls(rig):
    found = pdssjax.compare(rig, friction=["coulomb", "simplified-lugre"], executor=Here())
    assert found.chosen == "dahl" and found["coulomb"].is_worse
    assert not found["simplified-lugre"].is_worse
    assert all(result.fitted.converged for result in found.results)


def test_the_record_that_tells_most_is_one_in_which_models_differ(rig, estimate):
    """A damping shows the more the faster the motion; two equal models show nothing."""
    lugre, dahl = (
        next(c for c in candidates_of(rig, friction=["simplified-lugre"]) if c.name == name)
        for name in ("simplified-lugre", "dahl")
    )
    values = {path: estimate.parameters[path].value for path in estimate.names}
    at = lambda name, numbers: pdssjax.selection.FittedCandidate(name, {}, tuple(numbers), values=numbers)
    damped = {"friction.sigma0": values["friction.sigma0"], "friction.f_ss": values["friction.f_c"]}
    one = (lugre.study, at("simplified-lugre", damped | {"friction.sigma1": 200.0}))
    two = (dahl.study, at("dahl", values))
    noises = [
        common_noise(r, r.measured - f.residual, 240.0) for r, f in zip(rig.records, estimate.records, strict=True)
    ]
    told = most_discriminating_record(one, two, noises)
    assert told.speed == 10.0 and told.sigmas > 1.0 and told.tried == 3 and np.isnan(told.voltage)
    assert most_discriminating_record(two, two, noises) is None
