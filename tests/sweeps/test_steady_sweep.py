"""The steady cycle of a sweep is the cycle after very many, also where a reversal grazes, and says so."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from quick_blocks import example_study, study as study
from random_sweeps import random_actuators

import pdssjax
from benchmarks.maps import net_step_after
from pdssjax import Accuracy, InputError
from pdssjax.integration import GRAZES
from pdssjax.sweeps import GRAZING, Listed, plan_sweep
from pdssjax.sweeps.blocks import INCOMPLETE
from pdssjax.sweeps.point import _details, _one_by_one, _results, compute_block

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


FREQUENCY = 150.0


@pytest.fixture(scope="module")
def function():
    over = {"drive.voltage": [50.0], "drive.frequency": [FREQUENCY]}
    return plan_sweep(example_study(), over, cycles="steady", metrics=("reversals", "grazing", "multiplier")).function


@pytest.fixture(scope="module")
def looked_at(function):
    """Reversals, grazing, multiplier and failure of steady cycles at eight voltages."""

    def look(volts):
        return np.column_stack(_results(_details, function, np.column_stack([volts, np.full(8, FREQUENCY)]))).T

    return look


@pytest.fixture(scope="module")
def grazing_voltage(looked_at):
    """Where the number of reversals changes with the voltage, one of them grazes."""
    low, high = 40.0, 140.0
    for _ in range(12):
        volts = np.linspace(low, high, 8)
        reversals, grazing, *_ = looked_at(volts)
        if grazing.min() < 0.5 * GRAZES:
            return float(volts[grazing.argmin()])
        change = int(np.flatnonzero(np.diff(reversals))[0])
        low, high = volts[change : change + 2]
    pytest.fail("no voltage at which a reversal grazes")


@pytest.mark.slow
def test_a_cycle_with_a_grazing_reversal_is_integrated_and_says_so(function, looked_at, grazing_voltage):
    volts = np.full(8, grazing_voltage)
    volts[4:] = 64.0
    reversals, grazing, multiplier, failure = looked_at(volts)
    assert (failure[:4] == GRAZING).all() and np.isnan(multiplier[:4]).all() and (grazing[:4] < GRAZES).all()
    assert (failure[4:] == 0).all() and (multiplier[4:] < 1.0).all() and (reversals > 0).all()
    # Left to Newton's method it is integrated, too: to what 200 cycles lead to.
    values = np.array([grazing_voltage, FREQUENCY])
    (patient,), failed = _results(_one_by_one, function, values[None])
    expected = float(net_step_after(function)(values))
    assert failed.tolist() == [GRAZING] and np.isfinite(patient).all()
    assert float(patient[0]) == pytest.approx(expected, abs=1e-10)

    # So is a steady trajectory, which has derivatives where no reversal grazes.
    def net_step(voltage):
        system = function.system(jnp.stack([voltage, jnp.asarray(FREQUENCY)]))
        times = jnp.array([0.0, 1.0 - 1e-10]) / FREQUENCY
        moving = pdssjax.simulate(system.actuator, system.drive, times, Accuracy(max_steps=2048), cycles="steady")
        return moving.effector[1] - moving.effector[0], moving.grazing

    look = jax.jit(jax.jacfwd(lambda voltage: (net_step(voltage)[0], net_step(voltage)), has_aux=True))
    slope, (net, near) = look(jnp.asarray(grazing_voltage))
    assert float(net) == pytest.approx(expected, abs=1e-10) and float(near) < GRAZES and np.isnan(float(slope))
    slope, (_, near) = look(jnp.asarray(64.0))
    assert float(near) == pytest.approx(grazing[4], rel=0.1) and np.isfinite(float(slope))


@pytest.mark.slow
def test_there_are_no_derivatives_where_a_reversal_grazes(monkeypatch):
    over = {"drive.voltage": [64.0], "drive.frequency": [50.0]}
    # As if every reversal grazed.
    monkeypatch.setattr("pdssjax.sweeps.point.GRAZES", 2.0)
    function = plan_sweep(example_study(), over, metrics=("peak_friction",), derivatives=("piezo.gain",)).function
    (found,) = compute_block(function, np.array([[64.0, 50.0]]))
    by_name = dict(zip(function.columns, found, strict=False))
    assert found[-1] == GRAZING
    for name, number in by_name.items():
        assert np.isnan(number) == ("_by_" in name), name
