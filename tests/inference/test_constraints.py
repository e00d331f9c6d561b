"""Constraints between parameters: read, refused, kept by fits, errors and intervals, and left out where they cannot be.

Fits are of a Stribeck curve in steady sliding, which needs no simulation.
"""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from record_tables import write_columns

import pdssjax
from pdssjax import Drawing, InputError, InputWarning
from pdssjax.selection import candidates_of
from pdssjax.study import bounded_by_constraints, chained

SPEED = np.linspace(0.05, 5.0, 60)
"""[mm/s]"""
NOISE = 0.01
"""[N]"""
FREE = {"f_c": "start = 0.4", "f_s": "start = 0.8", "v_s": "value = 1e-3"}
STATIC = 'static = "friction.f_s >= friction.f_c"'


def posed(folder: Path, constraints: str = STATIC, static: float = 0.7, law: str = "stribeck", **given: str):
    """The study of a curve whose static force is `static` and whose Coulomb force is 0.5 N; with other entries."""
    force = 0.5 + (static - 0.5) * np.exp(-(SPEED**2)) + NOISE * np.random.default_rng(3).standard_normal(SPEED.size)
    write_columns(folder / "run.csv", "v_mm/s,F_N", SPEED, force, digits="%.18e")
    listed = "\n".join(f'"friction.{name}" = {{ {entry} }}' for name, entry in (FREE | given).items() if entry != "-")
    (folder / "study.toml").write_text(
        f'format = "pdssjax-study/1"\n[actuator]\npiezo = "second-order"\nfriction = "{law}"\n'
        f"[parameters]\n{listed}\n[constraints]\n{constraints}\n"
        '[[record]]\nname = "run"\nfile = "run.csv"\nmeasures = "steady-friction"\n'
        f'columns = {{ velocity = "v_mm/s", force = "F_N" }}\nunits = {{ velocity = "mm/s", force = "N" }}\n'
        f"noise = {NOISE}\noffset = 0\n",
        encoding="utf-8",
    )
    return pdssjax.load_study(folder / "study.toml")


def without(study):
    return dataclasses.replace(study, constraints=())


@pytest.mark.parametrize(
    ("constraint", "bounded"),
    [
        (STATIC, "f_c"),
        ('a = "friction.f_c <= 0.9 * friction.f_s"', "f_s"),
        ('a = "2 * friction.f_s >= friction.f_c"', "f_c"),
    ],
)
def test_a_constraint_that_is_kept_changes_nothing(tmp_path, constraint, bounded):
    """Whichever of the two is fitted by its distance from the other: the one without bounds of its own."""
    study = posed(tmp_path, constraint, **{bounded: FREE[bounded] + ", min = 0.1, max = 5"})
    found, expected = pdssjax.identify(study), pdssjax.identify(without(study))
    assert found.converged and not any(parameter.at_bound for parameter in found.parameters.values())
    np.testing.assert_allclose(found.covariance, expected.covariance, rtol=1e-5)
    np.testing.assert_allclose(found.correlation, expected.correlation, rtol=1e-5)
    for path, parameter in expected.parameters.items():
        mine = found.parameters[path]
        assert mine.value == pytest.approx(parameter.value, rel=1e-6)
        assert (mine.standard_error, *mine.interval) == pytest.approx(
            (parameter.standard_error, *parameter.interval), rel=1e-5, nan_ok=True
        )
        for model, error in parameter.errors.items():
            assert mine.errors[model].standard_error == pytest.approx(error.standard_error, rel=1e-5)
    assert found.statistics.chi2 == pytest.approx(expected.statistics.chi2, rel=1e-9)


def test_profiles_are_those_of_the_parameters_themselves(tmp_path):
    study = posed(tmp_path)
    found, expected = (pdssjax.identify(s, intervals="profile") for s in (study, without(study)))
    assert [profile.path for profile in found.profiles] == ["friction.f_c", "friction.f_s"]
    for path in found.names:
        assert found.parameters[path].interval == pytest.approx(expected.parameters[path].interval, rel=1e-4)
        assert found.parameters[path].verdicts == expected.parameters[path].verdicts


