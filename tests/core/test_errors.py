"""What is nothing of the kind that an argument expects is told in a line, before any work."""

from pathlib import Path

import pytest

import pdssjax
from pdssjax import InputError
from pdssjax.files import EXAMPLE

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
