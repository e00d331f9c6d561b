"""Arguments of a wrong kind, shape or order are refused by name, before any work."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import pdssjax
from pdssjax import InputError
from pdssjax.core import ascending_times, require_float64
from pdssjax.files import EXAMPLE


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (0.1, r"times: found the shape \(\), expected one dimension, \(m,\), with a time \[s\] or more\."),
        (np.zeros((2, 3)), r"times: found the shape \(2, 3\), expected one dimension"),
        ([], r"times: found the shape \(0,\), expected"),
        ([0.0, 0.2, 0.1], r"times: found 0.1 s after 0.2 s at index 2, expected times that ascend\."),
        ([0.0, np.nan, 0.1], r"times: found nan at index 1, expected finite times \[s\]\."),
        ("tomorrow", r"times: found 'tomorrow', expected an array of times \[s\]\."),
        ([[0.0], [0.1, 0.2]], r"times: found \[\[0.0\], \[0.1, 0.2\]\], expected an array of times \[s\]\."),
        (None, r"times: found None, expected an array of times \[s\]\."),
    ],
)
def test_times_are_refused(given, says):
    with pytest.raises(pdssjax.InputError, match=says):
        ascending_times("times", given)


@pytest.mark.parametrize("given", [[0, 1, 1], np.array([-1.0, 0.0, 1.0]), jnp.array([0.0, 1.0, 2.0], "float32")])
def test_times_are_floats_of_double_precision(given):
    times = ascending_times("times", given)
    assert times.dtype == np.float64
    np.testing.assert_array_equal(times, np.asarray(given, float))


def test_of_traced_times_the_shape_is_known():
    seen = jax.vmap(lambda times: ascending_times("times", times))(jnp.zeros((2, 3)))
    assert seen.shape == (2, 3)
    with pytest.raises(pdssjax.InputError, match=r"times: found the shape \(\)"):
        jax.jit(lambda times: ascending_times("times", times))(1.0)


def test_single_precision_is_refused_by_the_name_of_the_call():
    require_float64("simulate")
    with jax.enable_x64(False), pytest.raises(pdssjax.InputError, match="simulate: found JAX in single precision"):
        require_float64("simulate")


STUDY = pdssjax.load_study(EXAMPLE / "study.toml")
PATH = EXAMPLE / "study.toml"


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (lambda: pdssjax.identify(PATH), r"^study: found .*, expected a Study, as load_study gives it\.$"),
        (lambda: pdssjax.identify(STUDY, drawing=5), r"^drawing: found 5, expected a Drawing\.$"),
        (lambda: pdssjax.identify(STUDY, executor=3), r"^executor: found 3, expected an Executor\.$"),
        (lambda: pdssjax.identify(STUDY, accuracy=1e-9), r"^accuracy: found 1e-09, expected an Accuracy\.$"),
        (lambda: pdssjax.initial_guess(str(PATH)), r"^study: found '.*', expected a Study"),
        (lambda: pdssjax.pose_problem(Path("x")), r"^study: found .*, expected a Study"),
        (lambda: STUDY.predict(5), r"^values: found 5, expected a Mapping\.$"),
        (lambda: STUDY.with_values([1.0]), r"^values: found \[1\.0\], expected a Mapping\.$"),
        (lambda: pdssjax.sweep(PATH, {"drive.voltage": [60.0]}), r"^study: found .*, expected a Study"),
        (lambda: pdssjax.sweep(STUDY, 3), r"^over: found 3, expected a Mapping\.$"),
    ],
)
def test_an_argument_of_another_kind_is_named(call, told):
    with pytest.raises(InputError, match=told):
        call()