def test_where_the_records_want_it_broken_both_are_equal_and_the_report_says_so(tmp_path):
    study = posed(tmp_path, static=0.3)
    found = pdssjax.identify(study)
    force = study.records[0].measured
    coulomb, static = found.parameters["friction.f_c"], found.parameters["friction.f_s"]
    assert found.converged and static.at_bound and not coulomb.at_bound
    assert static.value == pytest.approx(coulomb.value, rel=1e-12)
    # The curve is flat then: its level is the mean.
    assert coulomb.value == pytest.approx(float(np.mean(force)), rel=1e-6)
    (note,) = [note for note in found.notes if "constraint" in note]
    assert "friction.f_s is at the constraint friction.f_s >= friction.f_c" in note and '"static"' in note


def test_a_profile_does_not_leave_what_a_constraint_allows(tmp_path):
    """The records want f_s below f_c a little: the interval of f_s is where both are equal, or f_s the larger."""
    study = posed(tmp_path, static=0.49)
    free, tied = (pdssjax.identify(s, intervals="profile") for s in (without(study), study))
    equal = pdssjax.identify(study).parameters["friction.f_c"]
    (low, high), f_s = tied.parameters["friction.f_s"].interval, free.parameters["friction.f_s"]
    assert f_s.interval[0] < low < equal.value < high
    profile = next(profile for profile in tied.profiles if profile.path == "friction.f_s")
    assert (profile.excess >= -1e-6).all()


@pytest.mark.slow
def test_draws_keep_a_constraint(tmp_path):
    study = posed(tmp_path, static=0.5)
    for kind in ("bootstrap", "posterior"):
        draws = pdssjax.identify(study, intervals=kind, drawing=Drawing(60)).draws
        values = draws.values.reshape(-1, len(draws.names))
        at = {path: values[:, draws.names.index(path)] for path in draws.names}
        assert (at["friction.f_s"] >= at["friction.f_c"] * (1.0 - 1e-12)).all()


def test_a_fixed_partner_bounds_the_other(tmp_path):
    study = posed(tmp_path, static=0.4, f_c="value = 0.5")
    found = pdssjax.identify(study).parameters["friction.f_s"]
    assert found.value == pytest.approx(0.5) and found.at_bound and found.bounds[0] == 0.5
    assert study.bounded_parameters["friction.f_s"].low == 0.5
    held = posed(tmp_path, 'a = "friction.f_c <= 0.5 * friction.f_s"', f_s="value = 0.8")
    assert held.bounded_parameters["friction.f_c"].high == 0.4


def test_starts_that_break_it_are_moved_with_a_word(tmp_path):
    with pytest.warns(
        InputWarning, match=r'study.toml: constraints: key "static": found starts that break .*f_s at 0.3'
    ):
        study = posed(tmp_path, f_s="start = 0.3")
    problem, start = pdssjax.pose_problem(study)
    begun = {path: float(number) for path, number in problem.decode(start).items()}
    assert begun == pytest.approx({"friction.f_c": 0.4, "friction.f_s": 0.4})
    assert pdssjax.identify(study).converged


