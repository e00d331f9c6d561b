"""Records of all four kinds - platform, effector, friction, blocked force - fitted together and alone."""

import dataclasses
import json
from pathlib import Path

import four_kinds
import jax
import numpy as np
import pytest

import pdssjax
from pdssjax import Study
from pdssjax.cli.main import main
from pdssjax.inference import guess_starts
from pdssjax.study import make_recordings


def made(folder: Path, seed: int = 1, **kind) -> tuple[Study, dict[str, float]]:
    """A study with the records of a virtual rig, no free parameter with a start; and the truth."""
    file = folder / "study.toml"
    file.write_text(four_kinds.plan(**kind))
    planned = pdssjax.load_study(file, virtual=True)
    records = tuple(recording.record for recording in make_recordings(planned, seed))
    return dataclasses.replace(
        planned.with_starts(dict.fromkeys(planned.parameters)), records=records
    ), planned.values()


def alone(study: Study, *names: str) -> Study:
    """The study with the records of these names only."""
    return dataclasses.replace(study, records=tuple(r for r in study.records if r.name in names))


def pulls(estimate, true: dict[str, float]) -> dict[str, float]:
    """By how many standard errors each free parameter is off, in the logarithm, as all of them are fitted.

    Those without an error are left out.
    """
    told = {path: p for path, p in estimate.parameters.items() if p.free and np.isfinite(p.standard_error)}
    return {path: np.log(p.value / true[path]) / (p.standard_error / p.value) for path, p in told.items()}


def likely(estimate) -> bool:
    """Whether the reduced chi-square is one within four of its own standard deviations."""
    statistics = estimate.statistics
    return abs(statistics.reduced_chi2 - 1.0) < 4.0 * np.sqrt(2.0 / (statistics.samples - statistics.free))


def unknown(estimate) -> set[str]:
    """The free parameters about which the data say nothing."""
    return {path for path, p in estimate.parameters.items() if p.free and not p.identifiable}


def free(study: Study, *families: str) -> set[str]:
    """The free parameters of these parts of the rig; of all, if none is named."""
    return {path for path, p in study.parameters.items() if p.free and (not families or path.split(".")[0] in families)}


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    return made(tmp_path_factory.mktemp("rig"))


@pytest.fixture(scope="module")
def step(tmp_path_factory):
    """The rig with its step of the platform alone, which is quick to predict."""
    return made(tmp_path_factory.mktemp("step"), records=("step",))


@pytest.mark.slow
def test_every_start_guessed_from_four_kinds_is_within_a_factor_of_four(rig):
    study, true = rig
    starts, searched = guess_starts(study.models, study.parameters, study.records)
    assert searched
    for path in free(study):
        assert 0.25 < starts[path] / true[path] < 4.0, path


def test_a_stop_is_guessed_as_stiff_as_the_force_rises_with_the_platform_while_the_contact_sticks(tmp_path):
    file = tmp_path / "study.toml"
    file.write_text(four_kinds.plan(records=("blocked",)))
    planned = pdssjax.load_study(file, virtual=True)
    study, true = planned.with_starts({"stop.stiffness": None}), planned.values()
    (record,) = study.records
    pressed = true["stop.stiffness"] * true["piezo.gain"] * record.drive.sampled_at(record.time)
    blocked = dataclasses.replace(record, measured=np.minimum(pressed, 0.05))
    starts, _ = guess_starts(study.models, study.parameters, [blocked])
    assert starts["stop.stiffness"] == pytest.approx(true["stop.stiffness"], rel=1e-6)


@pytest.mark.slow  # tests/study/test_velocity.py finds a platform by a step alone
def test_steps_of_the_platform_alone_tell_its_piezo_and_say_that_they_tell_nothing_else(step):
    study, true = step
    estimate = pdssjax.identify(study)
    assert estimate.converged and likely(estimate)
    assert unknown(estimate) == free(study, "friction", "stop")
    assert max(map(abs, pulls(estimate, true).values())) < 3.0


def test_a_study_that_has_never_predicted_can_be_predicted_under_jit(step):
    study, true = step
    study = alone(study, "step")  # another study
    compiled = jax.jit(study.predict)(true)
    for now, later in zip(compiled, study.predict(true), strict=True):
        np.testing.assert_allclose(now, later, rtol=1e-9, atol=1e-15)


@pytest.mark.slow
def test_loops_of_the_contact_alone_tell_its_stiffness_and_force_and_nothing_of_the_actuator(rig):
    study, true = rig
    said = []
    estimate = pdssjax.identify(alone(study, "loops"), progress=said.append)
    assert estimate.converged and likely(estimate)
    assert unknown(estimate) == free(study, "piezo", "stop")
    told = pulls(estimate, true)
    assert {"friction.sigma0", "friction.f_ss"} <= set(told)
    assert max(map(abs, told.values())) < 3.0
    assert not any("other" in line for line in said)  # no race for a piezo that nothing shows
    assert any("cannot tell friction.sigma1 from zero" in note for note in estimate.notes)


@pytest.mark.slow
def test_walks_alone_tell_piezo_and_friction_but_not_the_stop(rig):
    study, true = rig
    estimate = pdssjax.identify(alone(study, "forward", "backward"))
    assert estimate.converged and likely(estimate)
    assert unknown(estimate) == {"stop.stiffness"}
    assert max(map(abs, pulls(estimate, true).values())) < 4.0


@pytest.mark.slow
def test_four_kinds_are_recorded_and_identified_without_starts_on_the_command_line(tmp_path):
    plan = tmp_path / "study.toml"
    plan.write_text(four_kinds.plan())
    assert main(["record", str(plan), "--out", str(tmp_path / "rig"), "--seed", "2"]) == 0
    study = tmp_path / "rig" / "records" / "study.toml"
    study.write_text(four_kinds.startless(study.read_text()))
    assert main(["identify", str(study), "--out", str(tmp_path / "found")]) == 0
    found = json.loads((tmp_path / "found" / "estimate.json").read_text())
    true = json.loads((study.parent / "truth.json").read_text())["parameters"]
    told = {path: p for path, p in found["parameters"].items() if p["free"]}
    assert len(told) == 7
    for path, p in told.items():
        assert abs(p["value"] - true[path]["value"]) < 3.0 * p["standard_error"], path


@pytest.mark.slow
@pytest.mark.parametrize("law", four_kinds.LAWS)
def test_errors_and_chi_square_of_four_kinds_together_are_honest(tmp_path, law):
    errors = []
    for seed in range(1, 6):
        study, true = made(tmp_path, seed, law=law)
        estimate = pdssjax.identify(study)
        assert estimate.converged and likely(estimate)
        told = pulls(estimate, true)
        assert set(told) == free(study)
        errors += told.values()
    assert max(map(abs, errors)) < 4.0
    # The root mean square of n pulls is 1 within four of its standard deviations.
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(1.0, abs=4.0 / np.sqrt(2.0 * len(errors)))


@pytest.mark.slow
def test_amplifier_and_sensor_are_found_together_with_lugre_friction(tmp_path):
    more = '"amplifier.bandwidth" = { start = "3 kHz" }\n"sensor.bandwidth" = { start = "2 kHz" }'
    study, true = made(tmp_path, law="lugre", more=more)
    estimate = pdssjax.identify(study)
    assert estimate.converged and likely(estimate)
    told = pulls(estimate, true)
    assert set(told) == free(study)
    assert max(map(abs, told.values())) < 3.0
