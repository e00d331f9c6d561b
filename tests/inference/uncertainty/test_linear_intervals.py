"""Linear intervals are symmetric on the scale of the fit and end where parameters may not go on."""

import dataclasses

import numpy as np
import platform_study
import pytest

import pdssjax
from pdssjax.inference import NORMAL_95
from pdssjax.inference.parameter_transform import ParameterTransform
from pdssjax.inference.uncertainty.linear_intervals import linear_intervals

RATE = "piezo.natural_frequency"


def test_ends_are_symmetric_on_the_scale_of_the_fit_and_cut_at_bounds():
    # A logarithm, a number in units of 1e-5, one that nothing tells, and one that may not exceed 1.
    logarithmic, unit = np.array([True, False, False, True]), np.array([1.0, 1e-5, 1.0, 1.0])
    free = ParameterTransform(("a", "b", "c", "d"), logarithmic, unit, np.full(4, -np.inf), np.full(4, np.inf))
    bounds = dict.fromkeys("abc", (0.0, np.inf)) | {"d": (0.0, 1.0)}
    at, deviation = np.array([np.log(2.0), 2.0, 1.0, np.log(0.9)]), np.array([0.5, 1.5, np.nan, 0.1])
    found = linear_intervals(at, deviation, np.array([np.inf] * 4), free, bounds)
    assert found["a"] == pytest.approx((2.0 * np.exp(-0.5 * NORMAL_95), 2.0 * np.exp(0.5 * NORMAL_95)))
    assert found["b"] == pytest.approx((0.0, 1e-5 * (2.0 + 1.5 * NORMAL_95))) and found["b"][0] == 0.0
    assert np.isnan(found["c"]).all()
    assert found["d"] == pytest.approx((0.9 * np.exp(-0.1 * NORMAL_95), 1.0)) and found["d"][1] == 1.0


def test_an_estimate_s_intervals_stay_within_what_its_study_allows(tmp_path):
    text = platform_study.PLATFORM.replace('"friction.sigma0" = {}', '"friction.sigma0" = { value = 1e6 }')
    study = pdssjax.load_study(platform_study.write_platform(tmp_path, text))
    wide = pdssjax.identify(study).parameters[RATE]
    least = wide.value - wide.standard_error
    bounded = dataclasses.replace(study.parameters[RATE], low=least)
    found = pdssjax.identify(dataclasses.replace(study, parameters=study.parameters | {RATE: bounded}))
    cut = found.parameters[RATE]
    assert wide.interval_at_bound == () and cut.interval_at_bound == ("lower",)
    assert wide.interval[0] < least == cut.interval[0]
    assert cut.interval[1] == pytest.approx(wide.interval[1], rel=1e-6)
    for error in cut.errors.values():
        assert error.interval[0] == least and error.interval[1] > cut.value
    assert cut.remark == "interval ends at its lower bound"
