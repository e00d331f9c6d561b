"""Where a reversal of a steady cycle grazes, the cycle is integrated in place of Newton's method, and that is said."""

import jax.numpy as jnp
import numpy as np
import pytest
from quick_blocks import example_study

import pdssjax
from benchmarks.maps import net_step_after
from pdssjax import Accuracy
from pdssjax.simulation import GRAZES
from pdssjax.sweeps import GRAZING, plan_sweep
from pdssjax.sweeps.point import _detailed, _found_of, _one_by_one, compute_block

FREQUENCY = 150.0


@pytest.fixture(scope="module")
def function():
    over = {"drive.voltage": [50.0], "drive.frequency": [FREQUENCY]}
    return plan_sweep(example_study(), over, cycles="steady", metrics=("reversals", "grazing", "multiplier")).function


@pytest.fixture(scope="module")
def looked_at(function):
    """Reversals, grazing, multiplier and failure of steady cycles at eight voltages."""

    def look(volts):
        return np.column_stack(_found_of(_detailed, function, np.column_stack([volts, np.full(8, FREQUENCY)]))).T

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
    # A steady trajectory of the same actuator says as much.
    for voltage, near in zip(volts[[0, 4]], grazing[[0, 4]], strict=True):
        system = function.system(jnp.array([voltage, FREQUENCY]))
        times = jnp.linspace(0.0, 0.999, 20) / FREQUENCY
        moving = pdssjax.simulate(system.actuator, system.drive, times, Accuracy(max_steps=2048), cycles="steady")
        assert float(moving.grazing) == pytest.approx(near, rel=0.1, abs=1e-3)
    # Left to Newton's method it is integrated, too: to what 200 cycles lead to.
    values = np.array([grazing_voltage, FREQUENCY])
    (patient,), failed = _found_of(_one_by_one, function, values[None])
    expected = float(net_step_after(function)(values))
    assert failed.tolist() == [GRAZING] and np.isfinite(patient).all()
    assert float(patient[0]) == pytest.approx(expected, abs=1e-10)


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
