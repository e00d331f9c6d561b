"""Where a reversal of a steady cycle grazes, the cycle is integrated in place of Newton's method, and that is said."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from quick_blocks import example_study

import pdssjax
from benchmarks.maps import net_step_after
from pdssjax import Accuracy
from pdssjax.integration import GRAZES
from pdssjax.sweeps import GRAZING, plan_sweep
from pdssjax.sweeps.point import _details, _one_by_one, _results, compute_block

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
