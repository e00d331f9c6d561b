"""Which combinations data determine, what knowing one parameter would help, and which records disagree."""

import numpy as np
import pytest

import pdssjax
from pdssjax.files import EXAMPLE
from pdssjax.inference.diagnosis import agreement, best_remedy, combinations, prior_score, record_groups, score_of
from pdssjax.inference.notes.about_records import about_agreement
from pdssjax.report.text.estimate import format_diagnosis
from pdssjax.study import Agreement, Combination, Diagnosis, Remedy

PATHS = ("a", "b", "c")


def test_a_product_that_the_data_show_is_told_from_a_ratio_that_they_do_not():
    # y = a b / c to 1 %, a / b to 30 %, c to 2 %, each measured once and independently of the others.
    rows = np.array([[1.0, 1.0, -1.0], [1.0, -1.0, 0.0], [0.0, 0.0, 1.0]]) / np.array([[0.01], [0.3], [0.02]])
    relative = np.linalg.inv(rows.T @ rows)
    worst, *_, best = combinations(relative, PATHS)
    assert set(worst.exponents) == {"a", "b"}
    assert worst.exponents["a"] == pytest.approx(-worst.exponents["b"], rel=0.01)
    # ln a - ln b is known to 0.3, whatever else.
    assert worst.relative_error == pytest.approx(0.3, rel=0.01)
    assert best.relative_error < 0.012
    assert np.prod(np.sign([best.exponents[p] for p in "ab"])) == 1.0


def test_combinations_are_independent_and_their_errors_are_those_of_the_products():
    random = np.random.default_rng(1)
    factor = random.normal(size=(4, 4)) * [1.0, 0.1, 0.01, 1.0]
    relative = factor @ factor.T
    for found in combinations(relative, ("a", "b", "c", "d")):
        powers = np.array([found.exponents.get(path, 0.0) for path in "abcd"])
        assert found.relative_error**2 == pytest.approx(powers @ relative @ powers, rel=1e-6)
        assert max(abs(e) for e in found.exponents.values()) == 1.0


def test_parameters_without_information_take_no_part():
    relative = np.full((3, 3), np.nan)
    relative[np.ix_([0, 2], [0, 2])] = [[0.04, 0.0], [0.0, 0.01]]
    assert [set(c.exponents) for c in combinations(relative, PATHS)] == [{"a"}, {"c"}]
    assert combinations(np.full((3, 3), np.nan), PATHS) == ()
    assert best_remedy(np.full((3, 3), np.nan), PATHS) is None


def test_the_remedy_is_the_parameter_whose_knowledge_lowers_the_errors_of_others():
    # a / b and b / c are known to 1 %, the level of all three to 50 %.
    rows = np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0], [0.3, 0.4, 0.3]]) / np.array([[0.01], [0.01], [0.5]])
    relative = np.linalg.inv(rows.T @ rows)
    found = best_remedy(relative, PATHS)
    assert found is not None and found.path == "b"
    for path in "ac":
        before, after = found.errors[path]
        i, j = PATHS.index(path), PATHS.index("b")
        known = np.linalg.inv(np.delete(np.delete(rows.T @ rows, j, 0), j, 1))
        assert before == pytest.approx(np.sqrt(relative[i, i]))
        assert after == pytest.approx(np.sqrt(known[i - (i > j), i - (i > j)]), rel=1e-6)


def test_there_is_no_remedy_where_errors_are_independent_or_small():
    assert best_remedy(np.diag([0.1, 0.2, 0.3]), PATHS) is None
    assert best_remedy(1e-6 * np.array([[1.0, 0.99, 0], [0.99, 1.0, 0], [0, 0, 1.0]]), PATHS) is None


def line_records(slopes, random, noise=1.0, size=200):
    """Whitened residuals and Jacobians, at the joint optimum, of straight lines with slopes of their own."""
    x = np.linspace(0.0, 1.0, size)
    jacobian = np.stack([np.ones(size), x], axis=1) / noise
    data = [(slope * x + noise * random.normal(size=size)) / noise for slope in slopes]
    joint = np.linalg.lstsq(np.concatenate([jacobian] * len(slopes)), np.concatenate(data), rcond=None)[0]
    return [(jacobian @ joint - y, jacobian) for y in data], joint


def judged(parts, group):
    scores = [score_of(r, j) for r, j in parts]
    whole = sum(s.information for s in scores)
    errors = np.sqrt(np.diag(np.linalg.inv(whole)))
    inside = np.array([i in group for i in range(len(parts))])
    nothing = prior_score(np.zeros(0), np.zeros((0, 2)))
    (found,) = agreement(
        scores, nothing, {("record", tuple(f"r{i}" for i in group)): inside}, errors, ("zero", "slope")
    )
    return found, errors


