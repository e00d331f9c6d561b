"""A study predicts its records, with derivatives, as the independent reference has them."""

import dataclasses
import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pdssjax import Accuracy, InputError, Taylor, load_study
from pdssjax.integration import one_step as stepping

REFERENCE = json.loads((Path(__file__).parents[1] / "data" / "sawtooth.json").read_text(encoding="utf-8"))
CASE = next(c for c in REFERENCE["cases"] if (c["state"], c["direction"]) == ("deflection", "backward"))
TRUTH = dict(
    zip(
        REFERENCE["parameters"],
        [6736.0, 0.1772, 1.007e-7, 0.086, 1.1484e6, 0.953789e6, 54.4, 38.9, 0.7964, 0.5458],
        strict=True,
    )
)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    rows = [f"{t!r},{x!r}" for t, x in zip(REFERENCE["times_s"], CASE["effector_um"], strict=True)]
    (folder / "run.csv").write_text("\n".join(["time_s,displacement_um", *rows]))
    parameters = "\n".join(f'"{path}" = {{ value = {value} }}' for path, value in TRUTH.items())
    (folder / "study.toml").write_text(
        f"""format = "pdssjax-study/1"
[actuator]
piezo = "second-order"
friction = "anisotropic-lugre"
[parameters]
{parameters}
[[record]]
file = "run.csv"
columns = {{ time = "time_s", displacement = "displacement_um" }}
measures = "effector"
offset = 0
drive = {{ waveform = "sawtooth", direction = "backward", voltage = "64 V", frequency = "5 Hz" }}
"""
    )
    return load_study(folder / "study.toml")


def test_predict_gives_the_reference_trajectory(study):
    (motion,) = study.predict()
    assert np.max(np.abs(np.asarray(motion) * 1e6 - CASE["effector_um"])) < 1e-3


def test_predict_refuses_an_accuracy_that_is_a_number(study):
    with pytest.raises(InputError, match=r"accuracy: found 1e-09, expected an Accuracy\."):
        study.predict({}, 1e-9)


# By default `test_measurements` has the derivatives of a prediction, `test_reference` every column of these.
@pytest.mark.slow
def test_jacfwd_of_predict_gives_every_column_of_the_reference(study):
    values = {path: jnp.asarray(value) for path, value in TRUTH.items()}
    (slopes,) = jax.jit(jax.jacfwd(study.predict))(values)
    for i, (path, value) in enumerate(TRUTH.items()):
        right = np.asarray(CASE["jacobian"])[:, i]
        wrong = np.asarray(slopes[path]) * value * 1e6 - right
        assert np.linalg.norm(wrong) < 1e-3 * np.linalg.norm(right), path


# By default `test_platform_fits` maps a prediction over values, `test_sensitivities` a walk over parameters.
@pytest.mark.slow
def test_predict_maps_over_values(study):
    masses = jnp.array([0.08, 0.086, 0.1])
    (together,) = jax.jit(jax.vmap(lambda mass: study.predict({"effector.mass": mass})))(masses)
    for mass, row in zip(masses, together, strict=True):
        (alone,) = study.predict({"effector.mass": mass})
        np.testing.assert_allclose(row, alone, rtol=0, atol=1e-10)


def shortened(study, samples):
    record = study.records[0]
    shorter = dataclasses.replace(record, time=record.time[:samples], measured=record.measured[:samples])
    return dataclasses.replace(study, records=(shorter,))


def test_values_and_derivatives_trace_a_step_once_each_whatever_the_record_and_the_accuracy(study, monkeypatch):
    traced = []
    inner = stepping.first_crossing
    monkeypatch.setattr(stepping, "first_crossing", lambda *args: traced.append(1) or inner(*args))
    truth = {path: jnp.asarray(value) for path, value in TRUTH.items()}
    method = Taylor(5)  # nobody else's, so that nothing is traced yet
    for samples, tolerance, room in [(40, 1e-9, 8192), (60, 1e-8, 30000)]:
        accuracy = Accuracy(tolerance, method=method, max_steps=room)
        predictor = shortened(study, samples).predictor
        jax.make_jaxpr(lambda values, p=predictor, a=accuracy: p(values, a))(truth)
        jax.make_jaxpr(jax.jacfwd(lambda values, p=predictor, a=accuracy: p(values, a)))(truth)
    assert 1 <= len(traced) <= 2  # JAX 0.12 shares both
