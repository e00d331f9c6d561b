"""A path that is named has an effect, or is refused by name; so is a number outside its range."""

import warnings

import jax
import jax.numpy as jnp
import measured_study
import numpy as np
import pytest
from jax.interpreters import partial_eval

import pdssjax
from pdssjax import Accuracy, InputError, load_study
from pdssjax.core import member
from pdssjax.study import Predictor
from pdssjax.study.parameter_use import paths_read, unused_by

VARIANTS = measured_study.variants()
PLATFORM = next(m for m in VARIANTS if measured_study.label(m) == "platform")
QUICK = ("platform", "friction", "effector")
"""Measurements that are traced in the default tests, without feedback."""


def planned(folder, measurement, listed=("piezo", "friction", "effector", "stop"), **how):
    """A study with a planned record of a measurement; the parameters of the parts `listed` have a start."""
    text = measured_study.study(measured_study.record(measurement), **how)
    lines = [line for line in text.splitlines() if not line.startswith('"') or line[1:].split(".")[0] in listed]
    file = folder / "study.toml"
    file.write_text("\n".join(lines))
    return load_study(file, virtual=True)


def traced(measurement, feedback):
    name = measured_study.label(measurement)
    marks = () if name in QUICK and not feedback else pytest.mark.slow
    return pytest.param(measurement, feedback, marks=marks, id=f"{name}, feedback {feedback}")


@pytest.fixture(scope="module")
def platform(tmp_path_factory):
    """A step of the platform, whose study lists nothing but the stack."""
    return planned(tmp_path_factory.mktemp("platform"), PLATFORM, ["piezo"])


@pytest.mark.parametrize(("measurement", "feedback"), [traced(m, f) for m in VARIANTS for f in (False, True)])
def test_what_is_said_to_be_read_is_what_a_prediction_computes_with(measurement, feedback, tmp_path):
    """Judged by the traced program: which of its inputs reach an output."""
    study = planned(tmp_path, measurement, feedback=feedback and measurement.driven)
    declared = study.models.declared()
    models = study.models_with(declared)
    predictor = Predictor(models, study.records)
    numbers = {path: jnp.asarray(q.nominal, float) for path, q in declared.items()}
    paths = sorted(numbers)
    program = jax.make_jaxpr(lambda *at: predictor(dict(zip(paths, at, strict=True)), Accuracy()))(
        *(numbers[path] for path in paths)
    ).jaxpr
    _, reached = partial_eval.dce_jaxpr(program, [True] * len(program.outvars))
    computed = {path for path, is_used in zip(paths, reached, strict=True) if is_used}
    read = {path for path in paths_read(models, study.records) if not path.startswith("drive.")}
    assert read == computed - unused_by(models)


@pytest.mark.parametrize(
    ("path", "number", "says"),
    [
        ("stop.stiffness", 1e5, 'no record runs against a stop. It needs a record with measures = "force"'),
        ("effector.load", 0.1, "no record depends on the end-effector"),
        ("drive.voltage", 30.0, "every record sets the voltage of its own drive"),
        ("drive.duty", 0.7, "no drive of a record has a duty"),
        ("piezo.mass", 0.5, "feedback = true"),
        ("piezo.gian", 1e-7, r'unknown parameter "piezo.gian"; did you mean "piezo.gain"'),
        ("piezo.gain", -1e-7, r'"piezo.gain": found -1e-07 m/V, expected a value above 0'),
        ("piezo.damping_ratio", 2.0, "below 1"),
        ("piezo.gain", float("nan"), "found nan m/V"),
        ("piezo.gain", "0.1 um/V", "found '0.1 um/V', expected a number in m/V"),
        ("piezo.gain", None, "found None, expected a number in m/V"),
        ("piezo.gain", [1e-7, 2e-7], r"found an array of shape \(2,\)"),
        ("amplifier.slew", 1e5, 'without "amplifier.bandwidth"'),
        ("drive.rise_time", -1e-3, "of at least 0 s"),
    ],
)
def test_what_would_change_nothing_or_is_no_legal_number_is_refused_at_every_entrance(platform, path, number, says):
    for ask in (platform.predict, platform.with_values):
        with pytest.raises(InputError, match=says) as refused:
            ask({path: number})
        assert str(refused.value).startswith("values: ") and path in str(refused.value)


@pytest.mark.parametrize(
    "values",
    [
        pytest.param({"amplifier.bandwidth": 300.0}, id="amplifier"),
        pytest.param({"sensor.bandwidth": 300.0}, id="sensor", marks=pytest.mark.slow),
        pytest.param({"drive.rise_time": 2e-3}, id="drive"),
    ],
)
def test_a_part_that_the_study_has_not_takes_effect_where_its_number_is_told(platform, values):
    (plain,) = platform.predict()
    (told,) = platform.predict(values)
    (fixed,) = platform.with_values(values).predict()
    assert float(np.abs(told - plain).max()) > 1e-7
    assert np.array_equal(told, fixed)
    # The study itself stays as it is.
    assert np.array_equal(platform.predict()[0], plain)


def test_traced_numbers_are_differentiated_and_their_paths_checked(platform):
    slope = lambda path, at: jax.jacfwd(lambda number: platform.predict({path: number})[0])(at)
    assert float(np.abs(slope("drive.rise_time", 2e-3)).max()) > 0
    batched = jax.jit(jax.vmap(lambda number: platform.predict({"piezo.damping_ratio": number})[0]))
    assert np.isfinite(batched(jnp.array([0.1, 0.2]))).all()
    with pytest.raises(InputError, match="no record runs against a stop"):
        slope("stop.stiffness", 1e5)
    with pytest.raises(InputError, match="unknown parameter"):
        jax.jit(lambda number: platform.predict({"piezo.gian": number})[0])(1e-7)


def test_a_duration_that_does_not_fit_into_a_drive_is_refused(tmp_path):
    walks = next(m for m in VARIANTS if measured_study.label(m) == "effector")
    study = planned(tmp_path, walks)
    with pytest.raises(
        InputError,
        match=r'values: "drive\.fall_time": found 0\.02 s, expected less than the period.* in record "effector"',
    ):
        study.predict({"drive.fall_time": 0.02})


def test_listed_parameters_pass_whatever_is_measured(platform, tmp_path):
    """A study of a whole rig is given all its numbers, also where its records need no more than some."""
    whole = planned(tmp_path, PLATFORM)
    assert np.array_equal(whole.predict(whole.values() | {"friction.f_ss": 0.5})[0], platform.predict()[0])


@pytest.mark.parametrize(
    ("stack", "walk", "says"),
    [
        ({"gain": -1e-7}, {}, r"SecondOrder\.gain: found -1e-07 m/V"),
        ({"damping_ratio": 1.5}, {}, r"SecondOrder\.damping_ratio: found 1\.5"),
        ({}, {"fall_time": -1.0}, r"Sawtooth\.fall_time: found -1 s"),
        ({}, {"fall_time": 1.0}, r"drive\.fall_time: found 1 s, expected less than the period"),
    ],
)
def test_simulate_refuses_numbers_that_a_study_would_refuse(stack, walk, says):
    with pytest.raises(InputError, match=says):
        piezo, law = member("piezo", "second-order")(**stack), member("friction", "coulomb")()
        actuator = pdssjax.Actuator(piezo, law, pdssjax.Effector())
        pdssjax.simulate(actuator, member("drive", "sawtooth")(**walk), jnp.linspace(0.0, 0.01, 3))


def test_nothing_is_warned_of_a_study_that_is_predicted(platform):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        platform.predict({"piezo.gain": 1.1e-7})
