"""Which error to believe: the last whose assumption the residuals bear out, where it makes a difference."""

import dataclasses

import fabricated
import pytest

from pdssjax.inference.uncertainty.parameter_errors import advise
from pdssjax.study import ParameterError

RECORDS = ["step", "5 Hz A"]


def parameters(white, coloured, misfit):
    """One parameter with errors by each model, one without."""
    errors = {
        name: ParameterError(error, (1.0 - error, 1.0 + error))
        for name, error in zip(("white", "coloured", "with-misfit"), (white, coloured, misfit), strict=True)
    }
    known = dataclasses.replace(fabricated.parameter("friction.sigma1_a", 1.0, white, ""), errors=errors)
    return {"friction.sigma1_a": known, "effector.mass": fabricated.fixed("effector.mass", 0.086, "kg")}


def evidence(coloured=(0.0, 0.0), misfit=(-6.0, -6.0)):
    return {"white": [0.0, 0.0], "coloured": list(coloured), "with-misfit": list(misfit)}


@pytest.mark.parametrize(
    ("errors", "seen", "expected"),
    [
        ((0.1, 0.1, 0.1), evidence(), "white"),
        ((0.1, 0.2, 0.5), evidence(), "white"),  # what no record bears out
        ((0.1, 0.2, 0.21), evidence(coloured=(50.0, 0.0)), "coloured"),
        ((0.2, 0.1, 0.11), evidence(coloured=(50.0, 0.0)), "coloured"),
        ((0.1, 0.11, 0.5), evidence(misfit=(0.0, 30.0)), "with-misfit"),
        ((0.1, 0.2, 0.5), evidence((50.0, 0.0), (0.0, 30.0)), "with-misfit"),
        ((0.1, 0.2, 0.21), evidence((0.0, 0.0), (0.0, 30.0)), "coloured"),
        ((0.1, 0.11, 0.12), evidence((50.0, 50.0), (30.0, 30.0)), "white"),
    ],
)
def test_the_last_model_that_the_residuals_bear_out_and_that_matters(errors, seen, expected):
    advice = advise(parameters(*errors), seen, RECORDS)
    assert advice.model == expected


def test_the_reason_names_records_parameter_and_factor():
    reason = advise(parameters(0.1, 0.2, 0.5), evidence((50.0, 50.0), (0.0, 30.0)), RECORDS).reason
    assert 'residuals in "5 Hz A" are alike' in reason
    assert "2.5 times the coloured ones (friction.sigma1_a)" in reason
    reason = advise(parameters(0.1, 0.25, 0.25), evidence((50.0, 50.0)), RECORDS).reason
    assert 'residuals in "step" and "5 Hz A"' in reason
    assert "factor of up to 2.5 (friction.sigma1_a)" in reason


def test_a_difference_too_small_to_matter_is_said():
    assert '"step"' in advise(parameters(0.1, 0.1, 0.1), evidence((50.0, 0.0)), RECORDS).reason


def test_without_errors_there_is_no_advice():
    assert advise({"effector.mass": fabricated.fixed("effector.mass", 0.086, "kg")}, evidence(), RECORDS) is None
