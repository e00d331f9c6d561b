"""A study predicts its records, with derivatives, as the independent reference has them."""

import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pdssjax.study import load_study

REFERENCE = json.loads((Path(__file__).parent / "data" / "sawtooth.json").read_text(encoding="utf-8"))
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


def test_jacfwd_of_predict_gives_every_column_of_the_reference(study):
    values = {path: jnp.asarray(value) for path, value in TRUTH.items()}
    (slopes,) = jax.jit(jax.jacfwd(study.predict))(values)
    for i, (path, value) in enumerate(TRUTH.items()):
        right = np.asarray(CASE["jacobian"])[:, i]
        wrong = np.asarray(slopes[path]) * value * 1e6 - right
        assert np.linalg.norm(wrong) < 1e-3 * np.linalg.norm(right), path


def test_predict_maps_over_values(study):
    masses = jnp.array([0.08, 0.086, 0.1])
    (together,) = jax.jit(jax.vmap(lambda mass: study.predict({"effector.mass": mass})))(masses)
    for mass, row in zip(masses, together, strict=True):
        (alone,) = study.predict({"effector.mass": mass})
        np.testing.assert_allclose(row, alone, rtol=0, atol=1e-10)
