"""A guard that is below zero for a moment between two samples, while its second derivative changes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.polynomial import polynomial as poly

from pdssjax.integration.event_location import first_crossing
from pdssjax.integration.taylor_series import polynomial


@jax.jit
def located(guard):
    """Where in a step of 1 s a guard crosses zero, and whether it does."""
    time, event, _ = first_crossing((polynomial(list(guard)),), guard.size, jnp.ones(()))
    return time, event


@pytest.mark.parametrize(("others", "gap"), [([-0.1], 1e-5), ([1.2], 1e-5), ([-0.1, 1.3], 1e-3)])
@pytest.mark.parametrize("at", [0.05, 0.21, 0.4, 0.75, 0.9])
def test_a_dip_is_found_whose_lowest_point_is_needed_to_a_part_of_the_gap_between_its_roots(at, others, gap):
    guard = poly.polyfromroots([at, at + gap, *others])
    padded = np.pad(guard * np.sign(guard[0]), (0, 5 - guard.size))
    time, event = located(padded)
    assert event and float(time) == pytest.approx(at, abs=1e-14 / gap)
