"""What is shown of a system at sample times: of a falling stone, in closed form, with a sensor and without one."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pdssjax import AbstractHybridSystem, Accuracy, Taylor
from pdssjax.integration import FAILURES
from pdssjax.simulation import (
    ACCELERATION,
    DISPLACEMENT,
    FRICTION_FORCE,
    STOP_FORCE,
    VELOCITY,
    Output,
    sensor_samples,
    why_failed,
)

TIMES = np.linspace(-0.2, 0.8, 21)
USUAL = Accuracy(method=Taylor(6), max_steps=16)


class Stretch(NamedTuple):
    duration: Any


class Stone(AbstractHybridSystem):
    """It falls from rest, for ever; nothing looks at it."""

    gravity: Any

    def initial(self):
        return (jnp.zeros(()), jnp.zeros(()))

    def segment(self, index):
        return Stretch(jnp.asarray(jnp.inf))

    def field(self, segment, t_local, x, mode):
        return (x[1], -self.gravity)

    def guards(self, segment, t_local, x, mode):
        return ()

    def after_event(self, segment, t_local, x, mode, which):
        raise AssertionError("there is no event")

    def state_scale(self):
        return (jnp.ones(()), jnp.ones(()))


class Late(eqx.Module):
    delay: Any


class WatchedStone(Stone):
    """The same, with a sensor that is late."""

    sensor: Late


HEIGHT = Output(lambda system, segment, t_local, x, mode: 5.0 + x[0], lambda system: (0,))
"""From where it lay."""
AT_ONCE = HEIGHT._replace(delay=lambda system: 0.0)


def height(times):
    """Zero before the start, whatever is shown of what lies still."""
    return np.where(times < 0.0, 0.0, 5.0 - 0.5 * 9.81 * times**2)


@pytest.mark.parametrize(
    ("output", "delay", "late"),
    [(HEIGHT, None, 0.0), (HEIGHT, 0.13, 0.13), (AT_ONCE, 0.13, 0.0)],
    ids=["without a sensor", "with a sensor", "asked at once"],
)
def test_a_stone_is_shown_as_it_falls_and_later_only_where_there_is_a_sensor_that_is_late(output, delay, late):
    def shown(gravity):
        system = Stone(gravity) if delay is None else WatchedStone(gravity, Late(delay))
        return sensor_samples(system, jnp.asarray(TIMES), USUAL, output)

    np.testing.assert_allclose(jax.jit(shown)(9.81), height(TIMES - late), rtol=0.0, atol=1e-13)


def test_outputs_are_late_by_the_sensor_of_the_system_but_for_a_force_that_is_taken_as_it_is():
    bare, watched = Stone(9.81), WatchedStone(9.81, Late(0.13))
    for output in (DISPLACEMENT, VELOCITY, ACCELERATION, STOP_FORCE):
        assert output.delay(bare) == 0.0 and output.delay(watched) == 0.13
    assert FRICTION_FORCE.delay(watched) == 0.0


def test_what_cannot_be_integrated_is_shown_as_nan_and_the_reason_is_told():
    ask = lambda what: jax.jit(lambda gravity: what(Stone(gravity), jnp.asarray(TIMES), USUAL, HEIGHT))
    assert np.isnan(ask(sensor_samples)(np.nan)).all()
    assert int(ask(why_failed)(9.81)) == 0
    assert FAILURES[int(ask(why_failed)(np.nan))] == "the motion did not stay finite"


@pytest.mark.parametrize("derivative", [jax.jacfwd, jax.jacrev])
def test_what_cannot_be_integrated_has_no_derivative_either(derivative):
    slope = jax.jit(derivative(lambda gravity: sensor_samples(Stone(gravity), jnp.asarray(TIMES), USUAL, HEIGHT)))
    np.testing.assert_allclose(slope(9.81), np.where(TIMES < 0.0, 0.0, -0.5 * TIMES**2), rtol=0.0, atol=1e-13)
    assert np.isnan(slope(np.nan)).all()


def test_of_times_that_pad_a_record_nothing_is_computed_and_the_others_are_as_without():
    own, padding = jnp.linspace(0.0, 0.8, 300), jnp.arange(700)
    shown = lambda gravity, times, wanted=None: sensor_samples(Stone(gravity), times, USUAL, HEIGHT, wanted=wanted)
    weighted = lambda gravity, times, weights, wanted: jnp.sum(weights * shown(gravity, times, wanted))
    both = jax.jit(lambda *args: (shown(*args), jax.jacfwd(shown)(*args)))
    backwards = jax.jit(jax.grad(weighted))
    values, slopes = height(own), -0.5 * own**2
    for wanted in (1, 127, 128, 129, 300):
        padded = jnp.where(padding < wanted, jnp.pad(own, (0, 400)), own[-1])
        some, their_slopes = both(9.81, padded, jnp.asarray(wanted))
        np.testing.assert_allclose(some[:wanted], values[:wanted], rtol=0.0, atol=1e-13)
        np.testing.assert_allclose(their_slopes[:wanted], slopes[:wanted], rtol=0.0, atol=1e-13)
        weights = (padding < wanted) * jnp.cos(padding)
        found = backwards(9.81, padded, weights, jnp.asarray(wanted))
        np.testing.assert_allclose(found, weights[:wanted] @ slopes[:wanted], rtol=1e-9, atol=1e-13)
