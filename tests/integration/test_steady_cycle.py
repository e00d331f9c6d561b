"""When a motion counts as one that repeats: told from the distances between its cycles."""

import jax.numpy as jnp
import numpy as np
import pytest

from pdssjax.integration.steady_cycle import PERIODS, _remaining


def distances(places, cycle):
    """How far cycle number `cycle` of a motion, one place a cycle, and those before are from earlier ones."""
    return jnp.array(
        [[abs(places[k] - places[k - n]) for n in range(1, PERIODS + 1)] for k in range(cycle - PERIODS, cycle + 1)]
    )


@pytest.mark.parametrize("ratio", [0.3, 0.9, -0.8])
def test_what_is_still_to_come_is_that_of_a_geometric_series(ratio):
    places = 1e-8 * ratio ** np.arange(40)
    for cycle in (10, 30):
        remaining = _remaining(distances(places, cycle), 1e-30)
        assert float(remaining[0]) == pytest.approx(
            abs(places[cycle - 1]) if ratio > 0 else abs(places[cycle - 1]) * 9, rel=1e-6
        )
        # It comes near to repeating after two and three cycles, too, but that is not what it does.
        assert np.isinf(remaining[1:]).all()


@pytest.mark.parametrize(("pattern", "period"), [([0.0, 1e-6], 2), ([0.0, 1e-6, 4e-6], 3), ([0.0], 1)])
def test_a_motion_that_repeats_late_is_told_apart(pattern, period):
    places = np.resize(pattern, 40) + 1e-8 * 0.5 ** np.arange(40)
    for cycle in (20, 21, 22):
        found = np.asarray(_remaining(distances(places, cycle), 2e-11)) < 2e-11
        assert found.any() and int(np.argmax(found)) + 1 == period


def test_nothing_is_said_before_enough_cycles_were_seen():
    apart = jnp.full((PERIODS + 1, PERIODS), jnp.inf).at[-1, 0].set(1e-9)
    assert np.isinf(_remaining(apart, 2e-11)).all()


def test_cycles_that_are_equal_to_rounding_are_enough():
    apart = jnp.full((PERIODS + 1, PERIODS), jnp.inf).at[-1, 0].set(1e-13)
    assert float(_remaining(apart, 2e-11)[0]) == 1e-13