def test_a_record_that_contradicts_is_named_and_what_leaving_it_out_changes_is_exact_for_a_linear_model():
    parts, joint = line_records([1.0, 1.0, 3.0], np.random.default_rng(2), noise=0.3)
    found, errors = judged(parts, [2])
    assert found.sigmas > 5.0
    rest = np.concatenate([jacobian @ joint - residual for residual, jacobian in parts[:2]])
    without = np.linalg.lstsq(np.concatenate([jacobian for _, jacobian in parts[:2]]), rest, rcond=None)[0]
    assert found.shifts["slope"] == pytest.approx((without - joint)[1] / errors[1], rel=1e-9)
    assert found.shifts["zero"] == pytest.approx((without - joint)[0] / errors[0], rel=1e-9)
    assert found.largest()[0] == "slope"
    innocent, _ = judged(line_records([1.0, 1.0, 1.0], np.random.default_rng(3), noise=0.3)[0], [2])
    assert abs(innocent.sigmas) < 3.5


def test_records_that_agree_are_called_contradicting_as_often_as_chance_has_it():
    random = np.random.default_rng(4)
    found = [judged(line_records([1.0] * 4, random)[0], [0])[0].sigmas for _ in range(400)]
    # Standard normal: 4.6 % beyond 2 on both sides together, of 400 trials 18 with a spread of 4.
    assert 6 <= np.sum(np.abs(found) > 2.0) <= 34
    assert np.std(found) == pytest.approx(1.0, abs=0.15)


def test_noise_that_is_correlated_is_no_contradiction():
    random, size = np.random.default_rng(5), 400
    x = np.linspace(0.0, 1.0, size)
    jacobian = np.stack([np.ones(size), x], axis=1)
    beyond = 0
    for _ in range(100):
        noise = random.normal(size=(3, size + 100))
        for k in range(1, size + 100):
            noise[:, k] += 0.9 * noise[:, k - 1]
        data = list(noise[:, 100:])
        joint = np.linalg.lstsq(np.concatenate([jacobian] * 3), np.concatenate(data), rcond=None)[0]
        beyond += judged([(jacobian @ joint - y, jacobian) for y in data], [1])[0].sigmas > 4.0
    assert beyond <= 2  # white errors would call half of them contradictions


def test_a_fit_that_ended_beside_its_optimum_makes_no_contradiction():
    """Of what one record tells alone, the pull is what the fit left, and its variance that of rounding."""
    x = np.linspace(0.0, 1.0, 200)
    known = [np.stack([np.ones(200), x, 0.0 * x], axis=1), np.stack([np.ones(200), x, 1e3 * x**2], axis=1)]
    random = np.random.default_rng(8)
    data = [random.normal(size=200) for _ in known]
    joint = np.linalg.lstsq(np.concatenate(known), np.concatenate(data), rcond=None)[0]
    errors = np.sqrt(np.diag(np.linalg.inv(sum(j.T @ j for j in known))))
    for beside in (0.0, 0.03):
        scores = [score_of(j @ (joint + beside * errors) - y, j) for y, j in zip(data, known, strict=True)]
        apart = prior_score(np.zeros(0), np.zeros((0, 3)))
        (found,) = agreement(scores, apart, {("record", ("b",)): np.array([False, True])}, errors, ("a", "b", "c"))
        assert abs(found.sigmas) < 3.0
        assert np.isnan(found.shifts["c"]) and abs(found.shifts["b"]) < 5.0


def test_records_disagree_as_much_where_a_fit_in_two_steps_ended_as_at_the_joint_optimum():
    """Exactly, in a linear model: what the scores do not add up to is shared out."""
    parts, joint = line_records([1.0, 1.0, 1.8], np.random.default_rng(2), noise=0.3)
    (first, known), *_ = parts
    alone = joint + np.linalg.lstsq(known, -first, rcond=None)[0]  # the first record's own optimum, kept for all
    at_joint, _ = judged(parts, [2])
    kept, _ = judged([(r + j @ (alone - joint), j) for r, j in parts], [2])
    assert np.linalg.norm((alone - joint) / joint) > 0.1
    assert kept.sigmas == pytest.approx(at_joint.sigmas, rel=1e-9) and kept.sigmas > 4.0
    assert kept.shifts == pytest.approx(at_joint.shifts, rel=1e-9)


