"""Motions that repeat after two or three periods of the drive are found; what repeats later is not taken for one.

A ball falls (g = 1) on a plane that strikes it with the velocity W cos(w t), w = 2 pi, and stays where it is: exactly
the map of P. J. Holmes (J. Sound and Vibration 84(2), 1982).  From impact to impact, with restitution r,

    phi' = phi + 2 w v / g,        v' = r v + (1 + r) W cos phi'

It bounces once in k periods with v = k / 2 and cos phi = k (1 - r) / (2 (1 + r) W).  The map's Jacobian there has the
determinant r and the trace 1 + r - 2 (1 + r) w W sin phi; where w W sin phi = 1 a multiplier is -1: the period doubles.
"""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pdssjax import AbstractHybridSystem, Accuracy, Taylor
from pdssjax.integration import steady_state

RESTITUTION, RATE = 0.5, 2.0 * np.pi
FINE = Accuracy(tolerance=1e-14, method=Taylor(4), max_steps=256)
DOUBLES = np.hypot((1 - RESTITUTION) / (2 * (1 + RESTITUTION)), 1 / RATE)
"""The W at which the motion that bounces in every period gives way to one that repeats in every second."""


class Period(NamedTuple):
    duration: Any


class BouncingBall(AbstractHybridSystem):
    """x' = v, v' = -1; at x = 0 the plane turns the ball round.  A flag besides never changes: it is no deviation."""

    strength: Any
    begin: Any

    def initial(self):
        return (self.begin[0], self.begin[1], jnp.ones(()))

    def segment(self, index):
        return Period(jnp.ones(()) + 0.0 * index)

    def field(self, segment, t_local, x, mode):
        return (x[1], x[0] * 0.0 - 1.0, 0)

    def guards(self, segment, t_local, x, mode):
        return (x[0],)

    def after_event(self, segment, t_local, x, mode, which):
        struck = (1.0 + RESTITUTION) * self.strength * jnp.cos(RATE * t_local)
        return (jnp.zeros_like(x[0]), struck - RESTITUTION * x[1], x[2]), mode

    def state_scale(self):
        return (jnp.ones(()), jnp.ones(()), jnp.ones(()))

    def period(self):
        return (0, 1)


def impact_phase(strength, periods):
    """phi where the ball bounces once in so many periods."""
    return np.arccos(periods * (1 - RESTITUTION) / (2 * (1 + RESTITUTION) * strength))


def mapped(impact, strength):
    """The next impact: phase and velocity after it."""
    phase = impact[0] + 2 * RATE * impact[1]
    return np.array([phase, RESTITUTION * impact[1] + (1 + RESTITUTION) * strength * np.cos(phase)])


def jacobian(impact, strength):
    bend = (1 + RESTITUTION) * strength * np.sin(impact[0] + 2 * RATE * impact[1])
    return np.array([[1.0, 2 * RATE], [-bend, RESTITUTION - 2 * RATE * bend]])


@functools.cache
def compiled():
    find = lambda strength, begin: steady_state(BouncingBall(strength, begin), 1.0, FINE, 1e-10)
    return jax.jit(find)


def found(strength, periods):
    """From near the motion that bounces once in so many periods."""
    since = 1.0 - impact_phase(strength, periods) / RATE
    velocity = 0.5 * periods + 1e-3
    begin = jnp.array([velocity * since - 0.5 * since**2, velocity - since])
    return jax.tree.map(np.asarray, compiled()(jnp.asarray(strength), begin))


@pytest.mark.slow
@pytest.mark.parametrize(("strength", "periods"), [(0.2, 1), (0.36, 2), (0.52, 3)])
def test_a_ball_that_bounces_once_in_some_periods_has_the_multipliers_of_the_closed_form(strength, periods):
    motion = found(strength, periods)
    assert int(motion.period) == periods and int(motion.failure) == 0
    trace = 1 + RESTITUTION - 2 * (1 + RESTITUTION) * RATE * strength * np.sin(impact_phase(strength, periods))
    expected = np.sort(np.abs(np.roots([1.0, -trace, RESTITUTION])))[::-1]
    np.testing.assert_allclose(motion.multipliers, [*expected, 0.0], rtol=1e-6)
    since = 1.0 - impact_phase(strength, periods) / RATE
    np.testing.assert_allclose(motion.x[:2], [0.5 * periods * since - 0.5 * since**2, 0.5 * periods - since], atol=1e-9)


@pytest.mark.slow
def test_where_the_period_doubles_the_motion_of_two_periods_is_found_with_its_multipliers():
    below, above = found(0.99 * DOUBLES, 1), found(1.03 * DOUBLES, 1)
    assert int(below.period) == 1 and int(above.period) == 2
    impact = np.array([impact_phase(1.03 * DOUBLES, 1), 0.5 + 1e-3])
    for _ in range(2000):
        impact = mapped(impact, 1.03 * DOUBLES)
    monodromy = jacobian(mapped(impact, 1.03 * DOUBLES), 1.03 * DOUBLES) @ jacobian(impact, 1.03 * DOUBLES)
    expected = np.sort(np.abs(np.linalg.eigvals(monodromy)))[::-1]
    np.testing.assert_allclose(above.multipliers, [*expected, 0.0], rtol=1e-6)


@pytest.mark.slow
def test_a_motion_of_four_periods_is_said_not_to_repeat():
    motion = found(0.2467, 1)
    assert int(motion.period) == 0 and np.isnan(motion.multipliers).all() and int(motion.cycles) == 200
