"""What a cycle leaves of a motion."""

import numpy as np
import pytest

from pdssjax.metrics import drift_per_cycle

PERIOD = 0.05
NET = 3e-7


def walk(time, net=NET):
    """A stroke of 2 um that each cycle ends short of, by less in the first."""
    cycles = time / PERIOD
    return net * np.maximum(cycles, 1.0) + 1e-6 * np.sin(2.0 * np.pi * cycles)


@pytest.mark.parametrize("interval", [1e-3, 7.3e-4])
def test_a_walk_s_net_step_and_stroke_are_found_whatever_the_first_cycle_did(interval):
    time = np.arange(0.0, 0.4, interval)
    found = drift_per_cycle(time, walk(time), 1.0 / PERIOD)
    assert found.net == pytest.approx(NET, rel=1e-3)
    assert found.stroke == pytest.approx(2e-6, rel=0.2)


def test_the_error_holds_what_noise_does():
    time, random, noise = np.arange(0.0, 0.4, 1e-3), np.random.default_rng(9), 1e-8
    found = [drift_per_cycle(time, noise * random.standard_normal(time.size), 1.0 / PERIOD) for _ in range(200)]
    pulls = np.array([each.net / each.standard_error for each in found])
    # The differences overlap, so that their mean is known better than their scatter tells.
    assert 0.1 < np.std(pulls) < 1.0
    assert np.abs(pulls).max() < 3.0


def test_less_than_two_cycles_tell_nothing():
    time = np.arange(0.0, 0.09, 1e-3)
    assert drift_per_cycle(time, walk(time), 1.0 / PERIOD) is None
