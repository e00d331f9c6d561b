"""Samples that are held out of a problem leave residuals, Jacobian and the record's zero as if they were not there."""

import dataclasses

import numpy as np
import pytest
from marks import slow
from platform_study import DAMPING, GAIN, RATE, write_platform

import pdssjax
from pdssjax import Accuracy
from pdssjax.inference import pose
from pdssjax.inference.losses.cauchy import Cauchy
from pdssjax.inference.losses.huber import Huber
from pdssjax.inference.losses.squares import Squares

TRUTH = {"piezo.gain": GAIN, "piezo.natural_frequency": RATE, "piezo.damping_ratio": DAMPING}
STARTS = TRUTH | {"friction.sigma0": 1e6, "friction.sigma1": 45.0, "friction.f_ss": 0.65}


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """A step of the platform alone, with ten glitches; only the stack is free."""
    loaded = pdssjax.load_study(write_platform(tmp_path_factory.mktemp("study")))
    record = loaded.records[0]
    glitches = np.where(np.arange(record.time.size) % 80 == 79, 1e-6, 0.0)
    parameters = loaded.parameters | {
        "friction.sigma0": dataclasses.replace(loaded.parameters["friction.sigma0"], value=1e6)
    }
    records = (dataclasses.replace(record, measured=record.measured + glitches),)
    return dataclasses.replace(loaded, parameters=parameters, records=records)


@pytest.mark.parametrize("loss", [slow(Squares()), Huber(), slow(Cauchy())], ids=["squares", "huber", "cauchy"])
def test_what_is_left_is_the_problem_without_them(study, loss):
    (record,) = study.records
    used = (record.time < 4e-3) | (record.time > 15e-3)
    shorter = dataclasses.replace(record, time=record.time[used], measured=record.measured[used])
    problem, without = (
        pose(dataclasses.replace(study, records=(each,)), STARTS, Accuracy(), loss)._replace(noise=np.array([1e-8]))
        for each in (record, shorter)
    )
    held_out = problem.fitted_to([used])
    free = problem.encode({path: 1.01 * value for path, value in TRUTH.items()})
    residual, jacobian = (np.asarray(each) for each in held_out.linearised(free))
    expected, slopes = (np.asarray(each) for each in without.linearised(free))
    np.testing.assert_array_equal(residual[~used], 0.0)
    np.testing.assert_array_equal(jacobian[~used], 0.0)
    np.testing.assert_allclose(residual[used], expected, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(jacobian[used], slopes, rtol=1e-9, atol=1e-9 * np.abs(slopes).max())
    assert np.abs(np.asarray(problem.whitened(free))[used] - expected).max() > 1e-3, "the others moved the zero"


def test_where_no_sample_counts_all_residuals_are_zero_and_the_zero_is_that_of_all(study):
    (record,) = study.records
    problem = pose(study, STARTS, Accuracy())
    none = problem.fitted_to([np.zeros(record.time.size, bool)])
    free = problem.encode(TRUTH)
    weights = 1.0 / problem.noise
    residual, zero = none.residual(free, weights)
    np.testing.assert_array_equal(np.asarray(residual), 0.0)
    np.testing.assert_allclose(np.asarray(zero), np.asarray(problem.residual(free, weights)[1]), rtol=1e-12)