REFUSED = {
    "unknown": ('a = "friction.f_s >= friction.f_x"', 'key "a": found the unknown parameter "friction.f_x"; .*f_s'),
    "unit": ('a = "friction.f_s >= friction.v_s"', 'key "a": found friction.f_s in N and friction.v_s in m/s'),
    "number": ('a = "friction.f_s >= 0.3"', 'key "a": .*"min" or "max"'),
    "grammar": ('a = "friction.f_s"', 'key "a": found "friction.f_s", expected an inequality'),
    "no text": ("a = 3", 'key "a": found 3'),
    "factor": ('a = "friction.f_s >= 0 * friction.f_c"', "expected factors above 0"),
    "loop": (f'{STATIC}\nb = "friction.f_c >= friction.f_s"', 'key "b": found a loop'),
    "itself": ('a = "friction.f_s >= friction.f_s"', 'key "a": found a loop'),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_constraint_is_refused_in_a_line_with_file_and_key(tmp_path, name):
    constraints, message = REFUSED[name]
    with pytest.raises(InputError, match=f"study.toml: constraints: .*{message}") as raised:
        posed(tmp_path, constraints)
    assert "\n" not in str(raised.value)


BROKEN = {
    "both fixed": ({"f_c": "value = 0.5", "f_s": "value = 0.4"}, "f_s fixed at 0.4 and friction.f_c at 0.5 N"),
    "no room": ({"f_c": "value = 0.5", "f_s": "start = 0.3, max = 0.4"}, "no room between 0.5 and 0.4 N"),
    "two ranges": (
        {"f_c": "start = 0.4, min = 0.2, max = 0.9", "f_s": "start = 0.6, min = 0.1, max = 0.8"},
        "found bounds of both",
    ),
}


@pytest.mark.parametrize("name", BROKEN)
def test_numbers_that_cannot_keep_it_are_refused(tmp_path, name):
    given, message = BROKEN[name]
    with pytest.raises(InputError, match=f'study.toml: constraints: key "static": .*{message}'):
        posed(tmp_path, **given)


def test_a_chain_is_led_from_the_parameter_that_has_bounds(tmp_path):
    text = '"friction.sigma0_a >= friction.sigma0_b"'
    lines = f'a = {text}\nb = "friction.sigma0_b >= 2 * friction.sigma0_b@wet"'
    study = wet(tmp_path, lines, "min = 1e5")
    links = chained(bounded_by_constraints(study.parameters, study.constraints, ""), study.constraints, "")
    assert [(link.child, link.parent) for link in links] == [
        ("friction.sigma0_b", "friction.sigma0_b@wet"),
        ("friction.sigma0_a", "friction.sigma0_b"),
    ]
    problem, start = pdssjax.pose_problem(study)
    transform = problem.residual.transform
    tied = transform.among([link.child for link in links])
    lowest = transform.in_si(transform.own(np.where(tied, transform.low, start)))
    lowest = dict(zip(transform.paths, lowest, strict=True))
    assert lowest["friction.sigma0_a"] == pytest.approx(lowest["friction.sigma0_b"])
    assert lowest["friction.sigma0_b"] == pytest.approx(2.0 * lowest["friction.sigma0_b@wet"])


def wet(folder: Path, constraints: str, bounds: str):
    """A study of a contact under a prescribed motion, wet and dry, whose law has directions."""
    time = np.arange(0.0, 0.02, 1e-3)
    write_columns(
        folder / "run.csv", "time_s,x_um,F_N", time, np.sin(2 * np.pi * 50 * time), np.cos(time), digits="%.18e"
    )
    names = [f"{name}_{side}" for name in ("sigma1", "f_ss") for side in "ab"]
    listed = "\n".join(f'"friction.{name}" = {{ value = 1 }}' for name in names)
    record = (
        '[[record]]\nname = "{0}"\nfile = "run.csv"\nmeasures = "friction"\nconditions = {1}\n'
        'columns = {{ time = "time_s", motion = "x_um", force = "F_N" }}\n'
    )
    (folder / "wet.toml").write_text(
        'format = "pdssjax-study/1"\nactuator = { piezo = "second-order", friction = "anisotropic-lugre" }\n'
        f'[parameters]\n{listed}\n"friction.sigma0_a" = {{ start = 5e6 }}\n"friction.sigma0_b" = {{ start = 2e6 }}\n'
        f'"friction.sigma0_b@wet" = {{ start = 5e5, {bounds} }}\n[constraints]\n{constraints}\n'
        + record.format("dry", "[]")
        + record.format("wet", '["wet"]'),
        encoding="utf-8",
    )
    return pdssjax.load_study(folder / "wet.toml")


def test_a_law_without_one_of_the_parameters_drops_the_constraint(tmp_path):
    study = posed(tmp_path)
    found = {candidate.name: candidate.study.constraints for candidate in candidates_of(study, ["coulomb", "lugre"])}
    assert found == {"coulomb": (), "lugre": study.constraints, "stribeck": study.constraints}
