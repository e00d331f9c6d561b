"""The trapezoid: its corners, the square wave that it tends to, and flanks that leave nothing between them."""

import jax.numpy as jnp
import numpy as np
import pytest

from pdssjax.drive.trapezoid import Trapezoid


def test_it_rises_stays_falls_and_rests():
    drive = Trapezoid(30.0, 20.0, 0.4, 5e-3, 1e-2)
    times = jnp.asarray([0.0, 0.0025, 0.005, 0.019, 0.02, 0.025, 0.03, 0.049, 0.0525])
    np.testing.assert_allclose(drive.at(times), [0.0, 15.0, 30.0, 30.0, 30.0, 15.0, 0.0, 0.0, 15.0], atol=1e-9)
    assert not drive.has_jumps()


def test_without_flanks_it_is_a_square_wave():
    drive = Trapezoid(30.0, 20.0, 0.4)
    times = jnp.asarray([-1e-9, 1e-9, 0.02 - 1e-9, 0.02 + 1e-9, 0.05 - 1e-9, 0.05 + 1e-9])
    np.testing.assert_array_equal(drive.at(times), [0.0, 30.0, 30.0, 0.0, 0.0, 30.0])
    assert drive.has_jumps() and Trapezoid(rise_time=1e-3).has_jumps()


def test_a_flank_that_is_too_long_leaves_no_plateau_and_breaks_a_condition():
    drive = Trapezoid(30.0, 20.0, 0.4, 0.03, 0.04)
    assert float(drive.segment(1.0).duration) == 0.0
    assert drive.at(jnp.asarray([0.02])) == pytest.approx(30.0)
    assert drive.broken_conditions() == {
        "rise_time": "0.03 s, expected less than the part of the period that its width leaves to rise and plateau, "
        "0.02 s",
        "fall_time": "0.04 s, expected less than what its width leaves to fall and rest, 0.03 s",
    }