def test_what_was_measured_apart_holds_what_no_other_record_tells():
    """Left out the only record of a slope, it would be that measured apart."""
    x = np.linspace(0.0, 1.0, 100)
    record = np.stack([np.ones(100), x], axis=1)
    data, apart = np.random.default_rng(9).normal(size=100), np.array([[0.0, 10.0]])
    told = np.array([10.0 * 0.3])  # a slope of 0.3 +/- 0.1
    flat = record * [1.0, 0.0]
    joint = np.linalg.lstsq(np.concatenate([record, flat, apart]), np.concatenate([data, data, told]), rcond=None)[0]
    rows = np.concatenate([record, flat, apart])
    errors = np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    scores = [score_of(record @ joint - data, record), score_of(flat @ joint - data, flat)]
    known = prior_score(apart @ joint - told, apart)
    (found,) = agreement(scores, known, {("record", ("a",)): np.array([True, False])}, errors, ("zero", "slope"))
    assert found.shifts["slope"] * errors[1] == pytest.approx(0.3 - joint[1], rel=1e-9)


def test_what_only_one_record_determines_has_no_shift():
    random = np.random.default_rng(6)
    both = np.stack([np.ones(50), np.linspace(0.0, 1.0, 50)], axis=1)
    flat = both * [1.0, 0.0]
    found, _ = judged([(random.normal(size=50), both), (random.normal(size=50), flat)], [0])
    assert np.isnan(found.shifts["slope"]) and np.isfinite(found.shifts["zero"])
    assert found.largest()[0] == "zero"


def test_report_and_notes_put_it_into_words():
    combination = Combination({"friction.a": 1.0, "friction.b": -0.5, "effector.mass": 0.3}, 0.123)
    remedy = Remedy("effector.mass", {"friction.a": (0.1, 0.02)})
    records = (
        Agreement(("step",), "record", 9.1, {"friction.a": -4.2, "friction.b": 1.0}),
        Agreement(("walk", "run"), "direction", 5.0, {"friction.a": 3.0}),
        Agreement(("calm",), "record", 1.0, {"friction.a": 5.0}),
    )
    diagnosis = Diagnosis((combination,), remedy, records)
    text = format_diagnosis(diagnosis)
    assert "friction.a  friction.b^-0.50  effector.mass^0.30" in text and "12 %" in text
    assert "best" not in text
    (note,) = about_agreement(diagnosis)
    assert note.startswith('"step" contradicts the other records (9.1 standard deviations')
    assert "without it friction.a would be 4.2 standard errors smaller" in note
    assert 'So do "run" and "walk", less' in note and "calm" not in note
    assert "If effector.mass were known from elsewhere, errors would fall: friction.a from 10 to 2 %." in text
    (note,) = about_agreement(diagnosis, "sequential")
    assert "without it friction.a of a joint fit would be 4.2 standard errors smaller" in note
    (note,) = about_agreement(Diagnosis((), None, (Agreement(("step",), "record", 9.1, {"friction.a": -7.6e3}),)))
    assert "without it friction.a would be over 100 standard errors smaller" in note
    assert about_agreement(None) == []
    # Beyond chance, but nothing that a user would notice.
    assert about_agreement(Diagnosis((), None, (Agreement(("a",), "record", 9.0, {"x": 0.5}),))) == []


def test_report_lists_what_is_told_least_and_best():
    found = [Combination({f"friction.{name}": 1.0}, 10.0**-k) for k, name in enumerate("abcdefgh", start=1)]
    least, best = format_diagnosis(Diagnosis(tuple(found[::-1]), None, ())).split("best")
    assert [line.split() for line in least.splitlines()[1:4]] == [
        ["friction.a", "10", "%"],
        ["friction.b", "1", "%"],
        ["friction.c", "0.1", "%"],
    ]
    assert [line.split()[0] for line in best.splitlines() if "friction" in line] == [
        "friction.h",
        "friction.g",
        "friction.f",
    ]
    few = format_diagnosis(Diagnosis(tuple(found[:4]), None, ()))
    assert few.count("friction.a") == 1 and few.split("best]]")[1].split()[0] == "friction.d"


def test_records_are_grouped_by_what_they_share(tmp_path):
    study = pdssjax.load_study(EXAMPLE / "study.toml")
    groups = record_groups([record for record in study.records if record.role == "fit"])
    kinds = [(what, len(names)) for what, names in groups]
    assert kinds == [("record", 1)] * 5 + [("kind", 3), ("kind", 2)]
    every = record_groups(study.records)
    assert ("direction", ("5 Hz A", "20 Hz A")) in every and ("direction", ("5 Hz B", "20 Hz B")) in every
    assert record_groups(study.records[:1]) == {}
