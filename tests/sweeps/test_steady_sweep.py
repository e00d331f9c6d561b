"""The steady cycle of a sweep is the cycle after very many."""

import dataclasses

import numpy as np
import pytest
from quick_blocks import study as study
from random_sweeps import random_actuators

import pdssjax
from benchmarks.maps import net_step_after
from pdssjax import Accuracy, InputError
from pdssjax.sweeps import Listed, plan_sweep
from pdssjax.sweeps.blocks import INCOMPLETE

POINTS = {"drive.voltage": [30.0, 64.0, 150.0, 80.0], "drive.frequency": [5.0, 50.0, 120.0, 250.0]}


@pytest.fixture(scope="module")
def data(study):
    return pdssjax.sweep(study, Listed(POINTS), cycles="steady", workers=1)


def test_a_steady_sweep_says_after_how_many_cycles_the_motion_repeats(data):
    assert data.attrs["cycles"] == "steady" and not data.failure.any()
    assert (data.cycles_to_repeat == 1).all()
    # At 5 Hz all has come to rest before the next drop; at 250 Hz it still rings.
    assert float(data.decay[0]) < 1e-3 < float(data.decay[3]) < 1.0
    np.testing.assert_allclose(data.net_step, data.speed / data.drive_frequency)
    np.testing.assert_allclose(data.back_slip, data.stroke - data.net_step)


@pytest.mark.parametrize("cycles", ["stead", 0])
def test_another_word_is_refused(study, cycles):
    with pytest.raises(InputError, match='expected a number of at least 1, or "steady"'):
        pdssjax.sweep(study, POINTS, cycles=cycles)


@pytest.mark.slow
def test_random_points_agree_with_200_cycles(study):
    rng = np.random.default_rng(5)
    points = Listed({"drive.voltage": rng.uniform(8.0, 150.0, 12), "drive.frequency": 10 ** rng.uniform(0.7, 2.4, 12)})
    for reading in ("deflection", "force"):
        asked = dataclasses.replace(study, friction_state=reading)
        data = pdssjax.sweep(asked, points, cycles="steady", workers=1)
        brute = net_step_after(plan_sweep(asked, points, cycles="steady").function)
        expected = np.array([float(brute(values)) for values in points.values()])
        np.testing.assert_allclose(data.net_step, expected, rtol=0.0, atol=1e-10)


@pytest.mark.slow
def test_a_transient_that_dies_out_slowly_is_left_to_newton(study):
    light = study.with_values({"piezo.damping_ratio": 0.004, "friction.sigma1_a": 1.0, "friction.sigma1_b": 1.0})
    points = Listed({"drive.voltage": [3.0, 3.0], "drive.frequency": [150.0, 200.0]})
    data = pdssjax.sweep(light, points, cycles="steady", workers=1)
    brute = net_step_after(plan_sweep(light, points).function, 1000)
    expected = [float(brute(values)) for values in points.values()]
    assert (data.decay > 0.7).any() and (data.cycles_to_repeat == 1).all()
    np.testing.assert_allclose(data.net_step, expected, rtol=0.0, atol=1e-10)


@pytest.mark.slow
def test_elements_that_remember_the_start_have_no_derivatives():
    """In the dead zone some Maxwell elements never slip again: which orbit is reached depends on the transient.

    Newton's method, from where 24 cycles lead, jumped to an orbit that repeats after two or three.
    """
    study, columns = random_actuators("generalized-maxwell-slip", "", 8)
    columns |= {"drive.voltage": np.geomspace(0.5, 10.0, 8), "drive.frequency": np.full(8, 150.0)}
    here = {path: column[[4, 7]] for path, column in columns.items()}
    found = pdssjax.sweep(study, Listed(here), cycles="steady", derivatives=["piezo.gain"], workers=1)
    assert found.cycles_to_repeat.values.tolist() == [1, 1]
    assert found.failure.values.tolist() == [INCOMPLETE, 0]
    assert np.isnan(found.stroke_by_piezo_gain).values.tolist() == [True, False]
    late = pdssjax.sweep(study, Listed(here), cycles=200, accuracy=Accuracy(max_steps=400_000), workers=1)
    for name in ("net_step", "stroke"):
        np.testing.assert_allclose(found[name], late[name], rtol=0.0, atol=1e-10)
